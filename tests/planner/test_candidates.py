"""Candidates obey every constraint, and the constraint that leaves none is named."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_objects import box, seed_of

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.candidates import generate_candidates
from server.planner.config import CandidateConfig, FlightSpace, PlannerConfig
from server.planner.errors import PlanError
from server.planner.paths import column
from server.stages import SeedGeometry

CONFIG = PlannerConfig()


@given(
    size=st.tuples(st.floats(0.05, 0.9), st.floats(0.05, 0.9), st.floats(0.1, 1.8)),
    shift=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
)
@settings(max_examples=10, deadline=None)
def test_every_candidate_is_feasible(
    size: tuple[float, float, float], shift: tuple[float, float]
) -> None:
    half = np.array(size) / 2
    low = np.array([*shift, half[2]]) - half
    seed = seed_of(box(*low, *(low + 2 * half)))
    views = generate_candidates(seed, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG)
    assert len(views) >= 600
    for view in views[::7]:
        place = view.position_world
        assert np.hypot(place[0], place[1]) <= CONFIG.space.fence_radius_m + 1e-9
        assert CONFIG.space.floor_m - 1e-9 <= place[2] <= CONFIG.space.ceiling_m + 1e-9
        assert column(seed.outer).distance(place) >= CONFIG.space.standoff_m - 1e-6
        pixels, depths = TELLO_INTRINSICS.project(
            seed.outer.corners, view.T_world_cam(TELLO_TILT_RAD)
        )
        assert (depths > 0).all()
        assert TELLO_INTRINSICS.contains(pixels).all()


def test_the_nearest_shell_is_as_near_as_the_picture_allows(dog: SeedGeometry) -> None:
    """From a step nearer than the first shell the object is cut off or the standoff is broken."""
    config = PlannerConfig(candidates=CandidateConfig(radius_factors=(1.0,), minimum=1))
    for view in generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, config)[::5]:
        away = view.position_world - dog.outer.centre
        away[2] = 0.0
        nearer = view.position_world - 0.02 * away
        T = view.T_world_cam(TELLO_TILT_RAD)
        T[:3, 3] = nearer
        pixels, _ = TELLO_INTRINSICS.project(dog.outer.corners, T)
        margin = config.candidates.margin * TELLO_INTRINSICS.height
        cut = not TELLO_INTRINSICS.contains(pixels, margin).all()
        assert cut or column(dog.outer).distance(nearer) < config.space.view_standoff_m


def test_viewpoints_come_nearer_only_where_the_fence_leaves_few_farther_off(
    dog: SeedGeometry,
) -> None:
    def nearest_m(fence_m: float) -> float:
        config = PlannerConfig(space=FlightSpace(fence_radius_m=fence_m))
        views = generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, config)
        return min(column(dog.outer).distance(view.position_world) for view in views)

    space = FlightSpace()
    assert nearest_m(4.0) >= space.view_standoff_m - 1e-6
    reach_m = float(np.hypot(*(dog.outer.size[:2] / 2.0)))
    assert space.standoff_m - 1e-6 <= nearest_m(reach_m + 1.0) < space.view_standoff_m


def test_high_places_are_among_the_candidates(dog: SeedGeometry) -> None:
    views = generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG)
    top = dog.outer.upper[2]
    assert max(v.position_world[2] for v in views) == pytest.approx(top + CONFIG.candidates.above_m)


@pytest.mark.parametrize(
    ("space", "named"),
    [
        (FlightSpace(fence_radius_m=1.0), "fence"),
        (FlightSpace(standoff_m=4.9), "fence"),
    ],
)
def test_the_constraint_that_rules_all_out_is_named(
    dog: SeedGeometry, space: FlightSpace, named: str
) -> None:
    with pytest.raises(PlanError, match=named):
        generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, PlannerConfig(space=space))


def test_no_candidate_looks_through_a_wall(dog: SeedGeometry) -> None:
    wall = box(1.0, -6, 0, 1.1, 6, 3)
    views = generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG, [wall])
    assert views
    assert max(v.position_world[0] for v in views) < 1.0 - CONFIG.space.standoff_m + 1e-9
    around = [
        box(-6, -6, 0, 6, -0.5, 3), box(-6, 0.5, 0, 6, 6, 3),
        box(0.8, -6, 0, 6, 6, 3), box(-6, -6, 0, -0.8, 6, 3),
    ]  # fmt: skip
    with pytest.raises(PlanError, match="obstacle"):
        generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG, around)


def test_places_near_the_fence_are_taken_only_for_what_cannot_be_seen_from_farther_inside() -> None:
    def farthest_m(height_m: float) -> float:
        seed = seed_of(box(-0.3, -0.3, 0.0, 0.3, 0.3, height_m))
        views = generate_candidates(seed, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG)
        return max(float(np.hypot(*view.position_world[:2])) for view in views)

    fence_m, off_m = CONFIG.space.fence_radius_m, CONFIG.candidates.off_fence_m
    assert farthest_m(1.6) <= fence_m - off_m
    assert fence_m - off_m < farthest_m(2.45) <= fence_m
