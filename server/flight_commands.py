"""``dronerf record`` and ``dronerf replay``: the flight recorder from a shell."""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from contextlib import AsyncExitStack, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from server.app import SimulatedFleet, StartError, flying, real_fleet, simulated_fleet, stop_signal
from server.mission.flight_recording import FlightRecording
from server.recording.reading import RecordingError
from server.recording.repair import repair
from server.replay.flight import replay
from server.replay.report import ReplayResult
from server.settings import load_settings
from server.terminal import AddCommand, fleet_size, seconds, seed


def add_flight_commands(commands: Any, add: AddCommand) -> None:
    """Add both commands to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "record", run_record, "record drones that nobody flies, until Ctrl-C")
    source = part.add_mutually_exclusive_group()
    source.add_argument("--fleet", type=Path, help="fleet.toml of real drones")
    source.add_argument("--sim", metavar="SCENE", help="simulate: a scene's name or file")
    part.add_argument("--drones", type=fleet_size, default=4, help="1 to 8 (4)")
    part.add_argument("--seed", type=seed, default=0, help="seed of everything random (0)")
    part.add_argument("--out", type=Path, help="the file to make (recording-TIME.mcap)")
    part.add_argument("--seconds", type=seconds, help="end after so long")

    part = add(commands, "replay", run_replay, "send a recording through the pipeline again")
    part.add_argument("file", type=Path, help="the recording, as recording.mcap of a run folder")
    part.add_argument(
        "--speed",
        type=_speed,
        default=0.0,
        help="1: as fast as it was recorded; 0: as fast as possible (0)",
    )
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_record(arguments: argparse.Namespace) -> int:
    """Record what drones send until interrupted."""
    return asyncio.run(_record(arguments))


async def _record(arguments: argparse.Namespace) -> int:
    settings = load_settings()
    stamp = datetime.now(UTC).strftime("%Y%m%d-%H%M%S")
    path: Path = arguments.out or Path(f"recording-{stamp}.mcap")
    stop = stop_signal()
    async with AsyncExitStack() as stack:
        if arguments.fleet is not None:
            fleet_config = real_fleet(arguments.fleet)
        else:
            wanted = SimulatedFleet(arguments.sim or "robot_dog", arguments.drones, arguments.seed)
            fleet_config = (await stack.enter_async_context(simulated_fleet(wanted))).fleet
        # No capture will be flown: only this recording is made.
        quiet = settings.model_copy(
            update={"recording": replace(settings.recording, enabled=False)}
        )
        control, _ = await stack.enter_async_context(flying(quiet, fleet_config))
        recording = FlightRecording(path, control.scenery(), settings.recording)
        try:
            await stack.enter_async_context(recording)
        except OSError as error:
            raise StartError(f"{path}: {error.strerror or error}") from error
        print(f"Recording to {path}; press Ctrl-C to end.", file=sys.stderr, flush=True)
        with suppress(TimeoutError):
            await asyncio.wait_for(_stopped_or_ended(stop, recording), arguments.seconds)
    state = recording.state
    print(json.dumps({"file": str(path), "messages": state.messages, "dropped": state.dropped}))
    if state.ended is not None:
        print(f"dronerf: recording ended: {state.ended}", file=sys.stderr)
        return 1
    return 0


async def _stopped_or_ended(stop: asyncio.Event, recording: FlightRecording) -> None:
    while not stop.is_set() and recording.state.ended is None:  # noqa: ASYNC110
        await asyncio.sleep(0.1)


def run_replay(arguments: argparse.Namespace) -> int:
    """Send a recording through the pipeline and print what came out."""
    shown_s = -10.0

    def show(at_s: float) -> None:
        nonlocal shown_s
        if at_s - shown_s >= 1.0:
            shown_s = at_s
            print(f"\r{at_s:7.0f} s", end="", file=sys.stderr, flush=True)

    try:
        if arguments.file.is_file():
            repair(arguments.file)
        result = asyncio.run(replay(arguments.file, arguments.speed, show))
    except RecordingError as error:
        raise StartError(str(error)) from error
    except OSError as error:
        raise StartError(f"{arguments.file}: {error.strerror or error}") from error
    print(file=sys.stderr)
    print(json.dumps(result.as_json()) if arguments.json else _table(result))
    return 0


def _table(result: ReplayResult) -> str:
    """Return a replay's result for people."""
    content = result.as_json()
    lines = [f"{'file':<16}{content['file']}", f"{'seconds':<16}{content['seconds']}"]
    for drone_id, tally in content["drones"].items():
        lines.append(drone_id)
        lines += [f"  {key:<20}{value}" for key, value in tally.items()]
    if content["seed"] is not None:
        volume = content["seed"]["volume_m3"]
        lines.append(f"{'seed':<16}{content['seed']['views']} views, {volume:.4f} m3")
    if content["plan"] is not None:
        lines.append(f"{'plan':<16}fitness {content['plan']['fitness']:.6f}")
    lines += [f"{'remark':<16}{remark}" for remark in content["remarks"]]
    lines.append(f"{'digest':<16}{content['digest']}")
    return "\n".join(lines)


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = -1.0
    if not 0.0 <= speed <= 1000.0:
        raise argparse.ArgumentTypeError("must be a number from 0 to 1000")
    return speed
