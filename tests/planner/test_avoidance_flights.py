"""Whole flights under avoidance: drones keep apart, keep off everything, and arrive.

``ROUGH`` drones have a first-order lag of 0.35 s, gain errors of 10 %, drift, positions believed
wrong by up to 0.15 m, velocities rounded to 0.1 m/s, and 0.2 s of latency. Distances are true ones.

Physical limits: 0.35 m beside one another, two diagonals of a drone with propellers, and 0.7 m
above one another. Pushed to it by a belief wrong by 0.15 m, a drone may be that far inside a
standoff or beyond a fence; drift and latency add a little.
"""

from __future__ import annotations

import numpy as np
import pytest
from avoidance_flights import CONFIG, IDEAL, ROUGH, Flight, Plant, circle, fly
from hypothesis import given, note, settings
from hypothesis import strategies as st
from planner_objects import box

from server.geometry.boxes import Box3
from server.planner.paths import column, separation

OBJECT = box(-0.4, -0.2, 0.0, 0.4, 0.2, 0.6)
PHYSICAL_M = 0.35
BELIEF_M = ROUGH.noise_m + 0.05
ENOUGH_S = 90.0


def assert_safe(flight: Flight, plant: Plant) -> None:
    wrong = BELIEF_M if plant.noise_m else 0.01
    assert flight.apart_m > PHYSICAL_M
    assert flight.clearance_m > CONFIG.space.standoff_m - wrong
    assert flight.fence_m > -wrong
    assert flight.floor_m > -wrong
    assert flight.ceiling_m > -wrong
    assert flight.fastest_m_s <= CONFIG.avoidance.speed_max_m_s + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("plant", [IDEAL, ROUGH], ids=["ideal", "rough"])
@pytest.mark.parametrize("target", [None, OBJECT], ids=["free", "object"])
@pytest.mark.parametrize("count", [2, 3, 4, 5, 8])
def test_drones_that_swap_places_through_the_middle_arrive(
    count: int, target: Box3 | None, plant: Plant
) -> None:
    starts = circle(count)
    goals = starts * [-1, -1, 1]
    flight = fly(starts, goals, target, ENOUGH_S, plant, seed=count)
    assert_safe(flight, plant)
    assert flight.arrived_s < 45.0
    if plant is IDEAL:
        assert flight.apart_m > 2 * CONFIG.avoidance.radius_m - 0.05


@pytest.mark.slow
@pytest.mark.parametrize("plant", [IDEAL, ROUGH], ids=["ideal", "rough"])
def test_drones_that_go_round_in_opposite_directions_pass(plant: Plant) -> None:
    """Two face each other on the circle and want to be where the other one is."""
    starts = circle(4)
    flight = fly(starts, starts[::-1], OBJECT, ENOUGH_S, plant, seed=3)
    assert_safe(flight, plant)
    assert flight.arrived_s < 45.0


@pytest.mark.slow
@pytest.mark.parametrize("plant", [IDEAL, ROUGH], ids=["ideal", "rough"])
def test_head_on_in_a_corridor_too_narrow_to_pass_one_goes_the_other_way(plant: Plant) -> None:
    """Between standoff and fence there is no room for two, neither beside nor above."""
    # Standoff to fence is 0.5 m of the 0.8 m that passing needs.
    large = box(-1.98, -1.98, 0.0, 1.98, 1.98, 1.5)
    assert 4.2 - 1.98 * np.sqrt(2.0) - 0.9 < 0.55
    starts = np.array([[0.4, 3.3, 1.0], [3.3, 0.4, 1.0]])
    flight = fly(starts, starts[::-1], large, 150.0, plant, seed=1)
    assert_safe(flight, plant)
    assert flight.arrived_s < 150.0


@pytest.mark.slow
@pytest.mark.parametrize("goal_y", [1.069, 2.5])
def test_a_drone_that_hovers_beside_the_object_is_passed_on_the_open_side(goal_y: float) -> None:
    """The right-hand rule alone would push the other drone against the object for ever."""
    target = box(-0.32, -0.43, 0.0, 0.32, 0.43, 1.0)
    starts = np.array([[-1.72, 0.9, 0.8], [-0.805, 1.571, 1.18]])
    goals = np.array([[0.972, goal_y, 0.81], [-0.805, 1.571, 1.18]])
    flight = fly(starts, goals, target, ENOUGH_S, sigma_m=0.1)
    assert_safe(flight, IDEAL)
    assert flight.arrived_s < ENOUGH_S


@pytest.mark.slow
def test_a_drone_that_hovers_near_the_fence_is_passed_on_the_inside() -> None:
    # Both just inside the fence of 4 m, the goal of one of them beyond the other.
    starts = np.array([[-1.50, -3.66, 1.5], [-0.24, -3.45, 1.32]])
    goals = np.array([[1.31, -3.21, 1.5], [-0.24, -3.45, 1.32]])
    flight = fly(starts, goals, OBJECT, ENOUGH_S)
    assert_safe(flight, IDEAL)
    assert flight.arrived_s < ENOUGH_S


def places(count: int, target: Box3 | None, rng: np.random.Generator) -> np.ndarray:
    """Return allowed places ``(count, 3)`` at least the planner's separation apart."""
    space, found = CONFIG.space, np.zeros((0, 3))
    while len(found) < count:
        angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, space.fence_radius_m - 0.05)
        height = rng.uniform(space.floor_m + 0.05, space.ceiling_m - 0.05)
        place = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
        if target is not None and column(target).distance(place) < space.standoff_m:
            continue
        if (separation(found, place, space.downwash_factor) >= space.separation_m).all():
            found = np.vstack([found, place])
    return found


@pytest.mark.slow
@given(
    seed=st.integers(0, 1_000_000),
    count=st.integers(1, 8),
    target=st.sampled_from([None, OBJECT]),
    plant=st.sampled_from([IDEAL, ROUGH]),
)
@settings(max_examples=40, deadline=None)
def test_random_flights_are_safe_and_up_to_four_drones_arrive(
    seed: int, count: int, target: Box3 | None, plant: Plant
) -> None:
    rng = np.random.default_rng(seed)
    starts, goals = places(count, target, rng), places(count, target, rng)
    flight = fly(starts, goals, target, ENOUGH_S, plant, seed=seed)
    note(f"seed {seed}, {count} drones, apart {flight.apart_m:.3f}, {flight.arrived_s:.1f} s")
    assert_safe(flight, plant)
    # A crowd of more between object and fence may need longer to sort itself out.
    if count <= 4:
        assert flight.arrived_s < ENOUGH_S
