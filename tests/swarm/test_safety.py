"""The safety rules: thresholds, and setpoints that lead out of nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.geometry.poses import camera_pose
from server.stages import CameraPose, Setpoint, Telemetry
from server.swarm.config import SafetyConfig, TimingConfig
from server.swarm.safety import (
    fence_for,
    flight_readings,
    limit_setpoint,
    take_off_refusals,
)

CONFIG = SafetyConfig()
SIGMA_M = 0.05
# Twice what is unsure about the poses of these tests.
FENCE_M = CONFIG.fence_radius_m - 2.0 * SIGMA_M
TARGET = Box3(np.array([-0.4, -0.3, 0.0]), np.array([0.4, 0.3, 1.2]))
HEALTHY = Telemetry(
    drone_id="d",
    received_s=10.0,
    yaw_rad=0.0,
    pitch_rad=0.0,
    roll_rad=0.0,
    velocity_m_s=np.zeros(3),
    acceleration_m_s2=np.zeros(3),
    height_m=0.0,
    tof_m=None,
    baro_m=0.0,
    battery_pct=80,
    temperature_c=70.0,
    motor_time_s=0.0,
)


def pose_at(x: float, y: float, z: float, yaw_rad: float = 0.0) -> CameraPose:
    return CameraPose(
        "d", 0.0, camera_pose(np.array([x, y, z]), yaw_rad, 0.2), SIGMA_M**2 * np.eye(4)
    )


# Take-off -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("telemetry", "now_s", "name", "word", "final"),
    [
        (None, 10.0, "state", "no state", True),
        (HEALTHY, 11.5, "state", "1.5 s", True),
        (replace(HEALTHY, battery_pct=19), 10.1, "battery", "19 %", False),
        (replace(HEALTHY, battery_pct=15), 10.1, "battery", "15 %", True),
        (replace(HEALTHY, temperature_c=95.0), 10.1, "temperature", "hot", False),
        (replace(HEALTHY, temperature_c=100.0), 10.1, "temperature", "hot", True),
    ],
)
def test_take_off_is_refused_with_a_reason(
    telemetry: Telemetry | None, now_s: float, name: str, word: str, final: bool
) -> None:
    (refusal,) = take_off_refusals(telemetry, now_s, CONFIG)
    assert refusal.name == name
    assert word in refusal.text
    assert refusal.final is final


def test_every_reason_is_told() -> None:
    worn = replace(HEALTHY, battery_pct=18, temperature_c=96.0)
    assert [r.name for r in take_off_refusals(worn, 13.0, CONFIG)] == [
        "state",
        "battery",
        "temperature",
    ]


def test_a_healthy_drone_may_take_off() -> None:
    fit = replace(HEALTHY, battery_pct=20, temperature_c=94.9)
    assert take_off_refusals(fit, 10.9, CONFIG) == ()


# Readings -----------------------------------------------------------------------------------------


def test_readings_of_a_pose() -> None:
    others = [pose_at(2.0, 3.0, 1.0), pose_at(2.0, 0.5, 1.0)]
    readings = flight_readings(pose_at(2.0, 0.0, 1.0), others, [TARGET], CONFIG)
    assert readings.fence_m == pytest.approx(2.0 - CONFIG.fence_radius_m)
    assert readings.ceiling_m == pytest.approx(1.0 - CONFIG.ceiling_m)
    assert readings.standoff_m == pytest.approx(1.6)
    assert readings.separation_m == pytest.approx(0.5)
    assert readings.pose_sigma_m == pytest.approx(SIGMA_M)


def test_what_is_not_there_is_not_measured() -> None:
    readings = flight_readings(pose_at(2.0, 0.0, 1.0), [], [], CONFIG)
    assert readings.standoff_m is None
    assert readings.separation_m is None


# Setpoints ----------------------------------------------------------------------------------------

coordinates = st.floats(-6.0, 6.0)
speeds = st.floats(-3.0, 3.0)


def limited_world_velocity(
    pose: CameraPose, velocity: np.ndarray, target: Box3 | None
) -> np.ndarray:
    """Limit a world velocity and return the world velocity that is left of it."""
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    wanted = Setpoint(turn.T @ velocity, 0.0)
    return (
        turn @ limit_setpoint(wanted, pose, [] if target is None else [target], CONFIG).velocity_m_s
    )


@given(
    coordinates,
    coordinates,
    st.floats(0.0, 4.0),
    st.floats(-7, 7),
    st.tuples(speeds, speeds, speeds),
)
def test_no_setpoint_leads_out_of_fence_floor_or_ceiling(
    x: float, y: float, z: float, yaw_rad: float, velocity: tuple[float, float, float]
) -> None:
    after = limited_world_velocity(pose_at(x, y, z, yaw_rad), np.array(velocity), None)
    radius = math.hypot(x, y)
    if radius > 1e-3:
        outward_m_s = float(after[:2] @ [x, y]) / radius
        assert outward_m_s <= max(FENCE_M - radius, 0.0) / CONFIG.brake_s + 1e-9
    assert after[2] <= max(CONFIG.ceiling_m - z, 0.0) / CONFIG.brake_s + 1e-9
    assert -after[2] <= max(z - CONFIG.floor_m, 0.0) / CONFIG.brake_s + 1e-9


@given(
    st.floats(-2.4, 2.4),
    st.floats(-2.4, 2.4),
    st.floats(1.2, 2.0),
    st.floats(-7, 7),
    st.tuples(speeds, speeds, speeds),
)
# The coasting rule slows what leads to the fence, and what is left leads to the object.
@example(x=0.0, y=0.75, z=1.5, yaw_rad=0.0, velocity=(1.0, 0.0, -1.0))
def test_no_setpoint_leads_into_the_standoff(
    x: float, y: float, z: float, yaw_rad: float, velocity: tuple[float, float, float]
) -> None:
    """Where fence, floor and ceiling are far; near them they have the last word."""
    position = np.array([x, y, z])
    away = position - np.clip(position, TARGET.lower, TARGET.upper)
    distance_m = float(np.linalg.norm(away))
    assume(distance_m > 1e-3)
    after = limited_world_velocity(pose_at(x, y, z, yaw_rad), np.array(velocity), TARGET)
    closing_m_s = -float(after @ away) / distance_m
    assert closing_m_s <= max(distance_m - CONFIG.standoff_m, 0.0) / CONFIG.brake_s + 1e-6


@given(
    coordinates,
    coordinates,
    st.floats(0.0, 4.0),
    st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 4),
    st.booleans(),
)
def test_every_setpoint_comes_out_finite_and_slow(
    x: float, y: float, z: float, wish: tuple[float, float, float, float], known: bool
) -> None:
    setpoint = Setpoint(np.array(wish[:3]), wish[3])
    after = limit_setpoint(setpoint, pose_at(x, y, z), [TARGET] if known else [], CONFIG)
    assert np.isfinite(after.velocity_m_s).all()
    assert abs(after.yaw_rate_rad_s) <= CONFIG.max_yaw_rate_rad_s
    # A retreat from several limits at once may add to a wish, but only by its own small speed.
    assert np.linalg.norm(after.velocity_m_s) <= CONFIG.max_speed_m_s + 3 * 0.25 + 1e-9


def distance_m(position: np.ndarray) -> float:
    return float(np.linalg.norm(position - np.clip(position, TARGET.lower, TARGET.upper)))


def test_going_round_the_object_is_not_slowed() -> None:
    """A drone at 2.5 m that faces the middle while it goes round at 0.4 m/s."""
    wish = Setpoint(np.array([0.0, -0.4, 0.0]), 0.4 / 2.5)
    after = limit_setpoint(wish, pose_at(2.5, 0.0, 1.0, math.pi), [], CONFIG)
    np.testing.assert_allclose(after.velocity_m_s, wish.velocity_m_s, atol=1e-9)
    straight = limit_setpoint(
        Setpoint(wish.velocity_m_s, 0.0), pose_at(2.5, 0.0, 1.0, math.pi), [], CONFIG
    )
    assert np.linalg.norm(straight.velocity_m_s) < 0.3


def test_past_a_limit_the_drone_is_driven_back() -> None:
    outside = limited_world_velocity(pose_at(5.0, 0.0, 1.0), np.zeros(3), None)
    assert outside[0] < 0
    too_high = limited_world_velocity(pose_at(1.0, 0.0, 3.3), np.zeros(3), None)
    assert too_high[2] < 0
    too_low = limited_world_velocity(pose_at(1.0, 0.0, 0.1), np.zeros(3), None)
    assert too_low[2] > 0
    too_near = limited_world_velocity(pose_at(0.6, 0.0, 1.0), np.zeros(3), TARGET)
    assert too_near[0] > 0
    inside = limited_world_velocity(pose_at(0.1, 0.0, 1.0), np.zeros(3), TARGET)
    assert np.linalg.norm(inside[:2]) > 0


def test_a_harmless_setpoint_passes_unchanged() -> None:
    wish = Setpoint(np.array([0.2, -0.1, 0.08]), 0.4)
    after = limit_setpoint(wish, pose_at(2.0, 0.0, 1.2, 0.7), [TARGET], CONFIG)
    np.testing.assert_allclose(after.velocity_m_s, wish.velocity_m_s)
    assert after.yaw_rate_rad_s == wish.yaw_rate_rad_s


# Configuration ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"fence_radius_m": 0.0}, "fence_radius_m"),
        ({"brake_s": math.nan}, "brake_s"),
        ({"ceiling_m": 0.2}, "ceiling_m"),
        ({"state_lost_s": 0.5}, "state_lost_s"),
        ({"battery_take_off_pct": 15}, "battery_take_off_pct"),
        ({"battery_take_off_pct": 101}, "battery_take_off_pct"),
        ({"temperature_take_off_c": 101.0}, "temperature_take_off_c"),
    ],
)
def test_senseless_thresholds_are_refused_by_name(change: dict[str, float], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        replace(CONFIG, **change)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"beat_s": 0.0}, "beat_s"),
        ({"keep_alive_s": 6.0}, "keep_alive_s"),
        ({"stop_repeats_s": (0.1, -1.0)}, "stop_repeats_s"),
        ({"cut_repeat_s": math.inf}, "cut_repeat_s"),
        ({"stop_repeats_s": ()}, "stop_repeats_s"),
    ],
)
def test_senseless_times_are_refused_by_name(change: dict[str, object], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        replace(TimingConfig(), **change)  # pyright: ignore[reportArgumentType]


def test_the_fence_is_drawn_in_by_what_is_unsure_but_not_without_end() -> None:
    def fence(sigma_m: float) -> float:
        covariance = sigma_m**2 * np.eye(4)
        return fence_for(replace(pose_at(1.0, 0.0, 1.0), covariance=covariance), CONFIG)

    assert fence(0.0) == CONFIG.fence_radius_m
    assert fence(0.1) < fence(0.01) < CONFIG.fence_radius_m
    assert fence(50.0) == fence(5.0) > 0.5 * CONFIG.fence_radius_m
