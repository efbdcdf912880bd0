"""The ``dronerf`` command line.

Data goes to stdout, logs to stderr; ``--json`` wherever there is a result. Exit codes: 0 done,
1 failed, 2 wrong usage or bad input.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AsyncExitStack, ExitStack
from ipaddress import IPv4Network
from pathlib import Path
from typing import Any

from server.app import (
    SimulatedFleet,
    SimulatorRefusedError,
    StartError,
    bind_port,
    bring_down,
    check_door,
    check_runs,
    console,
    flying,
    job_runner,
    real_fleet,
    simulated_fleet,
    stop_signal,
)
from server.console_commands import add_console_commands
from server.doctor.calibrate import CalibrateOptions, run_calibrate
from server.doctor.command import run_doctor
from server.doctor.config import LiveConfig
from server.doctor.examination import Subject
from server.doctor.scan import parse_subnet
from server.field_commands import add_field_commands
from server.flight_commands import add_flight_commands
from server.jobs.book import JobBook
from server.library_commands import add_library_commands
from server.mission.commands import CaptureRequest
from server.service_log import json_log
from server.settings import Settings, SettingsError, load_settings
from server.sim.words import LEVELS
from server.terminal import (
    SCENES,
    CaptureFollower,
    OneLineParser,
    count,
    fleet_size,
    metrics_table,
    port,
    seconds,
    seed,
)
from server.token_commands import add_token_commands


def main() -> int:
    """Parse the command line, run the command and return its exit code."""
    if sys.argv[1:2] == ["bench"]:
        return bench(sys.argv[2:])
    arguments = _parser().parse_args()
    logging.basicConfig(
        level=logging.DEBUG if arguments.verbose else logging.WARNING,
        format="%(asctime)s %(levelname)s %(name)s %(message)s",
        stream=sys.stderr,
    )
    command: Callable[[argparse.Namespace], int] = arguments.command
    try:
        return command(arguments)
    except SimulatorRefusedError:
        return 2
    except (StartError, SettingsError) as error:
        print(f"dronerf: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 1


def demo(arguments: argparse.Namespace) -> int:
    """Fly a whole simulated mission."""
    return asyncio.run(_demo(arguments))


async def _demo(arguments: argparse.Namespace) -> int:
    settings = load_settings(host=arguments.host, port=arguments.port, runs=arguments.runs)
    request = CaptureRequest(
        mode=arguments.mode,
        pictures=arguments.pictures,
        train_seconds=arguments.train_seconds,
        name=f"{Path(arguments.scene).stem} {arguments.mode}",
        seed=arguments.seed,
    )
    if arguments.pictures < arguments.drones:
        raise StartError(f"--pictures must be at least the number of drones, {arguments.drones}")
    check_runs(settings.runs)
    if not arguments.headless:
        check_door(settings)
    wanted = SimulatedFleet(
        arguments.scene,
        arguments.drones,
        arguments.seed,
        arguments.truth,
        faults=tuple(arguments.fault),
    )
    stop = stop_signal()
    started_s = time.monotonic()
    async with AsyncExitStack() as stack:
        sock = None if arguments.headless else bind_port(settings.host, settings.port)
        simulator = await stack.enter_async_context(simulated_fleet(wanted))
        fleet_config = simulator.fleet
        book = JobBook(await stack.enter_async_context(job_runner(settings)))
        stack.push_async_callback(book.close)  # After the landing: a training may take its time.
        control, fleet = await stack.enter_async_context(flying(settings, fleet_config, book))
        if sock is not None:
            address = await stack.enter_async_context(console(settings, control, fleet, sock, book))
            print(f"The console is at {address}", file=sys.stderr)
        stack.callback(CaptureFollower(control.events).start().stop)
        record = await control.start_capture(request)
        ended = asyncio.create_task(control.wait_for_capture(record.status.id))
        stopped = asyncio.create_task(stop.wait())
        await asyncio.wait({ended, stopped}, return_when=asyncio.FIRST_COMPLETED)
        if not ended.done():
            ended.cancel()
            await bring_down(control, fleet)
            return 1
        record = ended.result()
        if record.metrics is None:
            print(f"dronerf: {record.status.error or record.status.state}", file=sys.stderr)
            return 1
        result = {
            "run": record.status.run,
            "scene": arguments.scene,
            **{key: value for key, value in record.metrics.items() if key != "run"},
            "wall_s": round(time.monotonic() - started_s, 1),
        }
        print(json.dumps(result) if arguments.json else metrics_table(result), flush=True)
        if sock is not None and not stop.is_set():
            print("The console stays up; press Ctrl-C to end.", file=sys.stderr)
            await stopped
            await bring_down(control, fleet)
        stopped.cancel()
        return 0


def serve(arguments: argparse.Namespace) -> int:
    """Run the console."""
    settings = load_settings(host=arguments.host, port=arguments.port, runs=arguments.runs)
    with ExitStack() as stack:
        if settings.log == "json":
            stack.enter_context(json_log(logging.DEBUG if arguments.verbose else logging.INFO))
        return asyncio.run(_serve(arguments, settings))


async def _serve(arguments: argparse.Namespace, settings: Settings) -> int:
    if arguments.fleet is not None and arguments.fault:
        raise StartError("--fault is for simulated drones, so not with --fleet")
    check_runs(settings.runs)
    check_door(settings)
    stop = stop_signal()
    async with AsyncExitStack() as stack:
        if arguments.fleet is not None:
            fleet_config = real_fleet(arguments.fleet)
            sock = bind_port(settings.host, settings.port)
        else:
            sock = bind_port(settings.host, settings.port)
            wanted = SimulatedFleet(
                arguments.sim or "robot_dog",
                arguments.drones,
                arguments.seed,
                faults=tuple(arguments.fault),
            )
            fleet_config = (await stack.enter_async_context(simulated_fleet(wanted))).fleet
        book = JobBook(await stack.enter_async_context(job_runner(settings)))
        stack.push_async_callback(book.close)  # After the landing: a training may take its time.
        control, fleet = await stack.enter_async_context(
            flying(settings, fleet_config, book, arguments.fleet)
        )
        address = await stack.enter_async_context(console(settings, control, fleet, sock, book))
        print(f"The console is at {address}", file=sys.stderr, flush=True)
        await stop.wait()
        await bring_down(control, fleet)
    return 0


def sim(arguments: argparse.Namespace) -> int:
    """Run only the simulated Tellos, until interrupted."""
    command = [sys.executable, "-P", "-m", "server.sim.simulator", "--scene", arguments.scene]
    command += ["--drones", str(arguments.drones), "--seed", str(arguments.seed)]
    if arguments.address is not None:
        command += ["--address", arguments.address]
    if arguments.truth is not None:
        command += ["--truth", str(arguments.truth)]
    for fault in arguments.fault:
        command += ["--fault", fault]
    for namespace in arguments.namespace:
        command += ["--namespace", namespace]
    command += ["--sdk", arguments.sdk]
    if arguments.friendly_reads:
        command.append("--friendly-reads")
    if arguments.station:
        command.append("--station")
    os.execv(sys.executable, command)


def doctor(arguments: argparse.Namespace) -> int:
    """Say what is wrong with this set-up and what to do about it."""
    return asyncio.run(_doctor(arguments))


async def _doctor(arguments: argparse.Namespace) -> int:
    try:
        runs = load_settings(runs=arguments.runs).runs
    except SettingsError:
        runs = arguments.runs or Path("runs")  # Reported as a finding with the others.
    async with AsyncExitStack() as stack:
        fleet_config = None
        if arguments.fleet is not None:
            fleet_config = real_fleet(arguments.fleet)
        elif arguments.sim:
            wanted = SimulatedFleet("robot_dog", arguments.drones)
            fleet_config = (await stack.enter_async_context(simulated_fleet(wanted))).fleet
        return await run_doctor(Subject(fleet_config, runs), arguments.scan, arguments.json)


def calibrate(arguments: argparse.Namespace) -> int:
    """Work out a camera's intrinsics from views of a board."""
    return asyncio.run(_calibrate(arguments))


async def _calibrate(arguments: argparse.Namespace) -> int:
    source = arguments.drone or arguments.pictures or arguments.board_image
    if source is None:
        raise StartError("what from? --drone ID (live), --pictures FOLDER, or --board-image FILE")
    options = CalibrateOptions(
        board=arguments.board,
        pictures=arguments.pictures,
        drone_id=arguments.drone or "",
        fleet=arguments.fleet,
        out=arguments.out,
        out_dir=arguments.out_dir,
        board_image=arguments.board_image,
        as_json=arguments.json,
        live=LiveConfig(views=arguments.views),
    )
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()

    def on_signal() -> None:
        # The views so far are used; a second Ctrl-C ends the program.
        stop.set()
        loop.remove_signal_handler(signal.SIGINT)

    if arguments.pictures is None:
        loop.add_signal_handler(signal.SIGINT, on_signal)
    return await run_calibrate(options, stop)


def bench(arguments: list[str]) -> int:
    """Run one measurement as a child process, which knows its own options."""
    return subprocess.call([sys.executable, "-P", "-m", "server.bench", *arguments])


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="dronerf", description="Operator console for drone-captured radiance fields."
    )
    parser.add_argument("--verbose", action="store_true", help="log everything to stderr")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    part = _command(commands, "demo", demo, "four simulated drones, a whole mission, the console")
    part.add_argument("--scene", default="robot_dog", help=SCENES)
    part.add_argument(
        "--mode",
        choices=("optimized", "standard"),
        default="optimized",
        help="planned viewpoints, or the fixed ring (optimized)",
    )
    _drones(part)
    part.add_argument("--pictures", type=count, default=24, help="pictures in all (24)")
    part.add_argument(
        "--train-seconds", type=seconds, default=60.0, help="training of the judged field (60)"
    )
    part.add_argument("--headless", action="store_true", help="no console; end after the mission")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")
    part.add_argument("--truth", type=Path, help="write the simulator's true poses to this file")
    _faults(part)
    _where(part)

    part = _command(commands, "serve", serve, "the console for real or simulated drones")
    source = part.add_mutually_exclusive_group()
    source.add_argument("--fleet", type=Path, help="fleet.toml of real drones")
    source.add_argument("--sim", metavar="SCENE", help=f"simulate: {SCENES} (robot_dog)")
    _drones(part)
    _faults(part)
    _where(part)

    part = _command(commands, "sim", sim, "only the simulated Tellos")
    part.add_argument("--scene", default="robot_dog", help=SCENES)
    _drones(part)
    part.add_argument("--address", help="address of the first (127.0.1.1)")
    part.add_argument("--truth", type=Path, help="write true poses to this file")
    part.add_argument("--sdk", choices=LEVELS, default="3.0", help="text protocol (3.0)")
    part.add_argument("--friendly-reads", action="store_true", help="plain whole numbers")
    part.add_argument(
        "--station", action="store_true", help="drones in a network of others (asked for `ap`)"
    )
    part.add_argument(
        "--namespace", action="append", default=[], metavar="NAME", help="of the next drone"
    )
    _faults(part)

    add_console_commands(commands, _command)
    add_field_commands(commands, _command)

    part = _command(commands, "doctor", doctor, "what is wrong with this set-up, and what to do")
    source = part.add_mutually_exclusive_group()
    source.add_argument("--fleet", type=Path, help="fleet.toml of the drones to look at")
    source.add_argument("--sim", action="store_true", help="look at simulated drones")
    part.add_argument("--drones", type=fleet_size, default=4, help="of them, 1 to 8 (4)")
    part.add_argument(
        "--scan",
        type=_subnet,
        metavar="SUBNET",
        help="ask every address of a subnet like 192.168.1.0/24 for drones, first",
    )
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")
    part.add_argument("--json", action="store_true", help="print the findings as one JSON object")

    part = _command(commands, "calibrate", calibrate, "camera intrinsics from views of a board")
    part.add_argument("--drone", metavar="ID", help="whose camera; without --pictures: live")
    part.add_argument("--fleet", type=Path, help="fleet.toml that says how to reach it")
    part.add_argument("--pictures", type=Path, metavar="FOLDER", help="use pictures, not a stream")
    part.add_argument(
        "--board",
        default="charuco:7x5:38:28",
        help="charuco:COLUMNSxROWS:SQUARE:MARKER (squares, mm) or chessboard:COLUMNSxROWS:SQUARE"
        " (inner corners, mm) (charuco:7x5:38:28)",
    )
    part.add_argument("--views", type=count, default=25, help="views to collect live (25)")
    part.add_argument("--out", type=Path, help="fleet.toml to write the intrinsics into")
    part.add_argument("--out-dir", type=Path, metavar="DIR", help="folder for coverage.png")
    part.add_argument(
        "--board-image", type=Path, metavar="FILE", help="write the board as .png or .pdf, and end"
    )
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")

    add_flight_commands(commands, _command)
    add_library_commands(commands, _command)
    add_token_commands(commands, _command)

    # Listed here, but its options are the child's own: main hands them on as they are.
    part = commands.add_parser("bench", help="the measurements; see `dronerf bench --help`")
    part.set_defaults(command=lambda _: bench([]))
    return parser


def _command(commands: Any, name: str, run: Any, text: str) -> argparse.ArgumentParser:
    part = commands.add_parser(name, help=text, description=f"dronerf {name}: {text}.")
    part.set_defaults(command=run)
    return part


def _subnet(text: str) -> IPv4Network:
    try:
        return parse_subnet(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _drones(part: argparse.ArgumentParser) -> None:
    part.add_argument("--drones", type=fleet_size, default=4, help="1 to 8 (4)")
    part.add_argument("--seed", type=seed, default=0, help="seed of everything random (0)")


def _faults(part: argparse.ArgumentParser) -> None:
    part.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="KIND[=AMOUNT][@START[+DURATION]][:DRONE-ID], e.g. loss=0.1 (repeatable)",
    )


def _where(part: argparse.ArgumentParser) -> None:
    part.add_argument("--host", help="address to listen on (127.0.0.1)")
    part.add_argument("--port", type=port, help="port to listen on (8000)")
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")


if __name__ == "__main__":
    sys.exit(main())
