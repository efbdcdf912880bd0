"""``dronerf bench NAME``: measures, prints one JSON object or a table, resumes where it stopped."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from server.bench import nerf
from server.bench.conditions import conditions
from server.sim.meshes import SceneError
from server.sim.scenes.catalogue import SCENES, load_object

_BENCHES = {"nerf": nerf.measure}


def main() -> int:
    """Run the bench named on the command line."""
    parser = argparse.ArgumentParser(prog="dronerf bench", description=__doc__)
    parser.add_argument("name", choices=sorted(_BENCHES), help="what to measure")
    parser.add_argument(
        "--scene",
        action="append",
        metavar="SCENE",
        help="a scene's name or a .glb or .obj file; repeat for several (default: all four scenes)",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="at most 12 minutes: two scenes")
    parser.add_argument("--out", type=Path, help="folder for pictures and finished parts")
    parser.add_argument("--resume", action="store_true", help="go on from the parts in --out")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    if arguments.resume and arguments.out is None:
        parser.error("--resume needs --out")
    scenes = arguments.scene or (["robot_dog", "recycle_bin"] if arguments.quick else list(SCENES))
    try:
        for scene in scenes:
            load_object(scene)
    except SceneError as error:
        print(f"dronerf bench: {error}", file=sys.stderr)
        return 2
    threads = os.cpu_count() or 1
    parts: dict[str, dict[str, Any]] = {}
    for scene in scenes:
        kept = None
        if arguments.out is not None:
            arguments.out.mkdir(parents=True, exist_ok=True)
            kept = arguments.out / f"{arguments.name}-{Path(scene).stem}-{arguments.seed}.json"
        if arguments.resume and kept is not None and kept.exists():
            parts[scene] = json.loads(kept.read_text())
            continue
        print(f"{arguments.name}: {scene}", file=sys.stderr, flush=True)
        parts[scene] = _BENCHES[arguments.name](scene, arguments.seed, threads, arguments.out)
        if kept is not None:
            kept.write_text(json.dumps(parts[scene], indent=1))
    result = {
        "bench": arguments.name,
        "conditions": conditions(arguments.seed, quick=arguments.quick, threads=threads),
        "scenes": parts,
        "overall": _overall(parts),
    }
    print(json.dumps(result) if arguments.json else json.dumps(result, indent=2))
    return 0


def _overall(parts: dict[str, dict[str, Any]]) -> dict[str, float]:
    """Return the mean of every key over scenes; the peak's largest."""
    keys = next(iter(parts.values())).keys()
    overall = {
        key: round(float(np.mean([part[key] for part in parts.values()])), 3) for key in keys
    }
    overall["peak_memory_mb"] = max(part["peak_memory_mb"] for part in parts.values())
    return overall


if __name__ == "__main__":
    sys.exit(main())
