"""Every viewpoint goes to one drone once, sectors keep drones apart, conflicts are repaired."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_objects import occupied_separation, pose_at

from server.planner.assignment import assign
from server.planner.config import FlightSpace
from server.planner.errors import PlanError
from server.planner.paths import arc_points, cylindrical, separation
from server.planner.ring import facing
from server.stages import Assignment, CameraPose, Viewpoint

SPACE = FlightSpace()
CENTRE = np.array([0.1, -0.1, 0.4])


def drones(count: int, radius: float = 2.2) -> dict[str, CameraPose]:
    angles = 2 * np.pi * np.arange(count) / count
    return {
        f"d{i}": pose_at(f"d{i}", radius * np.cos(a), radius * np.sin(a), 1.0)
        for i, a in enumerate(angles)
    }


def ring(count: int, radius: float = 2.2, phase: float = 0.05) -> list[Viewpoint]:
    angles = phase + 2 * np.pi * np.arange(count) / count
    return [facing(CENTRE, float(a), radius, 1.0) for a in angles]


def azimuths(assignment: Assignment, drone_id: str) -> np.ndarray:
    places = np.array([r[drone_id].position_world for r in assignment.rounds if drone_id in r])
    return cylindrical(places, CENTRE)[:, 0]


@pytest.mark.parametrize(("count", "rounds"), [(1, 6), (2, 6), (3, 4), (4, 6), (5, 3), (8, 3)])
def test_each_drone_walks_through_its_sector_in_one_direction(count: int, rounds: int) -> None:
    views = ring(count * rounds, radius=2.5)
    order = np.random.default_rng(0).permutation(len(views))
    assignment = assign([views[i] for i in order], drones(count), CENTRE, SPACE)
    assert len(assignment.rounds) == rounds
    given_out = [id(v) for views_now in assignment.rounds for v in views_now.values()]
    assert sorted(given_out) == sorted(id(v) for v in views)
    directions = set()
    for drone_id in drones(count):
        steps = np.diff(np.unwrap(azimuths(assignment, drone_id)))
        directions.update(np.sign(steps).tolist())
        np.testing.assert_allclose(np.abs(steps), 2 * np.pi / (count * rounds), atol=1e-9)
    assert len(directions) == 1
    assert occupied_separation(assignment, drones(count), SPACE) >= SPACE.separation_m - 1e-6


def test_the_assignment_takes_the_short_way() -> None:
    """Four drones, four viewpoints 10 degrees on: nobody goes to another drone's viewpoint."""
    assignment = assign(ring(4, phase=0.17)[::-1], drones(4), CENTRE, SPACE)
    for drone_id, view in assignment.rounds[0].items():
        away = view.position_world - drones(4)[drone_id].position_world
        assert np.linalg.norm(away) < 0.8


@given(
    count=st.integers(2, 5),
    rounds=st.integers(1, 4),
    seed=st.integers(0, 10_000),
)
@settings(max_examples=25, deadline=None)
def test_separation_holds_for_any_viewpoints(count: int, rounds: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    views = [
        facing(CENTRE, float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(1.3, 3.7)), float(h))
        for h in rng.uniform(0.4, 2.4, count * rounds)
    ]
    try:
        assignment = assign(views, drones(count), CENTRE, SPACE)
    except PlanError:
        # Rounds of few, random viewpoints may be truly inseparable; five drones in one clump.
        return
    assert occupied_separation(assignment, drones(count), SPACE) >= SPACE.separation_m - 1e-6
    assert sum(len(r) for r in assignment.rounds) == count * rounds
    for views_now in assignment.rounds:
        for view in views_now.values():
            towards = CENTRE - view.position_world
            assert np.hypot(*view.position_world[:2]) <= SPACE.fence_radius_m + 1e-9
            facing_error = np.arctan2(towards[1], towards[0]) - view.yaw_rad
            assert abs(np.angle(np.exp(1j * facing_error))) < 1e-6


def test_two_viewpoints_too_close_are_moved_apart_not_given_up() -> None:
    twins = [facing(CENTRE, 0.0, 2.0, 1.0), facing(CENTRE, 0.1, 2.05, 1.0)]
    assignment = assign(twins, drones(2), CENTRE, SPACE)
    assert occupied_separation(assignment, drones(2), SPACE) >= SPACE.separation_m - 1e-6
    kept = [v for v in assignment.rounds[0].values() if v in twins]
    assert len(kept) == 1


def test_one_above_the_other_needs_more_room() -> None:
    low, high = np.array([2.0, 0.0, 0.5]), np.array([2.0, 0.0, 2.0])
    assert separation(low, high, 2.0) == pytest.approx(0.75)
    assert separation(low, np.array([2.0, 1.5, 0.5]), 2.0) == pytest.approx(1.5)


def test_no_room_at_all_is_an_error() -> None:
    tight = FlightSpace(fence_radius_m=2.1)
    with pytest.raises(PlanError, match="fence"):
        assign(
            [facing(np.zeros(3), 0.01 * i, 2.0, 1.0) for i in range(3)],
            drones(3),
            np.zeros(3),
            tight,
        )


def test_the_last_round_may_be_incomplete() -> None:
    assignment = assign(ring(7, radius=2.5), drones(3), CENTRE, SPACE)
    assert [len(r) for r in assignment.rounds] == [3, 3, 1]


def test_an_arc_ends_at_its_goal_and_never_cuts_the_corner() -> None:
    start, goal = np.array([[3.0, 2.0, 1.0]]), np.array([[-3.0, 2.5, 1.5]])
    points = arc_points(start, goal, 10)
    np.testing.assert_allclose(cylindrical(points[-1], np.zeros(3)), goal)
    assert np.hypot(points[..., 0], points[..., 1]).min() >= 2.0 - 1e-9


def test_nothing_to_assign_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least one"):
        assign([], drones(2), CENTRE, SPACE)
