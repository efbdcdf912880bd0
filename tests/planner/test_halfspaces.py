"""The half-space solver against sampling, optimality conditions and a general optimiser."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from server.planner.halfspaces import (
    Ball,
    Row,
    Vector,
    least_violating_velocity,
    nearest_velocity,
)

SPEED = Ball((0.0, 0.0, 0.0), 0.5)


def problem(seed: int, count: int) -> tuple[Vector, list[Row], Ball]:
    """Return a wish, rows and a second ball that meets the first."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = rng.uniform(-0.4, 0.15, count)
    rows = [(*n, o) for n, o in zip(normals.tolist(), offsets.tolist(), strict=True)]
    wanted = (rng.normal(size=3) * 0.6).tolist()
    centre = rng.normal(size=3)
    centre *= 0.5 * rng.uniform() / np.linalg.norm(centre)
    return tuple(wanted), rows, Ball(tuple(centre.tolist()), rng.uniform(0.05, 0.6))


def holds(v: np.ndarray, rows: list[Row], balls: list[Ball], slack: float) -> np.ndarray:
    """Return which of ``v`` ``(n, 3)`` satisfy everything."""
    table = np.array(rows).reshape(-1, 4)
    fine = (v @ table[:, :3].T >= table[:, 3] - slack).all(axis=1)
    for ball in balls:
        fine &= np.linalg.norm(v - ball.centre, axis=1) <= ball.radius + slack
    return np.asarray(fine)


@given(seed=st.integers(0, 1_000_000), count=st.integers(0, 9), two=st.booleans())
@settings(max_examples=1500, deadline=None)
def test_what_is_found_is_feasible_and_no_sampled_velocity_is_nearer(
    seed: int, count: int, two: bool
) -> None:
    wanted, rows, second = problem(seed, count)
    balls = [SPEED, second] if two else [SPEED]
    found = nearest_velocity(wanted, rows, SPEED, second if two else None)
    rng = np.random.default_rng(seed + 1)
    trial = rng.normal(size=(400, 3))
    trial *= rng.uniform(size=(400, 1)) ** (1 / 3) / np.linalg.norm(trial, axis=1, keepdims=True)
    trial = trial * balls[-1].radius + balls[-1].centre
    feasible = trial[holds(trial, rows, balls, 0.0)]
    if found is None:
        assert len(feasible) == 0
        return
    assert holds(np.array([found]), rows, balls, 1e-6).all()
    if len(feasible):
        nearest = np.linalg.norm(feasible - wanted, axis=1).min()
        assert math.dist(found, wanted) <= nearest + 1e-6


@given(seed=st.integers(0, 1_000_000), count=st.integers(0, 9))
@settings(max_examples=100, deadline=None)
def test_a_general_optimiser_finds_the_same(seed: int, count: int) -> None:
    wanted, rows, second = problem(seed, count)
    found = nearest_velocity(wanted, rows, SPEED, second)
    table = np.array(rows).reshape(-1, 4)
    constraints = [
        {"type": "ineq", "fun": lambda v: table[:, :3] @ v - table[:, 3]},
        {"type": "ineq", "fun": lambda v: SPEED.radius**2 - v @ v},
        {
            "type": "ineq",
            "fun": lambda v: second.radius**2 - (v - second.centre) @ (v - second.centre),
        },
    ]
    peer = minimize(
        lambda v: (v - wanted) @ (v - wanted),
        np.array(second.centre),
        jac=lambda v: 2 * (v - wanted),
        constraints=constraints[0 if count else 1 :],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 200},
    )
    if peer.success and holds(peer.x[None], rows, [SPEED, second], 1e-7).all():
        assert found is not None
        np.testing.assert_allclose(found, peer.x, atol=2e-4)


@given(seed=st.integers(0, 1_000_000), count=st.integers(4, 12))
@settings(max_examples=150, deadline=None)
def test_none_is_said_only_where_a_linear_programme_agrees(seed: int, count: int) -> None:
    """With rows alone deciding: a cube inside the ball must be empty when None is returned."""
    wanted, rows, _ = problem(seed, count)
    rows = [(x, y, z, o + 0.1) for x, y, z, o in rows]
    found = nearest_velocity(wanted, rows, SPEED)
    table = np.array(rows)
    half = 0.5 / math.sqrt(3.0)
    inside = linprog(np.zeros(3), -table[:, :3], -table[:, 3] - 1e-7, bounds=[(-half, half)] * 3)
    around = linprog(np.zeros(3), -table[:, :3], -table[:, 3] + 1e-7, bounds=[(-0.5, 0.5)] * 3)
    if found is None:
        assert inside.status == 2
    else:
        assert around.status == 0


def test_both_balls_may_bind() -> None:
    second = Ball((0.5, 0.0, 0.0), 0.5)
    found = nearest_velocity((0.25, 9.0, 0.0), [], SPEED, second)
    assert found is not None
    np.testing.assert_allclose(found, (0.25, math.sqrt(0.25 - 0.0625), 0.0), atol=1e-9)
    # A row that cuts the circle where the spheres meet.
    found = nearest_velocity((0.25, 9.0, 0.0), [(0.0, -1.0, 0.0, -0.3)], SPEED, second)
    assert found is not None
    assert found[1] == pytest.approx(0.3)
    assert math.hypot(*found) <= 0.5 + 1e-9


def test_rows_that_contradict_are_violated_equally_and_hard_ones_not() -> None:
    rows = [(1.0, 0.0, 0.0, 0.2), (-1.0, 0.0, 0.0, 0.1), (0.0, 0.0, 1.0, 0.05)]
    wanted = (0.0, 0.1, 0.0)
    assert nearest_velocity(wanted, rows, SPEED) is None
    velocity = least_violating_velocity(wanted, rows, [1.0, 1.0, 0.0], SPEED)
    np.testing.assert_allclose(velocity, [0.05, 0.1, 0.05], atol=1e-3)
    # One that bears twice as much is violated twice as much.
    velocity = least_violating_velocity(wanted, rows, [1.0, 0.5, 0.0], SPEED)
    np.testing.assert_allclose(velocity, [0.0, 0.1, 0.05], atol=1e-3)


@given(seed=st.integers(0, 1_000_000), count=st.integers(1, 9))
@settings(max_examples=150, deadline=None)
def test_the_relaxation_is_the_least_that_sampling_knows(seed: int, count: int) -> None:
    wanted, rows, second = problem(seed, count)
    rows = [(x, y, z, o + 0.4) for x, y, z, o in rows]
    if nearest_velocity(wanted, rows, SPEED, second) is not None:
        return
    found = least_violating_velocity(wanted, rows, [1.0] * count, SPEED, second)
    table = np.array(rows)

    def worst(v: np.ndarray) -> np.ndarray:
        return (table[:, 3] - v @ table[:, :3].T).max(axis=-1)

    rng = np.random.default_rng(seed)
    trial = rng.normal(size=(3000, 3))
    trial *= rng.uniform(size=(3000, 1)) ** (1 / 3) / np.linalg.norm(trial, axis=1, keepdims=True)
    trial = trial * second.radius + second.centre
    trial = trial[np.linalg.norm(trial, axis=1) <= 0.5]
    assert holds(np.array([found]), [], [SPEED, second], 1e-6).all()
    assert worst(np.array(found)) <= worst(trial).min() + 1e-3


@pytest.mark.parametrize("o", [0.7, 5.0])
def test_hopeless_rows_still_give_a_velocity_within_the_limits(o: float) -> None:
    rows = [(1.0, 0.0, 0.0, o), (-1.0, 0.0, 0.0, o), (0.0, 1.0, 0.0, o)]
    far = Ball((0.3, 0.4, 0.0), 1e-9)
    velocity = least_violating_velocity((0.1, 0.0, 0.0), rows, [0.0, 0.0, 0.0], SPEED, far)
    np.testing.assert_allclose(velocity, far.centre, atol=1e-6)
