"""Every round's pictures refine the seed geometry; the outer box and the priorities stay."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.mission.events import EventStream, SeedFitted
from server.mission.eyes import Sight
from server.mission.phases import Phase, Progress
from server.mission.state import MissionState
from server.mission.steps import Steps
from server.planner.config import PlannerConfig
from server.stages import Assignment, CameraPose, Frame, Priority, Region, View, Viewpoint
from server.vision.box import box_from_region
from server.vision.config import SeedConfig
from server.vision.seed import seed_from_views

OBJECT = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.6]))
DRONES = ("a", "b", "c", "d")
CONFIG = SeedConfig(voxels=24)
PICTURE = np.zeros((2, 2, 3), np.uint8)


def view(drone_id: str, azimuth: float) -> View:
    position = np.array([1.9 * np.cos(azimuth), 1.9 * np.sin(azimuth), 0.8])
    T = camera_pose(position, azimuth + np.pi, TELLO_TILT_RAD)
    pixels, _ = TELLO_INTRINSICS.project(OBJECT.corners, T)
    mask = np.zeros((180, 240), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(pixels / 4.0).astype(np.int32)), 1)
    region = Region(np.zeros(2), 1.0, 1.0, mask > 0, 4.0, 1.0)
    pose = CameraPose(drone_id, 0.0, T, np.eye(4) * 1e-4)
    return View(pose, TELLO_INTRINSICS, box_from_region(region, 960, 720), region)


class Rig:
    """Steps whose drones hover ``turn`` radians on from where the seed views were taken."""

    def __init__(self, turn: float, *, damaged: bool = False, seen: bool = True) -> None:
        first = [view(d, k * np.pi / 2.0) for k, d in enumerate(DRONES)]
        later = {d: view(d, k * np.pi / 2.0 + turn) for k, d in enumerate(DRONES)}
        self.state = MissionState(DRONES, list(DRONES), Progress.start(1), pictures=4)
        self.state.seed = seed_from_views(first, CONFIG)
        self.state.views.extend(first)
        viewpoints = {d: Viewpoint(v.pose.position_world, 0.0) for d, v in later.items()}
        self.state.assignment = Assignment((viewpoints,))
        self.events = EventStream()
        self.pilot = SimpleNamespace(pose=lambda d, _: later[d].pose, seed=self.state.seed)
        drone = SimpleNamespace(config=SimpleNamespace(intrinsics=TELLO_INTRINSICS))
        frame = Frame("x", 1, 0.0, PICTURE, damaged)

        async def take_all(*_: object) -> list[str]:
            await asyncio.sleep(0)
            photographer.taken = len(DRONES)
            return []

        photographer = SimpleNamespace(taken=0, poses=[], take_all=take_all)

        tools = SimpleNamespace(
            fleet=SimpleNamespace(drones=dict.fromkeys(DRONES, drone)),
            eyes={
                d: SimpleNamespace(
                    sight=Sight(frame, v.region if seen else None, v.box if seen else None)
                )
                for d, v in later.items()
            },
            pilot=self.pilot,
            events=self.events,
            config=SimpleNamespace(
                mission=None, vision=SimpleNamespace(seed=CONFIG), planner=PlannerConfig()
            ),
            photographer=photographer,
            planning=None,
            no_go=None,
        )
        request = SimpleNamespace(train_seconds=0)
        self.steps = Steps(cast(Any, request), self.state, cast(Any, tools))

    async def capture(self) -> list[SeedFitted]:
        """Capture a round; returns the seed geometries that were published."""
        fitted: list[SeedFitted] = []
        with self.events.subscribe() as subscription:
            await self.steps.work(Phase.CAPTURE)
            await self.steps.seeding.settle()
            while not subscription._queue.empty():
                event = await anext(subscription)
                if isinstance(event, SeedFitted):
                    fitted.append(event)
        return fitted


async def test_a_rounds_pictures_vote_along():
    rig = Rig(np.pi / 4.0)
    assert rig.state.seed is not None
    before = rig.state.seed
    fitted = await rig.capture()
    assert len(rig.state.views) == 8
    assert [event.seed.views for event in fitted] == [8]
    assert rig.pilot.seed is rig.state.seed is fitted[0].seed
    # The plan keeps clear of the first outer box: that one stays, and holds the new boxes.
    assert rig.state.seed.outer is before.outer
    for box in rig.state.seed.boxes:
        assert (box.lower >= before.outer.lower - 1e-9).all()
        assert (box.upper <= before.outer.upper + 1e-9).all()


async def test_views_that_come_while_refining_are_taken_next():
    rig = Rig(np.pi / 4.0)
    seeding = rig.steps.seeding
    seeding.refine(DRONES)
    await asyncio.sleep(0)
    seeding.refine(DRONES)
    await seeding.settle()
    assert rig.state.seed is not None
    assert rig.state.seed.views == len(rig.state.views) == 12


async def test_a_mission_that_is_over_changes_nothing_any_more():
    rig = Rig(np.pi / 4.0)
    before = rig.state.seed
    rig.steps.seeding.refine(DRONES)
    await asyncio.sleep(0)
    rig.steps.seeding.stop()
    await rig.steps.seeding.settle()
    assert rig.state.seed is before


async def test_the_operators_priorities_stay():
    rig = Rig(np.pi / 4.0)
    assert rig.state.seed is not None
    wanted = (Priority(OBJECT, 2.0),)
    object.__setattr__(rig.state.seed, "priorities", wanted)
    await rig.capture()
    assert rig.state.seed is not None
    assert rig.state.seed.views == 8
    assert rig.state.seed.priorities == wanted


async def test_pictures_without_the_object_or_with_damage_change_nothing():
    for rig in (Rig(0.5, damaged=True), Rig(0.5, seen=False)):
        before = rig.state.seed
        assert await rig.capture() == []
        assert rig.state.seed is before
        assert len(rig.state.views) == 4
