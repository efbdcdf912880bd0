"""Drones that report to stand: those that do, those that drift, and what searches do to either."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.cameras import TELLO_INTRINSICS as CAMERA
from server.mission.standing import StandingWatch
from server.stages import Box

FPS = 6.0
DISTANCE_M, HEIGHT_M = 1.8, 0.9


def box_at(distance_m: float, bearing_rad: float, factor: float, noise_px: np.ndarray) -> Box:
    """Return the box of an object that far away, ``factor`` times as large as it is."""
    half_px = 0.5 * factor * HEIGHT_M / distance_m * CAMERA.fy
    middle = np.array([CAMERA.cx + CAMERA.fx * math.tan(bearing_rad), CAMERA.cy])
    half = np.array([0.4 * half_px, half_px])
    return Box(np.concatenate([middle - half, middle + half]) + noise_px, 0.8, False)


def watched(
    where: Callable[[float], tuple[float, float, float]],
    seconds: float,
    *,
    factor: Callable[[float], float] = lambda _: 1.0,
    seed: int = 0,
) -> tuple[float, float] | None:
    """Return when a drift was noticed and since when it was, None if it was not.

    ``where`` tells by the time how far the object is, in which direction, and the heading.
    """
    rng = np.random.default_rng(seed)
    watch = StandingWatch()
    for at_s in np.arange(0.0, seconds, 1.0 / FPS):
        if rng.random() < 0.15:
            continue
        distance_m, bearing_rad, yaw_rad = where(float(at_s))
        box = box_at(distance_m, bearing_rad, factor(float(at_s)), 8.0 * rng.standard_normal(4))
        watch.observe(box, float(at_s), yaw_rad, CAMERA)
        since_s = watch.drifts_since_s(DISTANCE_M)
        if since_s is not None:
            return float(at_s), since_s
    return None


@given(st.integers(0, 1000), st.floats(0.0, 20.0), st.floats(0.3, 2.5))
def test_a_drone_that_stands_is_believed_whatever_part_of_the_object_is_shown(
    seed: int, when_s: float, factor: float
) -> None:
    def steps(at_s: float) -> float:
        return factor if at_s > when_s else 1.0

    assert watched(lambda _: (DISTANCE_M, 0.0, 0.0), 20.0, factor=steps, seed=seed) is None


@given(st.integers(0, 1000), st.sampled_from([-1.0, 1.0]))
def test_one_that_flies_too_slowly_to_report_it_is_believed(seed: int, way: float) -> None:
    def creeps(at_s: float) -> tuple[float, float, float]:
        return DISTANCE_M + way * 0.05 * at_s, 0.0, 0.0

    assert watched(creeps, 10.0, seed=seed) is None


@pytest.mark.parametrize("away_m_s", [0.2, 0.3, -0.12])
@pytest.mark.parametrize("seed", range(5))
def test_one_that_drifts_away_or_near_is_found_out(away_m_s: float, seed: int) -> None:
    found = watched(lambda at_s: (DISTANCE_M + away_m_s * at_s, 0.0, 0.0), 9.0, seed=seed)
    assert found is not None
    noticed_s, since_s = found
    assert noticed_s - since_s >= 4.5


@pytest.mark.parametrize("seed", range(5))
def test_one_that_drifts_sideways_is_found_out(seed: int) -> None:
    found = watched(
        lambda at_s: (DISTANCE_M, math.atan(0.2 * at_s / DISTANCE_M), 0.0), 8.0, seed=seed
    )
    assert found is not None


@given(st.floats(-0.15, 0.15), st.floats(-math.pi, math.pi))
def test_one_that_turns_on_the_spot_is_believed(turn_rad_s: float, yaw_rad: float) -> None:
    """Counter-clockwise it sees the object move to the right, also over the half turn."""

    def turns(at_s: float) -> tuple[float, float, float]:
        turned = turn_rad_s * (at_s - 2.5)
        heading = (yaw_rad + turned + math.pi) % (2.0 * math.pi) - math.pi
        return DISTANCE_M, turned, heading

    assert watched(turns, 5.5) is None


def test_boxes_that_the_pictures_edge_cuts_say_nothing() -> None:
    watch = StandingWatch()
    for number in range(60):
        box = Box(np.array([300.0, 0.0, 500.0, 400.0 - 5 * number]), 0.8, touches_edge=True)
        watch.observe(box, number / FPS, 0.0, CAMERA)
    assert watch.drifts_since_s(DISTANCE_M) is None


def test_it_begins_anew_when_the_drone_moves() -> None:
    watch = StandingWatch()
    for number in range(60):
        watch.observe(
            box_at(DISTANCE_M + 0.25 * number / FPS, 0.0, 1.0, np.zeros(4)),
            number / FPS,
            0.0,
            CAMERA,
        )
    assert watch.drifts_since_s(DISTANCE_M) is not None
    watch.reset()
    assert watch.drifts_since_s(DISTANCE_M) is None
