"""``dronerf capture`` and ``plan``: a running console from a shell; plans also without one."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from server.app import StartError, job_place, job_runner
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.jobs.plan import PlanInput
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec
from server.settings import SettingsError, load_settings
from server.sim.meshes import SceneError
from server.sim.scenes.catalogue import load_object
from server.terminal import SCENES, AddCommand, count, fleet_size, metrics_table, seconds, seed

_URL = "http://127.0.0.1:8000"
# Where drones stand for a plan without a fleet.
_START_RADIUS_M, _START_HEIGHT_M = 1.8, 1.0
# Rows of a plan's table: what each term of its fitness says, for people.
_TERMS = {
    "agreement": "views that see a patch well",
    "visibility": "surface seen from several sides",
    "detail": "resolution on the surface",
    "priority": "hollows and parts that matter",
    "spread": "spread of the directions",
    "baseline": "angles between neighbours",
    "overlap": "pictures alike, less is better",
}


def add_console_commands(commands: Any, add: AddCommand) -> None:
    """Add both commands to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "capture", run_capture, "start a capture on a running console")
    part.add_argument("--url", default=_URL, help=f"the console ({_URL})")
    part.add_argument("--mode", choices=("optimized", "standard"), help="(optimized)")
    part.add_argument("--drones", type=fleet_size, help="how many drones to use (all)")
    part.add_argument("--pictures", type=count, help="pictures in all (24)")
    part.add_argument("--train-seconds", type=seconds, help="training of the judged field (60)")
    part.add_argument("--name", help="what to call it; also part of the run folder's name")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")

    part = add(
        commands, "plan", run_plan, "where to take pictures: a console's plan, or of any object"
    )
    part.add_argument("--url", default=_URL, help=f"the console whose newest plan to show ({_URL})")
    thing = part.add_mutually_exclusive_group()
    thing.add_argument(
        "--size",
        type=_size,
        metavar="XxYxZ",
        help="plan for a box of this size (metres)",
    )
    thing.add_argument("--object", metavar="OBJECT", help=f"plan for the box of {SCENES}")
    part.add_argument("--drones", type=fleet_size, default=4, help="of such a plan, 1 to 8 (4)")
    part.add_argument("--pictures", type=count, default=24, help="pictures in all (24)")
    part.add_argument(
        "--enough",
        type=_percent,
        metavar="PERCENT",
        help="also say how many pictures see this share of the boxes' surface",
    )
    part.add_argument("--seed", type=seed, default=0, help="seed of the annealing (0)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_capture(arguments: argparse.Namespace) -> int:
    """Start a capture on a running console and follow it to its end."""
    body = {"mode": arguments.mode, "pictures": arguments.pictures, "name": arguments.name}
    body |= {"train_seconds": arguments.train_seconds, "drones": arguments.drones}
    body = {key: value for key, value in body.items() if value is not None}
    started_s = time.monotonic()
    with _client(arguments.url) as client:
        answer = client.post("/api/v1/captures", json=body)
        while True:
            if answer.is_error:
                return _refused(answer)
            record = answer.json()
            print(f"\r{record['phase']:<12}{record['progress']:6.0%}", end="", file=sys.stderr)
            if record["state"] not in ("queued", "running", "paused"):
                break
            time.sleep(1.0)
            answer = client.get(f"/api/v1/captures/{record['id']}")
        print(file=sys.stderr)
    if record["state"] != "succeeded":
        print(f"dronerf: capture {record['state']}: {record['error']}", file=sys.stderr)
        return 1
    result = record["metrics"] | {"wall_s": round(time.monotonic() - started_s, 1)}
    print(json.dumps(result) if arguments.json else metrics_table(result))
    return 0


def run_plan(arguments: argparse.Namespace) -> int:
    """Show a running console's newest plan, or plan for an object without flying."""
    if arguments.size is not None:
        x, y, z = arguments.size
        return asyncio.run(_plan_for(_standing(x, y, z), arguments))
    if arguments.object is not None:
        try:
            corners = load_object(arguments.object).vertices
        except SceneError as error:
            raise StartError(str(error)) from error
        return asyncio.run(_plan_for(Box3(corners.min(axis=0), corners.max(axis=0)), arguments))
    with _client(arguments.url) as client:
        answer = client.get("/api/v1/plans")
        if answer.is_error:
            return _refused(answer)
        plans = answer.json()
    if not plans:
        print(
            f"dronerf: {arguments.url} has made no plan yet; --size or --object plans without it",
            file=sys.stderr,
        )
        return 1
    print(json.dumps(plans[0]) if arguments.json else _plan_table(plans[0]))
    return 0


async def _plan_for(box: Box3, arguments: argparse.Namespace) -> int:
    """Have the worker plan for an object in ``box`` and print the plan."""
    drones = [f"drone-{number + 1}" for number in range(arguments.drones)]
    if arguments.pictures % len(drones):
        raise StartError(
            f"{arguments.pictures} pictures cannot be shared out evenly by {len(drones)} drones"
        )
    settings = load_settings()
    wanted = PlanInput(
        outer=(box.lower.tolist(), box.upper.tolist()),
        boxes=[(box.lower.tolist(), box.upper.tolist())],
        views=len(drones),
        intrinsics=asdict(TELLO_INTRINSICS),
        tilt_rad=TELLO_TILT_RAD,
        drones={drone: _start(number, len(drones)) for number, drone in enumerate(drones)},
        rounds=arguments.pictures // len(drones),
        config=asdict(settings.flight().planner),
        enough=None if arguments.enough is None else arguments.enough / 100.0,
    )
    spec = JobSpec("plan", wanted.model_dump(), seed=arguments.seed, threads=1, niceness=0)
    done: dict[str, Any] = {}
    async with AsyncExitStack() as stack:
        place = job_place(settings)
        temporary = tempfile.TemporaryDirectory(prefix=".dronerf-job-", dir=place)
        folder = stack.enter_context(temporary)
        runner = await stack.enter_async_context(job_runner(settings, plan_too=True))
        job = await runner.submit(spec, Path(folder))
        try:
            async for event in job.events():
                if event["event"] == "progressed" and sys.stderr.isatty():
                    share = event["iteration"] / event["iterations"]
                    print(f"\rplan {share:6.0%}", end="", file=sys.stderr, flush=True)
                done = event
        except JobFailedError as error:
            print(f"dronerf: {error}", file=sys.stderr)
            return 2 if error.bad_input else 1
        finally:
            await job.cancel()
    if sys.stderr.isatty():
        print(file=sys.stderr)
    kept = ("fitness", "terms", "candidates", "bound", "bound_kind", "enough")
    plan = {key: done[key] for key in kept}
    plan["viewpoints"] = [
        {"round_index": index, "drone_id": drone, "position_world": place[:3], "yaw_rad": place[3]}
        for index, assigned in enumerate(done["rounds"])
        for drone, place in assigned.items()
    ]
    print(json.dumps(plan) if arguments.json else _plan_table(plan))
    return 0


def _standing(x: float, y: float, z: float) -> Box3:
    """Return the box of this size that stands in the middle of the floor."""
    return Box3(np.array([-x / 2.0, -y / 2.0, 0.0]), np.array([x / 2.0, y / 2.0, z]))


def _start(number: int, drones: int) -> tuple[float, float, float, float]:
    """Return x, y, z (metres) and yaw (radians) of a drone on the start circle, facing inwards."""
    azimuth = 2.0 * np.pi * number / drones
    x, y = _START_RADIUS_M * np.cos(azimuth), _START_RADIUS_M * np.sin(azimuth)
    return float(x), float(y), _START_HEIGHT_M, float(azimuth - np.pi)


def _plan_table(plan: Mapping[str, Any]) -> str:
    """Return a plan for people: what it is worth, then who flies where."""
    fitness, bound = plan["fitness"], plan["bound"]
    lines = [f"{len(plan['viewpoints'])} viewpoints out of {plan['candidates']}"]
    if fitness is not None:  # The ring has none.
        lines.append(f"  {'fitness':<34}{fitness:.3f}")
    if fitness is not None and bound is not None:
        gap = max(0.0, 1.0 - fitness / bound)
        submodular = plan.get("bound_kind") == "submodular"
        words = "at most (submodular bound)" if submodular else "at most, by any choice of these"
        lines.append(f"  {words:<34}{bound:.3f}, {gap:.1%} away")
    for key, words in _TERMS.items():
        if plan["terms"].get(key) is not None:
            lines.append(f"    {words:<32}{plan['terms'][key]:.3f}")
    if plan.get("enough") is not None:
        lines.append(f"  {_enough_words(plan['enough'])}")
    lines.append(f"  {'round':<7}{'drone':<12}{'x m':>8}{'y m':>8}{'z m':>8}{'heading':>9}")
    for view in plan["viewpoints"]:
        x, y, z = view["position_world"]
        heading = np.rad2deg(view["yaw_rad"]) % 360.0
        lines.append(
            f"  {view['round_index'] + 1:<7}{view['drone_id']:<12}"
            f"{_metres(x)}{_metres(y)}{_metres(z)}{heading:8.0f}°"
        )
    return "\n".join(lines)


def _metres(value: float) -> str:
    return f"{round(value, 2) + 0.0:8.2f}"  # Adding zero makes -0.00 positive.


def _enough_words(enough: Mapping[str, Any]) -> str:
    share = f"{enough['share']:.0%} of the boxes' surface seen at least once"
    if enough["needed"] is None:
        return f"{share}: {enough['most']} pictures are proven too few"
    if enough["sufficient"] is None:
        return f"{share}: not found with {enough['most']} pictures, not proven impossible either"
    return f"{share}: {enough['sufficient']} pictures do, {enough['needed']} at least"


@contextmanager
def _client(url: str) -> Iterator[httpx.Client]:
    """Talk to a console; raises in one line when none answers or there is no token."""
    token = os.environ.get("DRONERF_TOKEN", "")
    if not token or not all("!" <= character <= "~" for character in token):
        raise SettingsError("DRONERF_TOKEN must hold the token of the running console")
    headers = {"Authorization": f"Bearer {token}"}
    try:
        with httpx.Client(base_url=url, headers=headers, timeout=30.0) as client:
            yield client
    except (httpx.TransportError, httpx.InvalidURL, json.JSONDecodeError) as error:
        raise StartError(f"no console answers at {url}: {error}") from error


def _refused(answer: httpx.Response) -> int:
    print(f"dronerf: {_problem(answer)}", file=sys.stderr)
    return 2 if answer.status_code in (401, 404, 422) else 1


def _problem(answer: httpx.Response) -> str:
    """Return in one line what a console, or whatever else answers there, says is wrong."""
    try:
        problem = answer.json()
    except json.JSONDecodeError:
        problem = None
    if not isinstance(problem, dict):
        return f"{answer.url} is no console, it answers {answer.status_code}"
    faults = [
        f"{e['field'].removeprefix('body.')}: {e['detail']}" for e in problem.get("errors", [])
    ]
    return "; ".join(faults) or problem.get("detail") or str(answer.status_code)


def _size(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split("x"))
    except ValueError:
        x = y = z = 0.0
    if not all(0.0 < edge < 100.0 for edge in (x, y, z)):
        raise argparse.ArgumentTypeError(f"{text!r} is no size in metres, as 0.9x0.4x0.7")
    return x, y, z


def _percent(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 100.0:
        raise argparse.ArgumentTypeError(f"{text!r} is no percentage from above 0 to 100")
    return value
