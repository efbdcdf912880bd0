"""The simulator program: several Tellos on loopback in one rendered world.

It prints one line of JSON on stdout when it is ready and logs to stderr. SIGINT and SIGTERM end it.
Pictures are rendered one after the other in a worker thread, as fast as it manages but never faster
than the cap, and only for drones whose video is on.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
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
from typing import IO, Protocol

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.sim.config import SimConfig
from server.sim.drone import SimError, SimulatedDrone
from server.sim.encoder import VideoEncoder
from server.sim.scenes.catalogue import load_object
from server.sim.world import World, WorldError

_LOG = logging.getLogger(__name__)

_REPORT_PERIOD_S = 5.0
_NOBODY_LOOKS_S = 0.02
_ORPHAN_CHECK_S = 1.0


class PictureSource(Protocol):
    """What the simulator needs of a world."""

    def render(
        self,
        T_world_cam: NDArray[np.float64],
        other_drones: Sequence[tuple[NDArray[np.float64], float]] = (),
    ) -> NDArray[np.uint8]:
        """Return the BGR picture ``(720, 960, 3)`` of an OpenCV camera pose ``(4, 4)``."""
        ...

    def close(self) -> None:
        """Release what it holds."""
        ...


WorldMaker = Callable[[SimConfig], PictureSource]


def make_world(config: SimConfig) -> PictureSource:
    """Return the rendered world of a configuration; raises SceneError for a bad scene."""
    return World(
        load_object(config.scene),
        intrinsics=TELLO_INTRINSICS,
        supersample=config.supersample,
        seed=config.seed,
    )


class _Studio:
    """The worker thread: renders and encodes, drone after drone.

    The world is made, used and closed in this thread alone. The loop owns the drones; the thread
    only reads their poses, which are replaced as whole arrays, and hands datagrams back.
    """

    def __init__(
        self, config: SimConfig, drones: Sequence[SimulatedDrone], maker: WorldMaker
    ) -> None:
        self._config = config
        self._drones = drones
        self._maker = maker
        self._loop = asyncio.get_running_loop()
        self._ready: asyncio.Future[None] = self._loop.create_future()
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._closing = threading.Event()
        self._sent = dict.fromkeys((drone.drone_id for drone in drones), 0)
        self._thread = threading.Thread(target=self._run, name="studio", daemon=True)

    async def start(self) -> None:
        """Make the world; raises what its making raises."""
        self._thread.start()
        await self._ready

    async def ended(self) -> None:
        """Wait for the thread's end; raises what it failed of."""
        await asyncio.shield(self._ended)

    async def stop(self) -> None:
        """End the thread."""
        self._closing.set()
        await asyncio.to_thread(self._thread.join, 10.0)

    def _run(self) -> None:
        future = self._ready
        try:
            world = self._maker(self._config)
            try:
                self._settle(self._ready, None)
                future = self._ended
                with contextlib.ExitStack() as stack:
                    truth = self._config.truth_file
                    file = stack.enter_context(truth.open("a")) if truth is not None else None
                    self._work(world, file)
            finally:
                world.close()
            self._settle(self._ended, None)
        except Exception as error:  # noqa: BLE001  # Whatever it is, the loop must hear of it.
            self._settle(future, error)

    def _settle(self, future: asyncio.Future[None], error: Exception | None) -> None:
        def settle() -> None:
            if future.done():
                return
            if error is None:
                future.set_result(None)
            else:
                future.set_exception(error)

        with contextlib.suppress(RuntimeError):  # The loop has ended already.
            self._loop.call_soon_threadsafe(settle)

    def _work(self, world: PictureSource, truth: IO[str] | None) -> None:
        config = self._config
        encoders: dict[str, VideoEncoder] = {}
        due_s = dict.fromkeys(self._sent, 0.0)
        report_s = time.monotonic() + _REPORT_PERIOD_S
        while not self._closing.is_set():
            now_s = time.monotonic()
            if now_s >= report_s:
                self._report()
                report_s = now_s + _REPORT_PERIOD_S
            # Whoever has waited longest comes first: round-robin that skips dark cameras.
            waiting = [drone for drone in self._drones if drone.wants_pictures]
            drone = min(waiting, key=lambda drone: due_s[drone.drone_id], default=None)
            if drone is None or due_s[drone.drone_id] > now_s:
                wait_s = _NOBODY_LOOKS_S if drone is None else due_s[drone.drone_id] - now_s
                self._closing.wait(min(wait_s, _NOBODY_LOOKS_S))
                continue
            due_s[drone.drone_id] = max(due_s[drone.drone_id] + 1.0 / config.fps_cap, now_s)
            if drone.drone_id not in encoders:
                size = (TELLO_INTRINSICS.width, TELLO_INTRINSICS.height)
                encoders[drone.drone_id] = VideoEncoder(
                    *size, config.fps_cap, config.bitrate_kbit_s
                )
            self._shoot(drone, world, encoders[drone.drone_id], truth)

    def _shoot(
        self,
        drone: SimulatedDrone,
        world: PictureSource,
        encoder: VideoEncoder,
        truth: IO[str] | None,
    ) -> None:
        at_s = time.monotonic()
        T_world_cam = drone.airframe.T_world_cam()
        yaw_rad = drone.airframe.yaw_rad
        others = [
            (other.airframe.position.copy(), other.airframe.yaw_rad)
            for other in self._drones
            if other is not drone
        ]
        image_bgr = world.render(T_world_cam, others)
        key = drone.sdk.key_picture_due
        drone.sdk.key_picture_due = False
        datagrams = encoder.encode(image_bgr, at_s, key)
        if truth is not None:
            entry = {
                "t_monotonic": at_s,
                "drone_id": drone.drone_id,
                "position": T_world_cam[:3, 3].tolist(),
                "yaw": yaw_rad,
                "T_world_cam": T_world_cam.tolist(),
            }
            truth.write(json.dumps(entry) + "\n")
            truth.flush()
        self._sent[drone.drone_id] += 1
        with contextlib.suppress(RuntimeError):  # The loop has ended already.
            self._loop.call_soon_threadsafe(drone.send_video, datagrams)

    def _report(self) -> None:
        rates = {name: round(count / _REPORT_PERIOD_S, 1) for name, count in self._sent.items()}
        if any(rates.values()):
            _LOG.info("%s", json.dumps({"pictures_per_s": rates}))
        self._sent = dict.fromkeys(self._sent, 0)


async def run_simulator(
    config: SimConfig,
    *,
    maker: WorldMaker = make_world,
    announce: Callable[[str], None] = lambda line: print(line, flush=True),  # noqa: T201
    stop: asyncio.Event | None = None,
) -> None:
    """Run the simulated drones until SIGINT, SIGTERM, ``stop`` or cancellation.

    Args:
        config: What to simulate.
        maker: Makes the world, in the worker thread.
        announce: Gets the one line that says that all is ready.
        stop: Ends the run when set; signals are then left to the caller.

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
        studio = _Studio(config, drones, maker)
        for drone in drones:
            await stack.enter_async_context(drone)
        stack.push_async_callback(studio.stop)
        await studio.start()
        announce(json.dumps(_ready_line(config)))
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
    running = asyncio.create_task(run_simulator(config), name="simulator")
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
    parser.add_argument("--address", default=defaults.base_address, help="of the first drone")
    parser.add_argument("--seed", type=int, default=defaults.seed)
    parser.add_argument("--truth", type=Path, help="append true camera poses to this file")
    parser.add_argument("--supersample", type=int, default=defaults.supersample)
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
            base_address=options.address,
            seed=options.seed,
            truth_file=options.truth,
            supersample=options.supersample,
        )
        asyncio.run(_attached(config) if options.attached else run_simulator(config))
    except (SimError, WorldError, ValueError, OSError) as error:
        sys.stderr.write(f"dronerf: {error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
