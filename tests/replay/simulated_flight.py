"""A short simulated capture with real pictures and real H.264, recorded; in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.mission.commands import CaptureRecord, CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import CaptureTaken, EventStream
from server.planner.config import PlannerConfig
from server.recording.config import RecordingConfig
from server.replay.prompt_jobs import PromptRunner
from server.sim.air import AirLink
from server.sim.config import SimConfig, fleet_config
from server.sim.encoder import VideoEncoder
from server.sim.scenes.catalogue import load_object
from server.sim.tello import Tello
from server.sim.world import World
from server.swarm.access_units import AccessUnits
from server.swarm.config import SafetyConfig
from server.swarm.fleet import Fleet
from server.swarm.unit_decoder import UnitDecoder
from server.vision.config import VisionConfig

Shares = tuple[float, float, float, float]

FPS = 4.0
# Where the operator takes the object to be at first.
BESIDE_M = np.array([0.0, 0.6, 0.0])
RECORDING = RecordingConfig(min_free_bytes=1 << 20)


class PromptDecoder:
    """Decodes at once, on the loop: virtual time does not wait for a decoder's thread."""

    overflows = 0

    def __init__(self, drone_id, on_frame):
        self._units = AccessUnits()
        self._decoder = UnitDecoder(drone_id)
        self._on_frame = on_frame

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        pass

    def feed(self, datagram, arrived_s):
        for unit in self._units.feed(datagram, arrived_s):
            for frame in self._decoder.decode(unit):
                self._on_frame(frame)


def camera_of(world: World, tello: Tello):
    encoder = VideoEncoder(world.intrinsics.width, world.intrinsics.height, 30.0, 2500)

    def shoot(now_s: float) -> list[bytes]:
        return encoder.encode(world.render(tello.airframe.T_world_cam()), now_s)

    return shoot


class Operator:
    """Points beside the object, mends that, and later marks a part of it."""

    def __init__(self, control: Control, tellos: dict[str, Tello], points: NDArray[np.float64]):
        self._control = control
        self._tellos = tellos
        self._points = points

    async def point_out(self) -> None:
        """Once all are up, point out a wrong place on a tile, then the object on two."""
        while not all(d.activity == "flying" for d in self._control.drones()):  # noqa: ASYNC110
            await asyncio.sleep(0.05)
        # A recording knows what a drone does by its next report.
        await asyncio.sleep(0.5)
        self._control.point_out("drone-1", self._drawn("drone-1", self._points + BESIDE_M))
        await asyncio.sleep(1.0)
        for drone_id in ("drone-1", "drone-2"):
            self._control.point_out(drone_id, self._drawn(drone_id, self._points))

    async def mark_part(self) -> None:
        """After the first picture, mark the upper half of the object on a tile."""
        with self._control.events.subscribe(4096) as news:
            async for event in news:
                if isinstance(event, CaptureTaken):
                    left, top, right, bottom = self._drawn("drone-3", self._points)
                    upper_half = (left, top, right, (top + bottom) / 2.0)
                    self._control.add_priority("drone-3", upper_half, 5.0)
                    return

    def _drawn(self, drone_id: str, points: NDArray[np.float64]) -> Shares:
        T_world_cam = self._tellos[drone_id].airframe.T_world_cam()
        pixels, _ = TELLO_INTRINSICS.project(points, T_world_cam)
        shares = np.clip(pixels / [TELLO_INTRINSICS.width, TELLO_INTRINSICS.height], 0.0, 1.0)
        (left, top), (right, bottom) = shares.min(axis=0).tolist(), shares.max(axis=0).tolist()
        return left, top, right, bottom


async def fly(runs: Path, scene: str = "recycle_bin", seed: int = 3) -> CaptureRecord:
    """Fly two rounds with four drones and an operator; return the capture's record."""
    sim = SimConfig(scene=scene, seed=seed)
    model = load_object(scene)
    world = World(model, seed=seed)
    tellos = {sim.drone_id(index): Tello(sim, index) for index in range(sim.drones)}
    links = {
        drone_id: AirLink(tello, camera=camera_of(world, tello), fps=FPS)
        for drone_id, tello in tellos.items()
    }
    config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
    async with AsyncExitStack() as stack:
        fleet = Fleet(
            fleet_config(sim),
            links=dict(links),
            clock=asyncio.get_running_loop().time,
            decoder=PromptDecoder,
        )
        await stack.enter_async_context(fleet)
        control = Control(
            fleet, runs, config, EventStream(), runner=PromptRunner(), recording=RECORDING
        )
        await stack.enter_async_context(control)
        started = await control.start_capture(
            CaptureRequest(pictures=8, train_seconds=0, name=scene)
        )
        operator = Operator(control, tellos, np.asarray(model.vertices))
        async with asyncio.TaskGroup() as work:
            work.create_task(operator.point_out())
            work.create_task(operator.mark_part())
            record = await control.wait_for_capture(started.status.id)
    for link in links.values():
        link.end()
    world.close()
    return record
