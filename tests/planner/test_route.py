"""The way round the object: closed forms against sampling, detours against being stuck."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_objects import box

from server.planner.config import PlannerConfig
from server.planner.paths import column
from server.planner.route import (
    next_detour,
    route_velocity,
    segment_distance,
    shorter_turning,
    straight_is_free,
)

CONFIG = PlannerConfig()
OBJECT = box(-0.4, -0.2, 0.0, 0.4, 0.2, 0.6)
RECTANGLE = (-0.4, -0.2, 0.4, 0.2)
metres = st.floats(-3.0, 3.0)
points = st.tuples(metres, metres)


@given(start=points, end=points)
@settings(max_examples=500)
def test_the_distance_of_a_segment_is_the_least_of_its_points(
    start: tuple[float, float], end: tuple[float, float]
) -> None:
    share = np.linspace(0.0, 1.0, 801)[:, None]
    way = np.array(start) + share * (np.array(end) - np.array(start))
    beyond = np.maximum(0.0, np.maximum(np.array(RECTANGLE[:2]) - way, way - RECTANGLE[2:]))
    sampled = float(np.linalg.norm(beyond, axis=1).min())
    found = segment_distance(start, end, RECTANGLE)
    assert found <= sampled + 1e-9
    assert sampled - found <= math.dist(start, end) / 1600 + 1e-9


def test_a_segment_across_the_object_and_one_inside_meet_it() -> None:
    assert segment_distance((-2.0, 0.0), (2.0, 0.1), RECTANGLE) == 0.0
    assert segment_distance((0.1, 0.1), (0.1, 0.1), RECTANGLE) == 0.0
    assert segment_distance((-2.0, 1.2), (2.0, 1.2), RECTANGLE) == pytest.approx(1.0)
    assert segment_distance((1.4, -2.0), (1.4, 2.0), RECTANGLE) == pytest.approx(1.0)
    assert segment_distance((0.7, 0.6), (0.7, 0.6), RECTANGLE) == pytest.approx(0.5)


def test_the_way_round_follows_the_turning_asked_for() -> None:
    start, goal = np.array([2.0, 0.2, 1.0]), np.array([-2.0, 0.2, 1.0])
    assert not straight_is_free(start, goal, OBJECT, CONFIG.space.standoff_m)
    shorter = route_velocity(start, goal, OBJECT, CONFIG)
    forced = route_velocity(start, goal, OBJECT, CONFIG, turning=-1)
    assert shorter[1] > 0.2 > -0.2 > forced[1]


def test_a_free_way_is_straight_and_slows_down_at_the_goal() -> None:
    start = np.array([2.0, -1.0, 1.0])
    far, near = np.array([2.0, 1.0, 1.0]), np.array([2.0, -0.9, 1.0])
    np.testing.assert_allclose(
        route_velocity(start, far, OBJECT, CONFIG), [0, CONFIG.tracking.travel_speed_m_s, 0]
    )
    np.testing.assert_allclose(
        route_velocity(start, near, OBJECT, CONFIG), [0, 0.1 * CONFIG.tracking.travel_gain, 0]
    )


def test_a_drone_that_is_too_near_may_leave_but_not_cross() -> None:
    near = np.array([0.8, 0.0, 1.0])
    assert straight_is_free(near, np.array([2.0, 0.0, 1.0]), OBJECT, 0.9)
    assert not straight_is_free(near, np.array([-2.0, 0.0, 1.0]), OBJECT, 0.9)
    assert not straight_is_free(near, np.array([0.0, 0.0, 1.0]), OBJECT, 0.9)


def test_exactly_opposite_goals_turn_everybody_counter_clockwise() -> None:
    for azimuth in np.linspace(0.0, 2 * np.pi, 17):
        start = np.array([2 * np.cos(azimuth), 2 * np.sin(azimuth), 1.0])
        assert shorter_turning(start, start * [-1, -1, 1], OBJECT) == 1


@given(azimuth=st.floats(-3.1, 3.1), radius=st.floats(1.4, 4.0), way=st.floats(-3.1, 3.1))
@settings(max_examples=100, deadline=None)
def test_a_lone_drone_arrives_and_keeps_the_standoff(
    azimuth: float, radius: float, way: float
) -> None:
    position = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), 0.8])
    goal = np.array([2.0 * np.cos(azimuth + way), 2.0 * np.sin(azimuth + way), 1.5])
    # Clear of the circle's curvature: half a step's sagitta is far below a millimetre.
    for _ in range(400):
        position = position + 0.1 * route_velocity(position, goal, OBJECT, CONFIG)
        assert column(OBJECT).distance(position) > CONFIG.space.standoff_m - 0.02
    assert np.linalg.norm(position - goal) < 0.01


def test_a_detour_is_kept_while_it_makes_progress() -> None:
    goal = np.array([-2.0, 0.0, 1.0])
    detour = next_detour(None, np.array([2.0, 0.1, 1.0]), goal, OBJECT, CONFIG, 0.0)
    assert detour.turning == 1
    # Noise across the line where the other way would be shorter changes nothing.
    for k, y in enumerate((-0.1, 0.1, -0.3, -0.05)):
        detour = next_detour(detour, np.array([2.0, y, 1.0]), goal, OBJECT, CONFIG, 0.1 * k)
        assert detour.turning == 1


def turned_after(order: int) -> float:
    goal, here = np.array([-2.0, 0.0, 1.0]), np.array([2.0, 0.1, 1.0])
    detour = next_detour(None, here, goal, OBJECT, CONFIG, 0.0, order)
    for tick in range(1, 600):
        wobble = here + np.array([0.0, 0.05 * math.sin(tick), 0.0])
        detour = next_detour(detour, wobble, goal, OBJECT, CONFIG, 0.1 * tick, order)
        if detour.turning != 1:
            return 0.1 * tick
    return math.inf


def test_drones_that_are_stuck_lose_patience_one_after_the_other() -> None:
    times = [turned_after(order) for order in range(4)]
    assert all(5.0 < time < 20.0 for time in times)
    assert min(np.diff(times)) > 2.0


def test_a_new_goal_forgets_the_detour_and_a_free_way_has_none() -> None:
    here = np.array([2.0, 0.1, 1.0])
    behind, beside = np.array([-2.0, 0.0, 1.0]), np.array([2.0, 1.0, 1.0])
    detour = next_detour(None, here, behind, OBJECT, CONFIG, 0.0)
    assert next_detour(detour, here, beside, OBJECT, CONFIG, 0.1).turning == 0
    clockwise = next_detour(None, here * [1, -1, 1], behind, OBJECT, CONFIG, 0.2)
    assert clockwise.turning == -1


def test_a_drone_close_to_its_goal_is_not_stuck() -> None:
    goal = np.array([2.0, 0.0, 1.0])
    here, detour = np.array([2.1, 0.0, 1.0]), None
    for tick in range(600):
        detour = next_detour(detour, here, goal, OBJECT, CONFIG, 0.1 * tick)
        assert detour.turning == 0
