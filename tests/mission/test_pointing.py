"""What the operator shows: picks reach eye and target, parts find their place, views disagree."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.mission.commands import PointedPlace, RefusedError, UnknownError
from server.mission.config import FlightConfig, MissionConfig
from server.mission.disagreement import DisagreementWatch
from server.mission.events import (
    Event,
    EventStream,
    FrameAnnotated,
    Noted,
    ObjectPointedOut,
    PrioritiesChanged,
    ViewsDisagree,
)
from server.mission.eyes import Eye, Sight
from server.mission.pilot import Pilot
from server.mission.pointing import Pointing
from server.mission.priorities import Priorities
from server.planner.config import PlannerConfig
from server.stages import Box, CameraPose, Frame, Region, SeedGeometry, View
from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.vision.config import VisionConfig
from server.vision.region import RegionPrior
from server.vision.target import TargetEstimate, prior_target

Array = NDArray[np.float64]

CONFIG = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
CAMERA = TELLO_INTRINSICS
DRONES = ("a", "b", "c", "d")
NOW_S = 100.0
OUTER = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 1.0]))
SEED = SeedGeometry(OUTER, (OUTER,), 4)


@dataclass
class FakeEye:
    """Keeps what it was told."""

    sight: Sight | None = None
    annotated: FrameAnnotated | None = None
    told: list[Array | None] = field(default_factory=list)

    def expect(self, prior: RegionPrior | None) -> None:
        pass

    def point_out(self, xyxy_px: Array | None) -> None:
        self.told.append(xyxy_px)

    async def run(self) -> None:
        pass


@dataclass
class FakePilot:
    """Knows where the drones are, and believes what it is told."""

    seed: SeedGeometry | None = None
    believed: TargetEstimate = field(
        default_factory=lambda: prior_target(CONFIG.vision.localization)
    )
    moves: list[TargetEstimate] = field(default_factory=list)

    def pose(self, drone_id: str, at_s: float | None = None) -> CameraPose:
        azimuth = DRONES.index(drone_id) * np.pi / 2.0
        place = np.array([2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), 1.0])
        T = camera_pose(place, azimuth + np.pi, TELLO_TILT_RAD)
        return CameraPose(drone_id, at_s or 0.0, T, np.diag([0.05, 0.05, 0.03, 0.02]) ** 2)

    def target(self) -> TargetEstimate:
        return self.believed

    def move_target(self, target: TargetEstimate) -> None:
        self.moves.append(target)
        self.believed = target


class HeardEvents(EventStream):
    """Keeps what was published."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[Event] = []

    def publish(self, event: Event) -> None:
        self.heard.append(event)


class Rig:
    """Pointing, priorities and the watch over four drones that need nothing else."""

    def __init__(self, activity: str = "flying") -> None:
        self.fakes = {
            d: SimpleNamespace(
                activity=activity, config=SimpleNamespace(intrinsics=CAMERA, label=d.upper())
            )
            for d in DRONES
        }
        drones = cast("dict[str, Drone]", self.fakes)
        self.eyes = {d: FakeEye(sight(d)) for d in DRONES}
        eyes = cast("dict[str, Eye]", self.eyes)
        self.fake_pilot = FakePilot()
        pilot = cast(Pilot, self.fake_pilot)
        events = HeardEvents()
        self.heard = events.heard
        self.pointing = Pointing(drones, eyes, pilot, CONFIG, events, lambda: NOW_S)
        self.priorities = Priorities(drones, pilot, events)
        self.watch = DisagreementWatch(
            drones, eyes, pilot, CONFIG.vision.agreement, events, lambda: NOW_S
        )

    def notes(self, level: str) -> list[str]:
        return [e.text for e in self.heard if isinstance(e, Noted) and e.level == level]


def sight(drone_id: str, captured_s: float = NOW_S, size: tuple[int, int] = (960, 720)) -> Sight:
    picture = np.zeros((size[1], size[0], 3), np.uint8)
    return Sight(Frame(drone_id, 0, captured_s, picture, damaged=False), None, None)


def place_of(pilot: FakePilot, drone_id: str, centre: Array, half: float = 0.08) -> PointedPlace:
    """Return a box drawn around ``centre`` in a drone's picture."""
    pixels, _ = CAMERA.project(centre[None], pilot.pose(drone_id).T_world_cam)
    x, y = pixels[0] / [CAMERA.width, CAMERA.height]
    return (x - half, y - half, x + half, y + half)


def test_a_drawn_box_reaches_the_drones_own_eye_in_pixels() -> None:
    rig = Rig()
    event = rig.pointing.point_out("a", (0.25, 0.25, 0.75, 0.75))
    (told,) = rig.eyes["a"].told
    assert told == pytest.approx([239.5, 179.5, 719.5, 539.5])
    assert event in rig.heard
    assert rig.pointing.standing() == [event]
    # It shows the object where it is believed to be: nothing moves, and nobody searches anew.
    assert rig.fake_pilot.moves == []
    assert all(rig.eyes[d].told == [] for d in "bcd")


def test_a_click_takes_the_expected_size() -> None:
    rig = Rig()
    rig.fake_pilot.seed = SEED
    rig.pointing.point_out("a", (0.5, 0.5))
    (told,) = rig.eyes["a"].told
    assert told is not None
    assert told[3] - told[1] > 300.0
    assert (told[:2] + told[2:]) / 2.0 == pytest.approx([479.5, 359.5], abs=1.0)


def test_on_the_ground_only_the_eye_is_told() -> None:
    rig = Rig("ground")
    rig.pointing.point_out("a", (0.0, 0.0, 0.1, 0.1))
    assert len(rig.eyes["a"].told) == 1
    assert rig.fake_pilot.moves == []


def test_picks_elsewhere_move_the_target_and_more_of_them_triangulate() -> None:
    rig = Rig()
    true = np.array([0.7, 0.6, 0.45])
    rig.pointing.point_out("a", place_of(rig.fake_pilot, "a", true))
    (once,) = rig.fake_pilot.moves
    # The other eyes search around the new place; its own follows the pick.
    assert [rig.eyes[d].told for d in "bcd"] == [[None]] * 3
    rig.fake_pilot.believed = prior_target(CONFIG.vision.localization)
    rig.pointing.point_out("b", place_of(rig.fake_pilot, "b", true))
    twice = rig.fake_pilot.moves[-1]
    misses = [np.linalg.norm((found.centre - true)[:2]) for found in (once, twice)]
    assert misses[1] < 0.15 < misses[0]
    assert len(rig.eyes["a"].told) == 1


def test_picks_that_contradict_each_other_leave_the_newest() -> None:
    rig = Rig()
    rig.pointing.point_out("a", place_of(rig.fake_pilot, "a", np.array([0.3, 0.6, 0.4]), 0.03))
    rig.pointing.point_out("c", place_of(rig.fake_pilot, "c", np.array([-0.3, -0.6, 0.4]), 0.03))
    assert any("do not meet" in text for text in rig.notes("warning"))
    assert rig.fake_pilot.moves[-1].centre[1] < -0.2


def test_a_place_too_near_the_fence_moves_no_target() -> None:
    rig = Rig()
    safety = replace(CONFIG.safety, fence_radius_m=1.9, standoff_m=0.9)
    config = SimpleNamespace(safety=safety, vision=CONFIG.vision)
    rig.pointing._config = cast(FlightConfig, config)
    rig.pointing.point_out("a", place_of(rig.fake_pilot, "a", np.array([0.0, 0.9, 0.4]), 0.04))
    assert rig.fake_pilot.moves == []
    assert len(rig.eyes["a"].told) == 1
    (warning,) = rig.notes("warning")
    assert "up to 0.5 m" in warning


def test_once_the_geometry_is_known_the_target_stays() -> None:
    rig = Rig()
    rig.fake_pilot.seed = SEED
    rig.pointing.point_out("a", place_of(rig.fake_pilot, "a", OUTER.centre))
    assert rig.notes("warning") == []
    rig.pointing.point_out("a", place_of(rig.fake_pilot, "a", np.array([0.0, 1.0, 0.4]), 0.05))
    assert any("abort" in text for text in rig.notes("warning"))
    assert rig.fake_pilot.moves == []


@pytest.mark.parametrize(
    ("seen", "text"),
    [
        (None, "no live picture"),
        (sight("a", NOW_S - 10.0), "no live picture"),
        (sight("a", size=(640, 480)), "calibrated"),
    ],
)
def test_a_pick_needs_a_usable_picture(seen: Sight | None, text: str) -> None:
    rig = Rig()
    rig.eyes["a"].sight = seen
    with pytest.raises(RefusedError, match=text):
        rig.pointing.point_out("a", (0.5, 0.5))
    assert rig.eyes["a"].told == []


def test_a_sliver_is_refused() -> None:
    rig = Rig()
    with pytest.raises(RefusedError, match="too small"):
        rig.pointing.point_out("a", (0.2, 0.2, 0.8, 0.205))
    assert rig.pointing.standing() == []


def test_picks_stand_until_they_are_taken_back_or_the_capture_ends() -> None:
    rig = Rig("ground")
    for drone_id in "ab":
        rig.pointing.point_out(drone_id, (0.4, 0.4, 0.6, 0.6))
    rig.pointing.begin_capture()
    assert len(rig.pointing.standing()) == 2
    rig.pointing.search("a")
    assert [e.drone_id for e in rig.pointing.standing() if isinstance(e, ObjectPointedOut)] == ["b"]
    rig.pointing.end_capture()
    assert rig.pointing.standing() == []
    assert [eye.told[-1] for eye in (rig.eyes["a"], rig.eyes["b"])] == [None, None]


# -- priorities ------------------------------------------------------------------------------------


def test_a_part_drawn_before_the_geometry_waits_for_it() -> None:
    rig = Rig()
    part = rig.priorities.add("a", (0.3, 0.0, 0.7, 0.5), 4.0, NOW_S)
    assert part.box is None
    (found,) = rig.priorities.of_seed(SEED)
    assert found.weight == 4.0
    assert OUTER.grown(1e-9).contains(found.box.corners).all()
    assert 0.1 < found.box.volume_m3 / OUTER.volume_m3 < 0.9
    assert rig.priorities.parts[0].box is found.box
    told = [e for e in rig.heard if isinstance(e, PrioritiesChanged)]
    assert [event.parts[0].box for event in told] == [None, found.box]


def test_a_part_that_shows_nothing_of_the_object_is_dropped_or_refused() -> None:
    rig = Rig()
    rig.priorities.add("a", (0.0, 0.0, 0.05, 0.05), 4.0, NOW_S)
    assert rig.priorities.of_seed(SEED) == ()
    assert rig.priorities.parts == ()
    assert len(rig.notes("warning")) == 1
    rig.fake_pilot.seed = SEED
    with pytest.raises(RefusedError, match="nothing of the object"):
        rig.priorities.add("a", (0.0, 0.0, 0.05, 0.05), 4.0, NOW_S)


def test_parts_are_dropped_by_name_and_by_the_next_capture() -> None:
    rig = Rig()
    names = [rig.priorities.add("a", (0.3, 0.0, 0.7, 0.5), 4.0, NOW_S).id for _ in range(3)]
    assert len(set(names)) == 3
    rig.priorities.drop(names[1])
    assert [part.id for part in rig.priorities.parts] == [names[0], names[2]]
    with pytest.raises(UnknownError):
        rig.priorities.drop(names[1])
    rig.priorities.begin_capture()
    assert rig.priorities.parts == ()


# -- disagreement ----------------------------------------------------------------------------------


def views(rig: Rig, odd: str | None) -> list[View]:
    """Return what four drones see; ``odd`` looks at something else."""
    made: list[View] = []
    for drone_id in DRONES:
        centre = np.array([0.0, 0.0, 0.5])
        if drone_id == odd:
            centre = np.array([-0.9, 0.9, 0.5])
        pose = rig.fake_pilot.pose(drone_id)
        pixels, depths = CAMERA.project(centre[None], pose.T_world_cam)
        half = 0.25 * CAMERA.fx / depths[0]
        box = Box(np.concatenate([pixels[0] - half, pixels[0] + half]), 0.9, touches_edge=False)
        region = Region(pixels[0], 50.0, 50.0, np.ones((90, 120), bool), 8.0, 0.9)
        made.append(View(pose, CAMERA, box, region))
    return made


def test_a_disagreement_is_told_when_it_begins_and_when_it_ends() -> None:
    rig = Rig()
    # The odd one comes and goes; only what is found twice in a row is told, and only once.
    for odd in (None, "b", None, "b", "b", "b", None, "b", None, None, None):
        rig.watch.look(views(rig, odd))
    told = [e for e in rig.heard if isinstance(e, ViewsDisagree)]
    assert [e.drone_ids for e in told] == [("b",), ()]
    assert told[0].reason
    assert rig.watch.standing() == []
    (warning,) = rig.notes("warning")
    assert "B" in warning
    assert "pick the object on that tile" in warning


def test_when_nobody_looks_any_more_a_disagreement_is_over() -> None:
    rig = Rig()
    for _ in range(2):
        rig.watch.look(views(rig, "c"))
    assert [e.drone_ids for e in rig.watch.standing() if isinstance(e, ViewsDisagree)] == [("c",)]
    rig.watch.look([], watching=False)
    assert rig.watch.standing() == []
