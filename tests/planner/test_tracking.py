"""The PID in closed loop with a lagging drone, and its signs one by one."""

from __future__ import annotations

import numpy as np
import pytest
from planner_objects import box, pose_at, seed_of

from server.geometry.axes import wrap_angle
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import TrackingConfig
from server.planner.ring import facing
from server.planner.tracking import (
    BoxTracker,
    box_errors,
    expected_box,
    fly_to,
    wanted_view,
)
from server.stages import HOVER, Box, CameraPose, SeedGeometry, Viewpoint

SEED = seed_of(box(-0.35, -0.15, 0.25, 0.35, 0.15, 0.45), box(-0.3, -0.1, 0, 0.3, 0.1, 0.25))
VIEW = facing(SEED.outer.centre, np.deg2rad(35.0), 1.6, 0.6)
CONFIG = TrackingConfig()
DT_S = 0.05
LAG_S = 0.35


def seen_from(pose: CameraPose, seed: SeedGeometry = SEED) -> Box:
    view = Viewpoint(pose.position_world, pose.yaw_rad)
    xyxy = expected_box(seed, view, TELLO_INTRINSICS, TELLO_TILT_RAD)
    size = [TELLO_INTRINSICS.width - 1, TELLO_INTRINSICS.height - 1] * 2
    clipped = np.clip(xyxy, 0, size)
    return Box(clipped, 1.0, bool((clipped != xyxy).any()))


def displaced(
    forward: float = 0.0, left: float = 0.0, up: float = 0.0, yaw: float = 0.0
) -> CameraPose:
    cos, sin = np.cos(VIEW.yaw_rad), np.sin(VIEW.yaw_rad)
    x, y, z = VIEW.position_world + np.array(
        [cos * forward - sin * left, sin * forward + cos * left, up]
    )
    return pose_at("a", x, y, z, VIEW.yaw_rad + yaw)


@pytest.mark.parametrize(
    ("forward", "left", "up", "yaw_deg"),
    [
        (0.2, 0.0, 0.0, 0.0),
        (-0.2, 0.1, 0.0, 5.0),
        (0.0, 0.2, 0.0, 10.0),
        (0.0, -0.2, 0.1, 10.0),
        (0.1, 0.15, -0.1, -10.0),
    ],
)
def test_the_loop_converges_with_a_lagging_drone(
    forward: float, left: float, up: float, yaw_deg: float
) -> None:
    pose = displaced(forward, left, up, np.deg2rad(yaw_deg))
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    tracker = BoxTracker(CONFIG)
    rates = np.zeros(4)
    position, yaw = pose.position_world.copy(), pose.yaw_rad
    for _ in range(round(15.0 / DT_S)):
        setpoint = tracker.update(seen_from(pose), pose, wanted, DT_S)
        asked = np.append(setpoint.velocity_m_s, setpoint.yaw_rate_rad_s)
        assert np.linalg.norm(setpoint.velocity_m_s) <= CONFIG.speed_max_m_s + 1e-9
        rates += (asked - rates) * DT_S / LAG_S
        cos, sin = np.cos(yaw), np.sin(yaw)
        position = position + DT_S * np.array(
            [cos * rates[0] - sin * rates[1], sin * rates[0] + cos * rates[1], rates[2]]
        )
        yaw += DT_S * rates[3]
        pose = pose_at("a", *position, yaw)
    assert np.linalg.norm(position - VIEW.position_world) < 0.03
    assert abs(wrap_angle(yaw - VIEW.yaw_rad)) < np.deg2rad(1.0)


def test_equation_4_alone_also_converges() -> None:
    """Without the heading's share, yaw and roll are coupled, as in the paper; they still settle."""
    config = TrackingConfig(heading_share=0.0)
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    pose = displaced(left=0.15, yaw=np.deg2rad(4.0))
    position, yaw = pose.position_world.copy(), pose.yaw_rad
    for _ in range(round(60.0 / DT_S)):
        errors = box_errors(seen_from(pose), pose, wanted, config.heading_share)
        cos, sin = np.cos(yaw), np.sin(yaw)
        step = 0.5 * np.array([errors.forward_m, errors.left_m, errors.up_m])
        position = position + DT_S * np.array(
            [cos * step[0] - sin * step[1], sin * step[0] + cos * step[1], step[2]]
        )
        yaw += DT_S * 0.2 * errors.yaw_rad
        pose = pose_at("a", *position, yaw)
    assert np.linalg.norm(position - VIEW.position_world) < 0.02
    assert abs(wrap_angle(yaw - VIEW.yaw_rad)) < np.deg2rad(1.0)


def test_every_axis_moves_against_its_own_error() -> None:
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)

    def errors(pose: CameraPose):
        return box_errors(seen_from(pose), pose, wanted, 1.0)

    right = errors(displaced())
    assert max(abs(v) for v in (right.forward_m, right.left_m, right.up_m, right.yaw_rad)) < 1e-9
    assert errors(displaced(forward=0.1)).forward_m == pytest.approx(-0.1, abs=0.03)
    assert errors(displaced(left=0.1)).left_m == pytest.approx(-0.1, abs=0.03)
    assert errors(displaced(up=0.1)).up_m == pytest.approx(-0.1, abs=0.03)
    assert errors(displaced(yaw=0.1)).yaw_rad == pytest.approx(-0.1, abs=0.01)
    # A place aside alone is not a wrong heading.
    assert errors(displaced(left=0.1)).yaw_rad == pytest.approx(0.0, abs=0.01)


def test_no_box_means_hover_and_no_memory() -> None:
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    tracker, fresh = BoxTracker(CONFIG), BoxTracker(CONFIG)
    pose = displaced(left=0.2)
    for _ in range(50):
        tracker.update(seen_from(pose), pose, wanted, DT_S)
    assert tracker.update(None, pose, wanted, DT_S) is HOVER
    after = tracker.update(seen_from(pose), pose, wanted, DT_S)
    first = fresh.update(seen_from(pose), pose, wanted, DT_S)
    np.testing.assert_array_equal(after.velocity_m_s, first.velocity_m_s)
    with pytest.raises(ValueError, match="dt_s"):
        tracker.update(None, pose, wanted, 0.0)


def test_a_box_cut_off_by_the_picture_does_not_pull_forward() -> None:
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    cut = Box(np.array([0.0, 100.0, 50.0, 300.0]), 1.0, True)
    assert box_errors(cut, displaced(), wanted, 1.0).forward_m == 0.0


def test_the_integral_is_limited() -> None:
    wanted = wanted_view(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    tracker = BoxTracker(CONFIG)
    far, near = displaced(left=0.3), displaced()
    for _ in range(2_000):
        tracker.update(seen_from(far), far, wanted, 0.5)
    settled = tracker.update(seen_from(near), near, wanted, 1e3)
    assert abs(settled.velocity_m_s[1]) <= CONFIG.roll.integral_limit + 0.05


def test_expected_box_is_the_hull_of_the_slices() -> None:
    xyxy = expected_box(SEED, VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    outer = expected_box(SeedGeometry(SEED.outer, (), 4), VIEW, TELLO_INTRINSICS, TELLO_TILT_RAD)
    assert (xyxy[:2] >= outer[:2] - 1e-9).all()
    assert (xyxy[2:] <= outer[2:] + 1e-9).all()
    with pytest.raises(ValueError, match="in front"):
        expected_box(
            SEED, Viewpoint(np.array([0.0, 0, 0.3]), 0.0), TELLO_INTRINSICS, TELLO_TILT_RAD
        )


def test_fly_to_goes_straight_and_turns_the_shorter_way() -> None:
    pose = pose_at("a", 0, 0, 1, yaw_rad=3.0)
    velocity, rate = fly_to(pose, Viewpoint(np.array([0.0, 3.0, 1.0]), -3.0), CONFIG)
    np.testing.assert_allclose(velocity, [0, CONFIG.travel_speed_m_s, 0])
    assert rate == pytest.approx(CONFIG.yaw.p * (2 * np.pi - 6.0))
    velocity, rate = fly_to(pose, Viewpoint(pose.position_world, 3.0), CONFIG)
    assert np.linalg.norm(velocity) == rate == 0.0
