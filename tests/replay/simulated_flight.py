"""A short simulated capture with real pictures and real H.264, recorded; in virtual time."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from pathlib import Path

from server.mission.commands import CaptureRecord, CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import EventStream
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

FPS = 4.0
RECORDING = RecordingConfig(min_free_bytes=1 << 20)


class PromptDecoder:
    """Decodes at once, on the loop: virtual time does not wait for a decoder's thread."""

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


async def fly(
    runs: Path, scene: str = "recycle_bin", recording: RecordingConfig = RECORDING, seed: int = 3
) -> CaptureRecord:
    """Fly one round with four drones and return the capture's record."""
    sim = SimConfig(scene=scene, seed=seed)
    world = World(load_object(scene), seed=seed)
    links = {}
    for index in range(sim.drones):
        tello = Tello(sim, index)
        links[sim.drone_id(index)] = AirLink(tello, camera=camera_of(world, tello), fps=FPS)
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
            fleet, runs, config, EventStream(), runner=PromptRunner(), recording=recording
        )
        await stack.enter_async_context(control)
        started = await control.start_capture(
            CaptureRequest(pictures=4, train_seconds=0, name=scene)
        )
        record = await control.wait_for_capture(started.status.id)
    for link in links.values():
        link.end()
    world.close()
    return record
