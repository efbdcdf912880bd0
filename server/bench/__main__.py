"""``dronerf bench NAME``: measures, prints one JSON object or a table, resumes where it stopped."""

from __future__ import annotations

import argparse
import importlib
import json
import signal
import sys
from pathlib import Path

from server.bench.conditions import conditions
from server.bench.options import CORES, Figures, Options
from server.sim.meshes import SceneError
from server.sim.scenes.catalogue import SCENES, load_object

# By name, so that a bench loads only what it measures.
_BENCHES = {
    "dashboard": "server.bench.dashboard",
    "live": "server.bench.live",
    "load": "server.bench.load",
    "nerf": "server.bench.nerf",
    "planner": "server.bench.planner",
    "policies": "server.bench.policies",
    "poses": "server.bench.poses",
    "mission": "server.bench.missions.measure",
    "regions": "server.bench.regions",
    "soak": "server.bench.soak",
    "table1": "server.bench.table1",
    "video": "server.bench.video",
}


def _threads(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of threads")
    return int(text)


def main() -> int:
    """Run the bench named on the command line."""
    parser = argparse.ArgumentParser(prog="dronerf bench", description=__doc__)
    parser.add_argument("name", choices=sorted(_BENCHES), help="what to measure")
    parser.add_argument(
        "--scene",
        action="append",
        metavar="SCENE",
        help="a scene's name or a .glb or .obj file; repeat for several (default: all scenes,"
        " and the other meshes at hand)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="at most 12 minutes: less of each")
    parser.add_argument(
        "--faults",
        action="store_true",
        help="mission: everything that can go wrong, in each phase (else plain missions)",
    )
    parser.add_argument(
        "--only",
        default="",
        metavar="TEXT",
        help="mission: fly only those in virtual time whose name holds TEXT, and tell all of each;"
        " with the seed of the run that named it, a mission repeats exactly",
    )
    parser.add_argument(
        "--pictures",
        type=int,
        action="append",
        metavar="N",
        help="table1: also with so many pictures; repeat for a curve",
    )
    parser.add_argument(
        "--drones",
        type=int,
        action="append",
        metavar="N",
        help="table1: also with so many drones; repeat for a curve",
    )
    parser.add_argument(
        "--ablations",
        action="store_true",
        help="table1: also the mission without each of its parts; instead of all else, nerf: the"
        " training without each of its switches, planner: the fitness without each of its terms",
    )
    parser.add_argument(
        "--threads",
        type=_threads,
        default=CORES,
        metavar="N",
        help="threads to compute with (default: one per core, %(default)s); give each of several"
        " benches on one machine its own share, or they wait for one another",
    )
    parser.add_argument("--out", type=Path, help="folder for pictures and finished parts")
    parser.add_argument("--resume", action="store_true", help="go on from the parts in --out")
    parser.add_argument("--json", action="store_true", help="print one JSON object on one line")
    arguments = parser.parse_args()
    if arguments.resume and arguments.out is None:
        parser.error("--resume needs --out")
    if (arguments.faults or arguments.only) and arguments.name != "mission":
        parser.error("--faults and --only are for the bench mission")
    if arguments.name != "table1" and (arguments.pictures or arguments.drones):
        parser.error("--pictures and --drones are for the bench table1")
    if arguments.ablations and arguments.name not in ("nerf", "planner", "table1"):
        parser.error("--ablations is for the benches nerf, planner and table1")
    bench = importlib.import_module(_BENCHES[arguments.name])
    all_scenes = getattr(bench, "SCENES", SCENES)
    options = Options(
        scenes=tuple(arguments.scene or (bench.QUICK_SCENES if arguments.quick else all_scenes)),
        seed=arguments.seed,
        quick=arguments.quick,
        faults=arguments.faults,
        only=arguments.only,
        out=arguments.out,
        resume=arguments.resume,
        pictures=tuple(arguments.pictures or ()),
        drones=tuple(arguments.drones or ()),
        ablations=arguments.ablations,
        threads=arguments.threads,
    )
    try:
        for scene in options.scenes:
            load_object(scene)
    except SceneError as error:
        print(f"dronerf bench: {error}", file=sys.stderr)
        return 2
    # Asked before: the checkout may change, and the load afterwards is the bench's own.
    # Asked to end, as by kill: what it has started ends with it.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    found = conditions(
        options.seed, quick=options.quick, faults=options.faults, threads=options.threads
    )
    figures: Figures = bench.run(options)
    result = {
        "bench": arguments.name,
        "conditions": found,
        "scenes": figures.scenes,
        "overall": figures.overall,
    }
    print(json.dumps(result) if arguments.json else json.dumps(result, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
