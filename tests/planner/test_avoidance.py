"""One step of avoidance: what holds in every situation."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_objects import box, pose_at

from server.geometry.boxes import Box3
from server.planner.avoidance import (
    Agent,
    Obstacle,
    agent_from_pose,
    avoid,
    bounds_of,
    drone_row,
    movers_of,
    protected_radius,
    wall_rows,
)
from server.planner.config import AvoidanceConfig, PlannerConfig

CONFIG = PlannerConfig()
SPACE, AVOIDANCE = CONFIG.space, CONFIG.avoidance
PLAIN = dataclasses.replace(AVOIDANCE, sidestep=0.0, sidestep_stalled=0.0)
OBJECT = Obstacle(box(-0.4, -0.2, 0.0, 0.4, 0.2, 0.6), 0.5)
LAMP = Obstacle(box(1.5, 1.5, 1.8, 1.8, 1.8, 3.0), 0.3, endless=False)
DT_S = 1.0 / 15.0


def agent(name: str, x, v=(0.0, 0.0, 0.0), wish=(0.0, 0.0, 0.0), **more) -> Agent:
    return Agent(name, np.array(x, float), np.array(v, float), np.array(wish, float), **more)


def situation(seed: int, count: int) -> list[Agent]:
    """Return drones anywhere, also too close, outside the fence or inside the object."""
    rng = np.random.default_rng(seed)
    spread = rng.choice([0.5, 1.5, 4.5])
    return [
        agent(
            str(i),
            [*rng.uniform(-spread, spread, 2), rng.uniform(0.1, 2.3)],
            rng.normal(size=3) * 0.3,
            rng.normal(size=3) * 0.4,
            sigma_m=float(rng.choice([0.0, 0.05, 0.3])),
            yields=bool(rng.uniform() < 0.9),
        )
        for i in range(count)
    ]


def rows_of(agents: list[Agent], index: int, config: AvoidanceConfig) -> list:
    """Return every half-space of one drone, before anybody gives in."""
    boxes = [bounds_of(obstacle) for obstacle in (OBJECT, LAMP)]
    movers = movers_of(agents, boxes, SPACE, config)
    rows = wall_rows(movers[index], boxes, SPACE, config)
    others = [i for i in range(len(agents)) if i != index]
    return rows + [drone_row(movers, index, i, config, DT_S) for i in others]


@given(seed=st.integers(0, 10_000_000), count=st.integers(1, 8))
@settings(max_examples=1500, deadline=None)
def test_every_velocity_is_finite_slow_enough_and_reachable(seed: int, count: int) -> None:
    agents = situation(seed, count)
    reach = AVOIDANCE.acceleration_max_m_s2 * AVOIDANCE.lag_s
    for told, one in zip(
        avoid(agents, [OBJECT, LAMP], SPACE, AVOIDANCE, DT_S), agents, strict=True
    ):
        assert told.shape == (3,)
        assert np.isfinite(told).all()
        assert np.linalg.norm(told) <= AVOIDANCE.speed_max_m_s + 1e-6
        v = one.velocity_world
        v = v * min(1.0, AVOIDANCE.speed_max_m_s / max(float(np.linalg.norm(v)), 1e-9))
        assert np.linalg.norm(told - v) <= reach + 1e-6


@given(seed=st.integers(0, 10_000_000), count=st.integers(1, 6))
@settings(max_examples=800, deadline=None)
def test_half_spaces_hold_when_feasible_and_nothing_sampled_deviates_less(
    seed: int, count: int
) -> None:
    agents = situation(seed, count)
    told = avoid(agents, [OBJECT, LAMP], SPACE, PLAIN, DT_S)
    rng = np.random.default_rng(seed + 1)
    trial = rng.normal(size=(500, 3))
    trial *= rng.uniform(size=(500, 1)) ** (1 / 3) / np.linalg.norm(trial, axis=1, keepdims=True)
    reach = PLAIN.acceleration_max_m_s2 * PLAIN.lag_s
    movers = movers_of(agents, [], SPACE, PLAIN)
    tables = [np.array(rows_of(agents, i, PLAIN)) for i in range(count)]
    fine = [
        bool((table[:, :3] @ v >= table[:, 3] - 1e-6).all())
        for v, table in zip(told, tables, strict=True)
    ]
    if not all(fine):
        return  # Somebody had to compromise, which moves the others' half-spaces.
    for i in range(count):
        points = trial * PLAIN.speed_max_m_s
        allowed = (points @ tables[i][:, :3].T >= tables[i][:, 3]).all(axis=1)
        allowed &= np.linalg.norm(points - movers[i].velocity, axis=1) <= reach
        if allowed.any():
            nearest = np.linalg.norm(points[allowed] - movers[i].wanted, axis=1).min()
            assert np.linalg.norm(told[i] - movers[i].wanted) <= nearest + 1e-6


def test_feasible_situations_are_common_enough_for_that_to_mean_something() -> None:
    feasible = 0
    for seed in range(200):
        agents = situation(seed, 4)
        told = avoid(agents, [OBJECT, LAMP], SPACE, PLAIN, DT_S)
        tables = [np.array(rows_of(agents, i, PLAIN)) for i in range(4)]
        feasible += all(
            bool((t[:, :3] @ v >= t[:, 3] - 1e-6).all()) for v, t in zip(told, tables, strict=True)
        )
    assert 25 <= feasible <= 175


@given(seed=st.integers(0, 10_000_000), turns=st.integers(1, 7))
@settings(max_examples=300, deadline=None)
def test_the_order_of_drones_and_a_turn_of_the_world_change_nothing(seed: int, turns: int) -> None:
    agents = situation(seed, 3)
    target = Obstacle(box(-0.3, -0.3, 0.0, 0.3, 0.3, 0.6), 0.5)
    told = np.array(avoid(agents, [target], SPACE, AVOIDANCE, DT_S))
    back = np.array(avoid(agents[::-1], [target], SPACE, AVOIDANCE, DT_S))[::-1]
    vertical = any(np.linalg.norm(a.preferred_world[:2]) < 0.1 for a in agents)
    if not vertical:  # Whoever wants straight up or down steps aside by its number.
        np.testing.assert_allclose(told, back, atol=5e-3)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turn = np.linalg.matrix_power(quarter, turns)
    turned = [
        dataclasses.replace(
            a,
            position_world=turn @ a.position_world,
            velocity_world=turn @ a.velocity_world,
            preferred_world=turn @ a.preferred_world,
        )
        for a in agents
    ]
    if not vertical:
        again = np.array(avoid(turned, [target], SPACE, AVOIDANCE, DT_S))
        np.testing.assert_allclose(again, told @ turn.T, atol=5e-3)


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_drones_in_a_symmetric_meeting_choose_symmetric_ways(count: int) -> None:
    angles = 2 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], 1)
    agents = [agent(str(i), 1.6 * d + [0, 0, 1], -0.3 * d, -0.5 * d) for i, d in enumerate(ring)]
    told = avoid(agents, [], SPACE, AVOIDANCE, DT_S)
    around = np.cross([0.0, 0.0, 1.0], ring)
    inwards = [-float(v @ d) for v, d in zip(told, ring, strict=True)]
    sideways = [float(v @ a) for v, a in zip(told, around, strict=True)]
    np.testing.assert_allclose(inwards, inwards[0], atol=1e-6)
    np.testing.assert_allclose(sideways, sideways[0], atol=1e-6)
    # All to their right: the crowd turns counter-clockwise.
    assert sideways[0] > 0.02


@given(seed=st.integers(0, 10_000_000))
@settings(max_examples=1000, deadline=None)
def test_told_velocities_keep_two_drones_apart_for_the_horizon(seed: int) -> None:
    """The half-spaces' promise, checked along the straight lines that they are about."""
    rng = np.random.default_rng(seed)
    a, b = (
        agent(n, rng.uniform([-2, -2, 0.6], [2, 2, 1.9]), wish=rng.normal(size=3) * 0.4)
        for n in "ab"
    )
    squash = np.array([1.0, 1.0, 1.0 / PLAIN.downwash_factor])
    p = squash * (b.position_world - a.position_world)
    R = 2 * PLAIN.radius_m
    if np.linalg.norm(p) < R:
        return
    u, w = avoid([a, b], [], SPACE, PLAIN, DT_S)
    times = np.linspace(0.0, PLAIN.horizon_s, 100)[:, None]
    gap = np.linalg.norm(p + times * (squash * (w - u)), axis=1)
    assert gap.min() >= R - 1e-6


def test_two_head_on_drones_take_half_of_the_way_out_each_and_a_held_one_none() -> None:
    a = agent("a", [-1.5, 0, 1], [0.4, 0, 0], [0.4, 0, 0])
    b = agent("b", [1.5, 0, 1], [-0.4, 0, 0], [-0.4, 0, 0])
    both = avoid([a, b], [], SPACE, PLAIN, DT_S)
    np.testing.assert_allclose(both[0], -both[1] * [1, 1, -1], atol=1e-9)
    held = dataclasses.replace(b, velocity_world=np.zeros(3), yields=False)
    alone = avoid([a, held], [], SPACE, PLAIN, DT_S)[0]
    gone = a.position_world + PLAIN.horizon_s * alone
    # The stop point is that much nearer while both close in.
    ahead = (PLAIN.lag_s + PLAIN.latency_s) * 0.4
    assert np.linalg.norm(held.position_world - [ahead, 0, 0] - gone) >= 0.8 - 1e-3


@pytest.mark.parametrize("rise_m", [0.9, 1.3, 1.55])
def test_a_drone_above_another_keeps_twice_the_distance(rise_m: float) -> None:
    low = agent("low", [1.5, 1.0, 0.5])
    high = agent("high", [1.5, 1.0, 0.5 + rise_m])
    down, up = avoid([low, high], [], dataclasses.replace(SPACE, ceiling_m=5.0), PLAIN, DT_S)
    assert up[2] > 0.01
    beside = agent("beside", [1.5 + rise_m, 1.0, 0.5])
    left, _ = avoid([low, beside], [], SPACE, PLAIN, DT_S)
    assert (np.linalg.norm(left) > 0.01) == (rise_m < 0.8)
    assert down[2] <= 0.0


def test_a_passing_drone_with_a_lag_never_comes_nearer_than_without() -> None:
    """Closing in at speed counts as being nearer; parting does not count as being farther."""
    still = [agent("a", [0, 0, 1]), agent("b", [1.2, 0, 1])]
    closing = [dataclasses.replace(still[0], velocity_world=np.array([0.5, 0, 0])), still[1]]
    parting = [dataclasses.replace(still[0], velocity_world=np.array([-0.5, 0, 0])), still[1]]
    offsets = [
        drone_row(movers_of(agents, [], SPACE, PLAIN), 0, 1, PLAIN, DT_S)[3]
        for agents in (still, closing, parting)
    ]
    assert offsets[1] > offsets[0] == offsets[2]


def test_an_uncertain_pose_grows_the_sphere_up_to_a_limit() -> None:
    sure, unsure, lost, unknown = (
        protected_radius(sigma_m, AVOIDANCE) for sigma_m in (0.0, 0.06, 3.0, math.nan)
    )
    assert sure == AVOIDANCE.radius_m
    assert unsure == pytest.approx(AVOIDANCE.radius_m + 0.06)
    assert lost == unknown == AVOIDANCE.radius_m + AVOIDANCE.sigma_margin_max_m


def test_the_agent_of_a_pose_has_its_uncertainty() -> None:
    one = agent_from_pose(pose_at("a", 1, 2, 1, sigma_m=0.07), np.zeros(3), np.ones(3))
    assert one.sigma_m == pytest.approx(0.07)
    np.testing.assert_allclose(one.position_world, [1, 2, 1])
    assert one.yields


@pytest.mark.parametrize("inside_m", [-0.3, 0.0, 0.2, 0.6])
def test_the_object_pushes_out_and_lets_along(inside_m: float) -> None:
    one = agent("a", [0.4 + 0.5 - inside_m, 0.0, 1.4])
    boxes = [bounds_of(OBJECT)]
    nx, ny, nz, offset = wall_rows(movers_of([one], boxes, SPACE, PLAIN)[0], boxes, SPACE, PLAIN)[0]
    np.testing.assert_allclose([nx, ny, nz], [1.0, 0, 0], atol=1e-9)
    assert (offset > 0) == (inside_m > 0)


def test_nobody_flies_above_the_object_but_above_a_no_go_volume() -> None:
    crate = Box3(np.array([1.0, -0.3, 0.0]), np.array([1.6, 0.3, 0.5]))
    above = [agent("a", [1.3, 0.0, 1.5], wish=[0.2, 0.0, 0.0])]
    over = avoid(above, [Obstacle(crate, 0.3, endless=False)], SPACE, AVOIDANCE, DT_S)[0]
    np.testing.assert_allclose(over, [0.2, 0.0, 0.0])
    sinking = [agent("a", [1.3, 0.0, 0.81], wish=[0.0, 0.0, -0.3])]
    low = avoid(sinking, [Obstacle(crate, 0.3, endless=False)], SPACE, AVOIDANCE, DT_S)[0]
    assert low[2] >= -0.011
    out = avoid(above, [Obstacle(crate, 0.3)], SPACE, AVOIDANCE, DT_S)[0]
    assert np.linalg.norm(out[:2]) > 0.2


@given(
    seed=st.integers(0, 10_000_000),
    lag_s=st.floats(0.1, 0.45),
    speed=st.floats(0.1, 0.5),
)
@settings(max_examples=25, deadline=None)
def test_a_drone_with_a_lag_at_full_speed_still_stops_before_every_wall(
    seed: int, lag_s: float, speed: float
) -> None:
    rng = np.random.default_rng(seed)
    heading = rng.normal(size=3)
    heading /= np.linalg.norm(heading)
    x, v = np.array([1.6, 0.0, 1.2]), speed * heading
    for _ in range(120):
        told = avoid([agent("a", x, v, heading)], [OBJECT], SPACE, AVOIDANCE, DT_S)[0]
        for _ in range(4):
            v = v + (told - v) * (1.0 - math.exp(-DT_S / 4 / lag_s))
            x = x + v * DT_S / 4
        assert np.hypot(x[0], x[1]) <= SPACE.fence_radius_m + 0.005
        assert SPACE.floor_m - 0.005 <= x[2] <= SPACE.ceiling_m + 0.005
        beyond = np.maximum(np.abs(x[:2]) - [0.4, 0.2], 0.0)
        assert np.linalg.norm(beyond) >= OBJECT.standoff_m - 0.005


@pytest.mark.parametrize("nonsense", [math.nan, math.inf, 1e300])
def test_nonsense_never_leads_to_nonsense(nonsense: float) -> None:
    fine = agent("fine", [1.5, 0.0, 1.0], wish=[0.0, 0.3, 0.0])
    for broken in (
        agent("b", [nonsense, 0, 1]),
        agent("b", [1.7, 0.4, 1], [nonsense, 0, 0]),
        agent("b", [1.7, 0.4, 1], wish=[0, nonsense, 0]),
        agent("b", [1.7, 0.4, 1], sigma_m=nonsense),
    ):
        for told in avoid([fine, broken], [OBJECT], SPACE, AVOIDANCE, DT_S):
            assert np.isfinite(told).all()
            assert np.linalg.norm(told) <= AVOIDANCE.speed_max_m_s + 1e-6


@pytest.mark.parametrize("apart_m", [0.1, 0.3, 0.6, 0.79])
def test_drones_that_are_too_close_part_however_much_they_want_to_swap(apart_m: float) -> None:
    """The nearest velocity out of the obstacle would lead through one another."""
    a = agent("a", [1.5, 0.0, 1.0], [0.3, 0.0, 0.0], [0.5, 0.0, 0.0])
    b = agent("b", [1.5 + apart_m, 0.0, 1.0], [-0.3, 0.0, 0.0], [-0.5, 0.0, 0.0])
    left, right = avoid([a, b], [], SPACE, AVOIDANCE, DT_S)
    assert left[0] < 0.0 < right[0]


def test_drones_believed_in_the_same_place_part() -> None:
    agents = [agent(n, [1.5, 0.0, 1.0]) for n in "ab"]
    a, b = avoid(agents, [], SPACE, AVOIDANCE, DT_S)
    assert np.linalg.norm(a - b) > 0.2
