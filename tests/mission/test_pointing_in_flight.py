"""A whole flight in virtual time whose eyes all begin with the wrong thing, until two picks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from server.bench.missions.inline_jobs import InlineRunner
from server.bench.missions.judge import SURFACE_POINTS, Body, Judge
from server.bench.missions.virtual_sight import (
    FPS,
    SightErrors,
    VirtualCamera,
    VirtualDecoder,
    VirtualEye,
    hull_points,
)
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import (
    CaptureTaken,
    EventStream,
    PlanFound,
    PrioritiesChanged,
    SeedFitted,
)
from server.planner.config import PlannerConfig
from server.sim.air import AirLink
from server.sim.config import SimConfig, fleet_config
from server.sim.scenes.catalogue import load_object
from server.sim.tello import Tello
from server.sim.virtual_time import in_virtual_time
from server.stages import Frame
from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig
from server.vision.region import RegionPrior

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]

SCENE, SEED = "recycle_bin", 3
# A second thing in the room, about as big as the object, off the middle.
DECOY = np.array([0.75, 0.55, 0.0])


class FullPicture:
    """A virtual picture that has the size of a real one."""

    def __init__(self, image_bgr: NDArray[np.uint8]) -> None:
        self._image_bgr = image_bgr

    @property
    def size_px(self) -> tuple[int, int]:
        return 960, 720

    def bgr(self) -> NDArray[np.uint8]:
        return self._image_bgr

    def reduced_bgr(self, width_px: int, height_px: int) -> NDArray[np.uint8]:
        return np.zeros((height_px, width_px, 3), np.uint8)


class FullDecoder(VirtualDecoder):
    """Decodes virtual pictures into such pictures."""

    def __init__(self, drone_id: str, on_frame: Callable[[Frame], None]) -> None:
        def full(frame: Frame) -> None:
            on_frame(replace(frame, picture=FullPicture(frame.image_bgr)))

        super().__init__(drone_id, full)


class MistakenEye(VirtualEye):
    """Holds on to the wrong thing until it is told; then to what is nearest to where it should be.

    That is what a tracker does: it follows what it has, and searches by its prior when it must.
    """

    def __init__(self, drone: Drone, camera: VirtualCamera, points: Array, number: int) -> None:
        rng = np.random.default_rng([SEED, number])
        # Which of two things is seen is the matter here. They stand a step apart: seen in part, or
        # as more than they are, one could not be told from the other.
        super().__init__(drone, camera, points + DECOY, SightErrors(extent=0.0), rng)
        self._mine, self._shot = drone, camera
        self._things = (points, points + DECOY)
        self._expected: RegionPrior | None = None

    def expect(self, prior: RegionPrior | None) -> None:
        self._expected = prior

    def point_out(self, xyxy_px: Array | None) -> None:
        wanted = None if self._expected is None else self._expected.centre_px
        if xyxy_px is not None:
            wanted = (xyxy_px[:2] + xyxy_px[2:]) / 2.0
        if wanted is not None:
            middles = [self.true_box(points)[0] for points in self._things]
            misses = [float(np.linalg.norm(middle - wanted)) for middle in middles]
            self._points = self._things[int(np.argmin(misses))]

    def true_box(self, points: Array) -> tuple[Array, Array]:
        """Return middle ``(2,)`` and box ``(4,)`` in pixels of what stands at ``points``."""
        assert self.sight is not None
        number = int.from_bytes(self.sight.frame.image_bgr.tobytes()[:4])
        T_world_cam = self._shot.pose_of(number)
        assert T_world_cam is not None
        pixels, depths = self._mine.config.intrinsics.project(points, T_world_cam)
        assert (depths > 0.0).all()
        lower, upper = pixels.min(axis=0), pixels.max(axis=0)
        return (lower + upper) / 2.0, np.concatenate([lower, upper])


class Flight:
    """One capture with an operator who looks at the pictures."""

    def __init__(self, runs: Path) -> None:
        sim = SimConfig(scene=SCENE, drones=4, seed=SEED)
        model = load_object(SCENE)
        self._runs, self._fleet_config = runs, fleet_config(sim)
        self._points = hull_points(np.asarray(model.vertices))
        self._tellos = {sim.drone_id(i): Tello(sim, i) for i in range(4)}
        self._cameras = {d: VirtualCamera(tello) for d, tello in self._tellos.items()}
        self._eyes: dict[str, MistakenEye] = {}
        surface = np.asarray(model.trimesh.sample(SURFACE_POINTS, seed=SEED), np.float64)
        things = np.concatenate([surface, surface + DECOY])
        self.judge = Judge(things, SafetyConfig())
        self.believed_before = np.zeros(3)
        self.state, self.images = "", 0
        self.seed: SeedFitted | None = None
        self.plans = 0
        self.parts: PrioritiesChanged | None = None

    def _eye(self, drone: Drone) -> MistakenEye:
        drone_id = drone.config.id
        eye = MistakenEye(drone, self._cameras[drone_id], self._points, len(self._eyes))
        self._eyes[drone_id] = eye
        return eye

    async def fly(self) -> None:
        links = {
            d: AirLink(tello, camera=self._cameras[d].shoot, fps=FPS)
            for d, tello in self._tellos.items()
        }
        safety = SafetyConfig()
        mission = replace(MissionConfig(), grounded_timeout_s=20.0)
        config = FlightConfig(mission, PlannerConfig(), VisionConfig(), safety)
        clock = asyncio.get_running_loop().time
        async with AsyncExitStack() as stack:
            fleet = await stack.enter_async_context(
                Fleet(
                    self._fleet_config, safety, links=dict(links), clock=clock, decoder=FullDecoder
                )
            )
            control = Control(
                fleet,
                self._runs,
                config,
                EventStream(),
                make_eye=self._eye,
                runner=InlineRunner(hangs=False),
            )
            await stack.enter_async_context(control)
            watch = asyncio.create_task(self._watch())
            news = asyncio.create_task(self._listen(control))
            request = CaptureRequest(pictures=12, train_seconds=0.0, seed=SEED)
            record = await control.start_capture(request)
            operator = asyncio.create_task(self._operate(control, fleet))
            async with asyncio.timeout(600.0):
                record = await control.wait_for_capture(record.status.id)
            await operator
            self.state = record.status.state
            found = (event for event in control.standing() if isinstance(event, SeedFitted))
            self.seed = next(found, None)
            self.images = record.status.images
            for task in (watch, news):
                task.cancel()
            ends = await asyncio.gather(watch, news, return_exceptions=True)
            assert all(isinstance(end, asyncio.CancelledError) for end in ends), ends
        for link in links.values():
            link.end()

    async def _operate(self, control: Control, fleet: Fleet) -> None:
        """Once all fly and look at something, pick the object on two neighbouring tiles."""
        while not all(d.activity == "flying" for d in fleet.drones.values()):  # noqa: ASYNC110
            await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)
        self.believed_before = control._pilot.target().centre.copy()
        for drone_id in ("drone-1", "drone-2"):
            control.point_out(drone_id, self._drawn(drone_id))
            await asyncio.sleep(0.5)

    def _drawn(self, drone_id: str) -> tuple[float, float, float, float]:
        """Return the box that an operator would draw around the object in a drone's picture."""
        _, box_px = self._eyes[drone_id].true_box(self._points)
        shares = np.clip(box_px / [960.0, 720.0, 960.0, 720.0], 0.0, 1.0)
        left, top, right, bottom = (float(share) for share in shares)
        return left, top, right, bottom

    async def _listen(self, control: Control) -> None:
        """After the first picture, mark the upper half of the object as one drone sees it."""
        with control.events.subscribe(4096) as news:
            async for event in news:
                match event:
                    case PlanFound():
                        self.plans += 1
                    case PrioritiesChanged():
                        self.parts = event
                    case CaptureTaken() if self.parts is None:
                        left, top, right, bottom = self._drawn("drone-3")
                        upper_half = (left, top, right, (top + bottom) / 2.0)
                        control.add_priority("drone-3", upper_half, 5.0)
                    case _:
                        pass

    async def _watch(self) -> None:
        while True:
            self.judge.observe(
                {
                    d: Body(np.asarray(t.airframe.position), t.airframe.phase != "standing")
                    for d, t in self._tellos.items()
                }
            )
            await asyncio.sleep(0.1)


def test_picks_bring_all_drones_to_the_right_object_and_a_part_is_planned_for(
    tmp_path: Path,
) -> None:
    flight = Flight(tmp_path)
    in_virtual_time(flight.fly())
    # Before, the wrong thing had drawn what the mission believed away from the object.
    assert np.linalg.norm(flight.believed_before[:2]) > 0.35
    assert flight.state == "succeeded"
    assert flight.seed is not None
    # Poses that the wrong thing has drawn along stay so: what is believed of the right one is
    # shifted with them, but by less than half way.
    assert np.linalg.norm(flight.seed.seed.outer.centre[:2]) < np.linalg.norm(DECOY) / 2.0
    # The part that was marked on the way is on the object, and what was left was planned anew.
    assert flight.parts is not None
    box = flight.parts.parts[0].box
    assert box is not None
    assert flight.seed.seed.outer.grown(0.02).contains(box.corners).all()
    assert flight.plans == 2
    assert flight.images == 12
    judgement = flight.judge.judgement
    assert judgement.fence_violations == 0
    assert judgement.collisions == 0
