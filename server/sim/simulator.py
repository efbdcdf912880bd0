"""The simulator program: several Tellos on loopback, or in network namespaces, in one world.

It prints one line of JSON on stdout when it is ready and logs to stderr. SIGINT and SIGTERM end it.
Pictures are rendered one after the other in a worker thread, as fast as it manages but never faster
than the cap, and only for drones whose video is on. Lines on stdin are faults that happen now.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path

from server.sim.camera import canvas_intrinsics
from server.sim.config import SimConfig
from server.sim.drone import SimError, SimulatedDrone
from server.sim.faults import faults_help, parse_fault
from server.sim.scenes.catalogue import load_object
from server.sim.studio import PictureSource, Studio, WorldMaker
from server.sim.words import LEVELS
from server.sim.world import World, WorldError

_ORPHAN_CHECK_S = 1.0
_NAMESPACE_ADDRESS = "192.168.10.1"
_LONGEST_LINE = 4096
_BODIES_PERIOD_S = 0.1


def make_world(config: SimConfig) -> PictureSource:
    """Return the rendered world of a configuration; raises SceneError for a bad scene."""
    return World(
        load_object(config.scene),
        intrinsics=canvas_intrinsics(config.camera),
        supersample=config.supersample,
        seed=config.seed,
    )


async def run_simulator(
    config: SimConfig,
    *,
    maker: WorldMaker = make_world,
    announce: Callable[[str], None] = lambda line: print(line, flush=True),  # noqa: T201
    stop: asyncio.Event | None = None,
    faults_from: int | None = None,
) -> None:
    """Run the simulated drones until SIGINT, SIGTERM, ``stop`` or cancellation.

    Args:
        config: What to simulate.
        maker: Makes the world, in the worker thread.
        announce: Gets the one line that says that all is ready.
        stop: Ends the run when set; signals are then left to the caller.
        faults_from: File descriptor whose lines are faults that happen now.

    Raises:
        SimError: If an address cannot be used or the truth file cannot be written.
        SceneError: If the scene cannot be loaded.
    """
    ends = stop
    if ends is None:
        ends = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, ends.set)
    async with AsyncExitStack() as stack:
        drones = [SimulatedDrone(config, index) for index in range(config.drones)]
        studio = Studio(config, drones, maker)
        for drone in drones:
            await stack.enter_async_context(drone)
        stack.push_async_callback(studio.stop)
        await studio.start()
        announce(json.dumps(_ready_line(config)))
        if faults_from is not None:
            _listen(faults_from, drones)
        if config.truth_file is not None:
            bodies = asyncio.create_task(_write_bodies(config.truth_file, drones), name="bodies")
            stack.callback(bodies.cancel)
        waits = {
            asyncio.create_task(ends.wait(), name="sim stop"),
            asyncio.create_task(studio.ended(), name="sim studio"),
        }
        try:
            done, _ = await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in waits:
                task.cancel()
            await asyncio.gather(*waits, return_exceptions=True)


async def _write_bodies(truth_file: Path, drones: Sequence[SimulatedDrone]) -> None:
    """Write where every drone truly is, ten times a second, beside the truth of the pictures."""
    path = Path(f"{truth_file}.bodies")
    with path.open("a") as file:  # noqa: ASYNC230 - A line of a few hundred bytes.
        while True:
            bodies = {
                drone.drone_id: {
                    "position": drone.airframe.position.tolist(),
                    "phase": drone.airframe.phase,
                }
                for drone in drones
            }
            file.write(json.dumps({"t_monotonic": time.monotonic(), "bodies": bodies}) + "\n")
            file.flush()
            await asyncio.sleep(_BODIES_PERIOD_S)


def _listen(descriptor: int, drones: Sequence[SimulatedDrone]) -> None:
    """Have every line that comes from a file descriptor carried out on the event loop."""
    loop = asyncio.get_running_loop()

    def read() -> None:
        # Not through sys.stdin: its lock, held by a thread, would break the program's end.
        text = b""
        while data := os.read(descriptor, _LONGEST_LINE):
            *lines, text = (text + data).split(b"\n")
            text = text[:_LONGEST_LINE]
            for line in lines:
                try:
                    loop.call_soon_threadsafe(_take_line, line.decode("utf-8", "replace"), drones)
                except RuntimeError:
                    return  # The loop has ended.

    threading.Thread(target=read, name="faults", daemon=True).start()


def _take_line(line: str, drones: Sequence[SimulatedDrone]) -> None:
    """Let the fault of one line happen, or say in one line on stderr why it does not."""
    if not line.strip():
        return
    if line.strip() == "help":
        sys.stderr.write(faults_help() + "\n")
        return
    try:
        fault = parse_fault(line)
    except ValueError as error:
        sys.stderr.write(f"sim: {error}\n")
        return
    concerned = [drone for drone in drones if fault.concerns(drone.drone_id)]
    if not concerned:
        ids = ", ".join(drone.drone_id for drone in drones)
        sys.stderr.write(f"sim: there is no {fault.drone}, only {ids}\n")
    for drone in concerned:
        drone.inject(fault)


def _ready_line(config: SimConfig) -> dict[str, object]:
    return {
        "ready": True,
        "drones": [
            {
                "id": config.drone_id(index),
                "address": config.address(index),
                "azimuth_deg": config.azimuth_deg(index),
            }
            for index in range(config.drones)
        ],
        "fps_note": f"at most {config.fps_cap:g} pictures per second and drone,"
        " fewer where the machine is slower; a real Tello sends 30",
    }


async def _attached(config: SimConfig) -> None:
    """Run the simulator until it ends or its starting process is gone, however that died."""
    parent = os.getppid()
    running = asyncio.create_task(run_simulator(config, faults_from=0), name="simulator")
    while not running.done() and os.getppid() == parent:
        await asyncio.wait({running}, timeout=_ORPHAN_CHECK_S)
    if running.done():
        running.result()
        return
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the simulator from a command line; returns 2 when it cannot have what was asked for."""
    defaults = SimConfig()
    parser = argparse.ArgumentParser(
        prog="python -m server.sim.simulator", description="Simulated Tellos on loopback."
    )
    parser.add_argument("--scene", default=defaults.scene, help="name, or path of a .glb or .obj")
    parser.add_argument("--drones", type=int, default=defaults.drones)
    parser.add_argument("--address", help=f"of the first drone ({defaults.base_address})")
    parser.add_argument("--seed", type=int, default=defaults.seed)
    parser.add_argument(
        "--truth",
        type=Path,
        help="append true camera poses to this file, and where the drones are to FILE.bodies",
    )
    parser.add_argument("--supersample", type=int, default=defaults.supersample)
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="KIND[=AMOUNT][@START[+DURATION]][:DRONE-ID], e.g. loss=0.1 or reboot@40:drone-1",
    )
    parser.add_argument("--sdk", choices=LEVELS, default=defaults.sdk, help="text protocol")
    parser.add_argument(
        "--friendly-reads", action="store_true", help="answer reads with plain whole numbers"
    )
    parser.add_argument("--station", action="store_true", help="as in a network of others")
    parser.add_argument(
        "--namespace",
        action="append",
        default=[],
        metavar="NAME",
        help="network namespace of the next drone; all then have one address",
    )
    parser.add_argument(
        "--attached", action="store_true", help="end when the program that started this one ends"
    )
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    options = parser.parse_args(arguments)
    level = logging.WARNING if options.quiet else logging.INFO
    logging.basicConfig(stream=sys.stderr, level=level, format="sim: %(message)s")
    try:
        config = SimConfig(
            scene=options.scene,
            drones=options.drones,
            base_address=options.address
            or (_NAMESPACE_ADDRESS if options.namespace else defaults.base_address),
            seed=options.seed,
            truth_file=options.truth,
            supersample=options.supersample,
            faults=tuple(map(parse_fault, options.fault)),
            sdk=options.sdk,
            friendly_reads=options.friendly_reads,
            station=options.station,
            namespaces=tuple(options.namespace),
        )
        asyncio.run(_attached(config) if options.attached else run_simulator(config, faults_from=0))
    except (SimError, WorldError, ValueError, OSError) as error:
        sys.stderr.write(f"dronerf: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
