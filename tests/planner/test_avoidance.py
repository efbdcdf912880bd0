"""Half-space solver against sampling; drones in simulated flight keep apart and arrive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from planner_objects import box, pose_at

from server.geometry.boxes import Box3
from server.planner.avoidance import (
    Agent,
    Obstacle,
    agent_from_pose,
    avoid,
    obstacle_row,
    protected_radius,
    reciprocal_row,
)
from server.planner.config import AvoidanceConfig, PlannerConfig
from server.planner.halfspaces import least_violating_velocity, nearest_velocity
from server.planner.paths import column, separation
from server.planner.route import route_velocity, straight_is_free

CONFIG = PlannerConfig()
OBJECT = box(-0.4, -0.2, 0.0, 0.4, 0.2, 0.6)
DT_S = 0.1
LAG_S = 0.35


def random_rows(seed: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.normal(size=3) * 0.6, normals, rng.uniform(-0.4, 0.15, count)


@given(seed=st.integers(0, 100_000), count=st.integers(1, 9))
@settings(max_examples=60, deadline=None)
def test_no_sampled_velocity_is_nearer_than_the_solvers(seed: int, count: int) -> None:
    wanted, normals, offsets = random_rows(seed, count)
    found = nearest_velocity(wanted, normals, offsets, 0.5)
    rng = np.random.default_rng(seed + 1)
    trial = rng.normal(size=(4000, 3))
    trial *= (
        0.5 * rng.uniform(size=(4000, 1)) ** (1 / 3) / np.linalg.norm(trial, axis=1, keepdims=True)
    )
    feasible = trial[(trial @ normals.T >= offsets).all(axis=1)]
    if found is None:
        assert len(feasible) == 0
        return
    assert (normals @ found >= offsets - 1e-6).all()
    assert np.linalg.norm(found) <= 0.5 + 1e-6
    if len(feasible):
        nearest = np.linalg.norm(feasible - wanted, axis=1).min()
        assert np.linalg.norm(found - wanted) <= nearest + 1e-6


def test_rows_that_contradict_are_violated_equally_and_hard_ones_not() -> None:
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 1.0]])
    offsets = np.array([0.2, 0.1, 0.05])
    soft = np.array([True, True, False])
    wanted = np.array([0.0, 0.1, 0.0])
    assert nearest_velocity(wanted, normals, offsets, 0.5) is None
    velocity = least_violating_velocity(wanted, normals, offsets, 0.5, soft)
    np.testing.assert_allclose(velocity, [0.05, 0.1, 0.05], atol=1e-4)


def test_two_head_on_drones_take_half_of_the_way_out_each() -> None:
    config = AvoidanceConfig()
    a = Agent("a", np.array([-1.0, 0, 1]), np.array([0.4, 0, 0]), np.zeros(3))
    b = Agent("b", np.array([1.0, 0, 1]), np.array([-0.4, 0, 0]), np.zeros(3))
    normal_a, offset_a = reciprocal_row(a, b, config, DT_S)
    normal_b, offset_b = reciprocal_row(b, a, config, DT_S)
    # Taking both half-spaces at their edge, the relative velocity keeps them R apart for tau.
    va = a.velocity_world + max(0.0, offset_a - normal_a @ a.velocity_world) * normal_a
    vb = b.velocity_world + max(0.0, offset_b - normal_b @ b.velocity_world) * normal_b
    times = np.linspace(0.0, config.horizon_s, 50)[:, None]
    gap = np.linalg.norm(b.position_world - a.position_world + times * (vb - va), axis=1)
    assert gap.min() == pytest.approx(2 * config.radius_m, abs=0.01)


def test_an_uncertain_pose_grows_the_sphere_up_to_a_limit() -> None:
    config = AvoidanceConfig()
    sure, unsure, lost = (
        protected_radius(
            agent_from_pose(pose_at("a", 0, 0, 1, sigma_m=s), np.zeros(3), np.zeros(3)), config
        )
        for s in (0.0, 0.06, 3.0)
    )
    assert sure == config.radius_m
    assert unsure == pytest.approx(config.radius_m + 0.06)
    assert lost == config.radius_m + config.sigma_margin_max_m


@pytest.mark.parametrize("inside_m", [-0.3, 0.0, 0.2, 0.6])
def test_the_object_pushes_out_and_lets_along(inside_m: float) -> None:
    position = np.array([0.4 + CONFIG.space.standoff_m - inside_m, 0.0, 2.4])
    normal, offset = obstacle_row(
        position, Obstacle(OBJECT, CONFIG.space.standoff_m), CONFIG.avoidance
    )
    np.testing.assert_allclose(normal, [1.0, 0, 0], atol=1e-9)
    assert (offset > 0) == (inside_m > 0)
    assert normal @ np.array([0.0, 0.4, 0.1]) == 0.0


def fly(
    starts: np.ndarray,
    goals: np.ndarray,
    target: Box3,
    seconds: float,
    turning: int = 0,
    sigma_m: float = 0.0,
) -> tuple[np.ndarray, float, float]:
    """Return final positions, least separation (heights shrunk) and least distance to the object.

    Drones follow commands with a first-order lag, as real ones do.
    """
    positions, velocities = starts.astype(float), np.zeros_like(starts, dtype=float)
    first, second = np.triu_indices(len(starts), 1)
    nearest = clearance = np.inf
    for _ in range(round(seconds / DT_S)):
        agents = [
            Agent(
                str(i),
                positions[i],
                velocities[i],
                route_velocity(positions[i], goals[i], target, CONFIG, turning),
                sigma_m,
            )
            for i in range(len(starts))
        ]
        wanted = np.array(
            avoid(
                agents,
                [Obstacle(target, CONFIG.space.standoff_m)],
                CONFIG.space,
                CONFIG.avoidance,
                DT_S,
            )
        )
        for _ in range(4):
            velocities = velocities + (wanted - velocities) * (DT_S / 4 / LAG_S)
            positions = positions + velocities * (DT_S / 4)
        if len(first):
            apart = separation(positions[first], positions[second], 2.0)
            nearest = min(nearest, float(apart.min()))
        clearance = min(clearance, *(column(target).distance(p) for p in positions))
    return positions, nearest, clearance


def circle(count: int, radius: float = 2.0, height: float = 1.0) -> np.ndarray:
    angles = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, height)], 1)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4, 8])
def test_drones_that_swap_places_across_the_object_arrive(count: int) -> None:
    starts = circle(count)
    goals = starts * [-1, -1, 1]
    ends, nearest, clearance = fly(starts, goals, OBJECT, 30.0)
    assert np.linalg.norm(ends - goals, axis=1).max() < 0.05
    assert nearest > 2 * CONFIG.avoidance.radius_m - 0.05
    assert clearance > CONFIG.space.standoff_m - 0.05


@pytest.mark.slow
def test_drones_that_go_round_in_opposite_directions_pass() -> None:
    """Two face each other on the circle and want to be where the other one is."""
    starts = circle(4)
    goals = starts[::-1]
    ends, nearest, clearance = fly(starts, goals, OBJECT, 30.0)
    assert np.linalg.norm(ends - goals, axis=1).max() < 0.05
    assert nearest > 2 * CONFIG.avoidance.radius_m - 0.05
    assert clearance > CONFIG.space.standoff_m - 0.05


def far_apart(points: np.ndarray) -> bool:
    apart = separation(points[:, None], points[None], 2.0) + 9.0 * np.eye(len(points))
    free = min(column(OBJECT).distance(p) for p in points) > CONFIG.space.standoff_m
    return bool(apart.min() >= CONFIG.space.separation_m) and free


@pytest.mark.slow
@given(seed=st.integers(0, 100_000), sigma_m=st.sampled_from([0.0, 0.05, 0.08]))
@settings(max_examples=15, deadline=None)
def test_random_situations_are_safe_and_resolved(seed: int, sigma_m: float) -> None:
    rng = np.random.default_rng(seed)

    def places() -> np.ndarray:
        space = CONFIG.space
        angle = rng.uniform(0, 2 * np.pi, 4)
        radius = rng.uniform(1.3, space.fence_radius_m - 0.05, 4)
        height = rng.uniform(space.floor_m + 0.05, space.ceiling_m - 0.05, 4)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)

    starts, goals = places(), places()
    assume(far_apart(starts))
    assume(far_apart(goals))
    ends, nearest, clearance = fly(starts, goals, OBJECT, 40.0, sigma_m=sigma_m)
    assert nearest > 2 * CONFIG.avoidance.radius_m - 0.1
    assert clearance > CONFIG.space.standoff_m - 0.05
    assert np.linalg.norm(ends - goals, axis=1).max() < 0.15


def test_the_fence_holds_against_a_drone_that_wants_out() -> None:
    position = np.array([[CONFIG.space.fence_radius_m - 0.5, 0.0, 1.0]])
    agent = Agent("a", position[0], np.array([0.5, 0, 0]), np.array([0.5, 0.0, -0.5]))
    for _ in range(200):
        velocity = avoid([agent], [], CONFIG.space, CONFIG.avoidance, DT_S)[0]
        agent = Agent(
            "a", agent.position_world + DT_S * velocity, velocity, velocity * 0 + [1, 0, -1]
        )
        assert np.hypot(*agent.position_world[:2]) <= CONFIG.space.fence_radius_m + 1e-6
        assert agent.position_world[2] >= CONFIG.space.floor_m - 1e-6


def test_a_drone_inside_the_standoff_leaves_it() -> None:
    agent = Agent("a", np.array([0.7, 0.0, 0.8]), np.zeros(3), np.zeros(3))
    obstacle = [Obstacle(OBJECT, CONFIG.space.standoff_m)]
    velocity = avoid([agent], obstacle, CONFIG.space, CONFIG.avoidance, DT_S)[0]
    assert velocity[0] > 0.1


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


@pytest.mark.slow
def test_a_drone_that_hovers_beside_the_object_is_passed_on_the_open_side() -> None:
    """The right-hand rule alone would push the other drone against the object for ever."""
    target = box(-0.32, -0.43, 0.0, 0.32, 0.43, 1.0)
    starts = np.array([[-1.72, 0.9, 0.8], [-0.805, 1.571, 1.18]])
    goals = np.array([[0.972, 1.069, 0.81], [-0.805, 1.571, 1.18]])
    ends, nearest, clearance = fly(starts, goals, target, 30.0, sigma_m=0.1)
    assert np.linalg.norm(ends - goals, axis=1).max() < 0.1
    assert nearest > 2 * CONFIG.avoidance.radius_m
    assert clearance > CONFIG.space.standoff_m - 0.05
