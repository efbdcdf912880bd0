"""A whole capture in virtual time, and where each of its pictures was truly taken.

Driver, safety, pilot and mission are those that fly real drones. The pictures hold nothing yet:
``poses_pictures`` draws them afterwards, at the true poses, and only those that were kept.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.bench.missions.inline_jobs import InlineRunner
from server.bench.missions.virtual_sight import (
    FPS,
    SightErrors,
    VirtualCamera,
    VirtualDecoder,
    VirtualEye,
    hull_points,
)
from server.geometry.cameras import Intrinsics
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import EventStream
from server.nerf.flight import read_pictures
from server.planner.config import PlannerConfig
from server.sim.air import AirLink
from server.sim.camera import CameraMotion
from server.sim.config import SimConfig, fleet_config
from server.sim.scenes.catalogue import load_object
from server.sim.tello import Tello
from server.sim.virtual_time import in_virtual_time
from server.stages import Frame
from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig

Array = NDArray[np.float64]

_LONGEST_FLIGHT_S = 900.0


@dataclass(frozen=True, slots=True, eq=False)
class TrueView:
    """The truth about one picture.

    Attributes:
        T_world_cam: True pose ``(4, 4)`` of the picture's middle row.
        motion: How the camera moved meanwhile.
        lens: The camera's true intrinsics.
        others: True position ``(3,)`` and heading of every other drone.
    """

    T_world_cam: Array
    motion: CameraMotion
    lens: Intrinsics
    others: tuple[tuple[Array, float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class FlownCapture:
    """What a flight has left.

    Attributes:
        run: The run folder; its pictures hold nothing yet.
        truth: One per line of the run's list of pictures.
        sim: What was simulated.
    """

    run: Path
    truth: tuple[TrueView, ...]
    sim: SimConfig


def fly_capture(scene: str, seed: int, pictures: int, folder: Path) -> FlownCapture:
    """Fly a capture of ``pictures`` stills into a run below ``folder``.

    Raises:
        SceneError: If the scene does not exist.
        RuntimeError: If the flight took fewer than eight stills.
    """
    sim = SimConfig(scene=scene, seed=seed)
    return in_virtual_time(_Flight(sim, pictures, folder).fly())


class _Flight:
    """One capture under way."""

    def __init__(self, sim: SimConfig, pictures: int, folder: Path) -> None:
        self._sim = sim
        self._pictures = pictures
        self._folder = folder
        self._tellos = {sim.drone_id(i): Tello(sim, i) for i in range(sim.drones)}
        self._cameras = {d: VirtualCamera(tello) for d, tello in self._tellos.items()}
        self._points = hull_points(np.asarray(load_object(sim.scene).vertices))
        self._views: dict[tuple[str, int], TrueView] = {}
        self._number_of: dict[tuple[str, float], int] = {}

    async def fly(self) -> FlownCapture:
        """Fly it."""
        loop, safety = asyncio.get_running_loop(), SafetyConfig()
        links = {
            d: AirLink(tello, camera=self._shooter(d), fps=FPS) for d, tello in self._tellos.items()
        }
        mission = replace(MissionConfig(), grounded_timeout_s=20.0)
        config = FlightConfig(mission, PlannerConfig(), VisionConfig(), safety)
        async with AsyncExitStack() as stack:
            fleet = Fleet(
                fleet_config(self._sim),
                safety,
                links=dict(links),
                clock=loop.time,
                decoder=self._decoder,
            )
            await stack.enter_async_context(fleet)
            control = Control(
                fleet,
                self._folder,
                config,
                EventStream(),
                make_eye=self._eye,
                runner=InlineRunner(hangs=False),
            )
            await stack.enter_async_context(control)
            request = CaptureRequest(
                pictures=self._pictures, train_seconds=0.0, seed=self._sim.seed
            )
            record = await control.start_capture(request)
            async with asyncio.timeout(_LONGEST_FLIGHT_S):
                record = await control.wait_for_capture(record.status.id)
        for link in links.values():
            link.end()
        run = Path(record.status.run)
        if record.status.images < 8:
            raise RuntimeError(f"the flight took {record.status.images} pictures only")
        return FlownCapture(run, self._truth_of(run), self._sim)

    def _truth_of(self, run: Path) -> tuple[TrueView, ...]:
        return tuple(
            self._views[p.drone_id, self._number_of[p.drone_id, p.at_s]] for p in read_pictures(run)
        )

    # -- truth --------------------------------------------------------------------------------

    def _shooter(self, drone_id: str) -> Callable[[float], list[bytes]]:
        count = 0

        def shoot(now_s: float) -> list[bytes]:
            nonlocal count
            self._views[drone_id, count] = self._view(drone_id)
            count += 1
            return self._cameras[drone_id].shoot(now_s)

        return shoot

    def _view(self, drone_id: str) -> TrueView:
        tello = self._tellos[drone_id]
        body = tello.airframe
        others = tuple(
            (np.array(rest.airframe.position), rest.airframe.yaw_rad)
            for other, rest in self._tellos.items()
            if other != drone_id
        )
        return TrueView(body.T_world_cam(), body.camera_motion(), tello.lens, others)

    def _decoder(self, drone_id: str, on_frame: Callable[[Frame], None]) -> VirtualDecoder:
        def noted(frame: Frame) -> None:
            number = int.from_bytes(frame.image_bgr.tobytes()[:4])
            self._number_of[drone_id, frame.captured_s] = number
            on_frame(frame)

        return VirtualDecoder(drone_id, noted)

    def _eye(self, drone: Drone) -> VirtualEye:
        number = list(self._cameras).index(drone.config.id)
        rng = np.random.default_rng([self._sim.seed, 100 + number])
        camera = self._cameras[drone.config.id]
        return VirtualEye(drone, camera, self._points, SightErrors(), rng)
