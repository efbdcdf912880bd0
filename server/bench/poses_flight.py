"""A whole capture in virtual time, and where each of its pictures was truly taken.

Driver, safety, pilot and mission are those that fly real drones. The pictures hold nothing yet:
``poses_pictures`` draws them afterwards, at the true poses, and only those that were kept. A flight
that is given a ``Video`` shows its pictures to the mission's own eyes, which is far slower; without
it virtual eyes look up what there is to see.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

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
from server.mission.commands import CaptureRequest, Mode
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import EventStream, PlanFound, Subscription
from server.nerf.flight import FlightPicture, read_pictures
from server.planner.config import PlannerConfig
from server.sim.air import AirLink
from server.sim.camera import CameraMotion
from server.sim.config import SimConfig, fleet_config
from server.sim.scenes.catalogue import load_object
from server.sim.tello import Tello
from server.sim.virtual_time import in_virtual_time
from server.stages import Assignment, Frame, Viewpoint
from server.store.runs import RunFolder
from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig

Array = NDArray[np.float64]

_LONGEST_FLIGHT_S = 900.0
_FEWEST_STILLS = 8
_IN_THE_AIR = ("take_off", "centre", "seed", "plan", "fly", "tune", "capture", "land")


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


class Video(Protocol):
    """What the drones' cameras send."""

    def picture(self, drone_id: str, view: TrueView, at_s: float) -> NDArray[np.uint8]:
        """Return the picture ``(h, w, 3)`` BGR that a drone takes of a view at a time."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FlownCapture:
    """What a flight has left.

    Attributes:
        run: The run folder; its pictures hold nothing yet, or what the flight's ``Video`` showed.
        truth: One per line of the run's list of pictures.
        sent_to: Where each of them was to be taken, None for key frames.
        flight_s: Simulated seconds from take-off to landing.
        sim: What was simulated.
    """

    run: Path
    truth: tuple[TrueView, ...]
    sent_to: tuple[Viewpoint | None, ...]
    flight_s: float
    sim: SimConfig


def fly_capture(
    scene: str,
    seed: int,
    pictures: int,
    folder: Path,
    *,
    mode: Mode = "optimized",
    drones: int = 4,
    config: FlightConfig | None = None,
    make_video: Callable[[SimConfig], Video] | None = None,
) -> FlownCapture:
    """Fly a capture of ``pictures`` stills into a run below ``folder``.

    Args:
        scene: Name or file.
        seed: Of everything random.
        pictures: How many stills.
        folder: Where the run's folder goes.
        mode: The capture's.
        drones: How many fly.
        config: Numbers of everything that flies, None for the usual ones.
        make_video: Makes what the mission's own eyes look at; None: virtual eyes.

    Raises:
        SceneError: If the scene does not exist.
        RuntimeError: If the flight took fewer than eight stills.
    """
    sim = SimConfig(scene=scene, seed=seed, drones=drones)
    request = CaptureRequest(mode=mode, pictures=pictures, train_seconds=0.0, seed=seed)
    video = None if make_video is None else make_video(sim)
    flight = _Flight(sim, request, folder, config or usual_config(), video)
    return in_virtual_time(flight.fly())


def usual_config() -> FlightConfig:
    """Return the config of a flight where nobody says otherwise."""
    return FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())


class _Flight:
    """One capture under way."""

    def __init__(
        self,
        sim: SimConfig,
        request: CaptureRequest,
        folder: Path,
        config: FlightConfig,
        video: Video | None,
    ) -> None:
        self._sim = sim
        self._request = request
        self._folder = folder
        # Nobody will bring batteries: a grounded capture ends soon.
        self._config = replace(config, mission=replace(config.mission, grounded_timeout_s=20.0))
        self._video = video
        self._tellos = {sim.drone_id(i): Tello(sim, i) for i in range(sim.drones)}
        self._cameras = {d: VirtualCamera(tello) for d, tello in self._tellos.items()}
        self._points = hull_points(np.asarray(load_object(sim.scene).vertices))
        self._views: dict[tuple[str, int], TrueView] = {}
        self._number_of: dict[tuple[str, float], int] = {}
        self._assignment: Assignment | None = None

    async def fly(self) -> FlownCapture:
        """Fly it."""
        loop = asyncio.get_running_loop()
        links = {
            d: AirLink(tello, camera=self._shooter(d), fps=FPS) for d, tello in self._tellos.items()
        }
        events = EventStream()
        async with AsyncExitStack() as stack:
            news = stack.enter_context(events.subscribe())
            listening = asyncio.create_task(self._listen(news), name="plans")
            stack.callback(listening.cancel)
            fleet = Fleet(
                fleet_config(self._sim),
                self._config.safety,
                links=dict(links),
                clock=loop.time,
                decoder=self._decoder,
            )
            await stack.enter_async_context(fleet)
            control = Control(
                fleet,
                self._folder,
                self._config,
                events,
                make_eye=self._eye if self._video is None else None,
                runner=InlineRunner(hangs=False),
            )
            await stack.enter_async_context(control)
            record = await control.start_capture(self._request)
            async with asyncio.timeout(_LONGEST_FLIGHT_S):
                record = await control.wait_for_capture(record.status.id)
        for link in links.values():
            link.end()
        run = Path(record.status.run)
        if record.status.images < min(_FEWEST_STILLS, self._request.pictures):
            raise RuntimeError(
                f"the flight took {record.status.images} pictures only: {record.status.error}"
            )
        seconds = (RunFolder(run).state() or {}).get("seconds", {})
        pictures = read_pictures(run)
        return FlownCapture(
            run,
            tuple(self._views[p.drone_id, self._number_of[p.drone_id, p.at_s]] for p in pictures),
            tuple(self._sent_to(p) if p.still else None for p in pictures),
            sum(seconds.get(phase, 0.0) for phase in _IN_THE_AIR),
            self._sim,
        )

    async def _listen(self, news: Subscription) -> None:
        async for event in news:
            if isinstance(event, PlanFound):
                self._assignment = event.assignment

    def _sent_to(self, picture: FlightPicture) -> Viewpoint:
        """Return the planned viewpoint at which a picture was to be taken."""
        assert self._assignment is not None
        rounds = self._assignment.rounds
        if picture.round_index < len(rounds) and picture.drone_id in rounds[picture.round_index]:
            return rounds[picture.round_index][picture.drone_id]
        # Taken over from another drone: nothing tells whose it was but where the picture is.
        position = picture.T_world_cam[:3, 3]
        every = [view for row in rounds for view in row.values()]
        return min(every, key=lambda v: float(np.linalg.norm(v.position_world - position)))

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
            if self._video is not None:
                view = self._views[drone_id, number]
                image = self._video.picture(drone_id, view, frame.captured_s)
                frame = replace(frame, picture=image)
            on_frame(frame)

        return VirtualDecoder(drone_id, noted)

    def _eye(self, drone: Drone) -> VirtualEye:
        number = list(self._cameras).index(drone.config.id)
        rng = np.random.default_rng([self._sim.seed, 100 + number])
        camera = self._cameras[drone.config.id]
        return VirtualEye(drone, camera, self._points, SightErrors(), rng)
