"""The standard ring: even, on one circle, centred, filled as asked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import FlightSpace, PlannerConfig
from server.planner.errors import PlanError
from server.planner.ring import frame_fill, ring_assignment, standard_ring

CONFIG = PlannerConfig()
TALL = Box3(np.array([-0.3, -0.25, 0.0]), np.array([0.3, 0.25, 1.75]))


def ring(target: Box3 = TALL, drones: int = 4, rounds: int = 6, config: PlannerConfig = CONFIG):
    starts = [0.1 + 2 * np.pi * i / drones for i in range(drones)]
    return standard_ring(target, drones, rounds, TELLO_INTRINSICS, TELLO_TILT_RAD, config, starts)


@pytest.mark.parametrize(("drones", "rounds"), [(1, 6), (2, 3), (4, 6), (8, 3)])
def test_all_pictures_are_evenly_spaced_on_one_circle(drones: int, rounds: int) -> None:
    positions = np.array([v.position_world for views in ring(TALL, drones, rounds) for v in views])
    offset = positions - TALL.centre
    assert np.ptp(np.hypot(offset[:, 0], offset[:, 1])) < 1e-9
    assert np.ptp(positions[:, 2]) < 1e-9
    azimuths = np.sort(np.arctan2(offset[:, 1], offset[:, 0]) % (2 * np.pi))
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2 * np.pi))
    np.testing.assert_allclose(gaps, 2 * np.pi / (drones * rounds), atol=1e-9)


def test_the_larger_side_fills_the_wanted_share_and_the_centre_is_in_the_middle() -> None:
    views = [v for row in ring() for v in row]
    fills = [frame_fill(TALL, v, TELLO_INTRINSICS, TELLO_TILT_RAD) for v in views]
    assert max(fills) == pytest.approx(0.6, abs=0.03)
    for view in views:
        pixels, _ = TELLO_INTRINSICS.project(TALL.centre[None], view.T_world_cam(TELLO_TILT_RAD))
        np.testing.assert_allclose(pixels[0], [479.5, 359.5], atol=1e-6)


def test_a_small_object_is_not_approached_nearer_than_the_standoff() -> None:
    tiny = Box3(np.array([-0.02, -0.02, 0.4]), np.array([0.02, 0.02, 0.44]))
    for view in ring(tiny)[0]:
        assert tiny.distance(np.append(view.position_world[:2], 0.42)) >= (
            CONFIG.space.standoff_m - 1e-9
        )


def test_a_tight_fence_keeps_the_ring_off_it_rather_than_off_the_object() -> None:
    tiny = Box3(np.array([-0.02, -0.02, 0.4]), np.array([0.02, 0.02, 0.44]))

    def radius_m(fence_m: float) -> float:
        config = PlannerConfig(space=FlightSpace(fence_radius_m=fence_m))
        return float(np.hypot(*ring(tiny, config=config)[0][0].position_world[:2]))

    space, off_m = CONFIG.space, CONFIG.candidates.off_fence_m
    assert radius_m(4.0) >= space.view_standoff_m
    nearest_m = float(np.hypot(0.02, 0.02)) + space.standoff_m
    for fence_m in (1.1, 1.2, 1.3, 1.45):
        assert radius_m(fence_m) == pytest.approx(nearest_m, abs=0.01)
    assert radius_m(2.0) < 2.0 - off_m


def test_many_drones_keep_their_separation_on_the_ring() -> None:
    small = Box3(np.array([-0.1, -0.1, 0.3]), np.array([0.1, 0.1, 0.5]))
    positions = np.array([v.position_world for v in ring(small, 8, 3)[0]])
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2) + 9.0 * np.eye(8)
    assert apart.min() >= CONFIG.space.separation_m - 1e-9


@given(
    start=st.floats(-10, 10),
    errors=st.lists(st.floats(-0.26, 0.26), min_size=4, max_size=4),
    order=st.permutations(range(4)),
)
@settings(max_examples=30, deadline=None)
def test_drones_keep_their_order_and_move_little(
    start: float, errors: list[float], order: list[int]
) -> None:
    azimuths = [start + order[i] * np.pi / 2 + errors[i] for i in range(4)]
    views = standard_ring(TALL, 4, 1, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG, azimuths)[0]
    for azimuth, view in zip(azimuths, views, strict=True):
        offset = view.position_world - TALL.centre
        turn = np.angle(np.exp(1j * (np.arctan2(offset[1], offset[0]) - azimuth)))
        assert abs(turn) <= 2 * 0.26 + 1e-9


def test_a_fence_inside_the_standoff_is_named() -> None:
    with pytest.raises(PlanError, match="fence"):
        ring(config=PlannerConfig(space=FlightSpace(fence_radius_m=0.9)))


def test_assignment_names_the_drones_in_order() -> None:
    rounds = ring(drones=2, rounds=2)
    assignment = ring_assignment(["b", "a"], rounds)
    assert assignment.rounds[1]["a"] is rounds[1][1]
    with pytest.raises(ValueError, match="zip"):
        ring_assignment(["only"], rounds)
