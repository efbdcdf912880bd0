"""Safety rules: values in, action out. No I/O, no clock, no state.

| rule | threshold (``SafetyConfig``) | action |
|---|---|---|
| state age | older than ``state_hold_s`` | hold |
| state age | older than ``state_land_s`` | land |
| battery | at or below ``battery_land_pct`` | land |
| temperature | at or above ``temperature_land_c`` | land |
| fence | outside ``fence_radius_m`` or ``ceiling_m`` by more than ``fence_slack_m`` | hold |
| separation | another drone nearer than ``separation_m`` | hold |
| take-off | battery below ``battery_take_off_pct``, temperature at or above \
``temperature_take_off_c``, no fresh state | refused |
| setpoint | fence, floor, ceiling, standoff, speed | limited |

Symbols: positions and velocities are ``(3,)`` world metres unless the name says body (FLU).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.stages import CameraPose, Setpoint, Telemetry
from server.swarm.config import SafetyConfig

Array = NDArray[np.float64]
Action = Literal["none", "hold", "land"]

_RANK: dict[Action, int] = {"none": 0, "hold": 1, "land": 2}

# Inside the standoff or outside the fence a drone is driven back, but never faster than this.
_RETREAT_M_S = 0.25
# No wish is faster than this; far more would overflow when squared.
_ABSURD_M_S = 1e3


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the rules demand.

    Attributes:
        action: ``none``, ``hold`` or ``land``.
        reason: For people; empty when there is nothing to do.
    """

    action: Action
    reason: str


FINE = Verdict("none", "")


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the verdict with the strongest action; the first of equals."""
    return max(verdicts, key=lambda verdict: _RANK[verdict.action], default=FINE)


def judge_state_age(age_s: float | None, config: SafetyConfig) -> Verdict:
    """Judge the age of the newest state report; None means that there never was one."""
    if age_s is None or age_s > config.state_land_s:
        shown = "no state report" if age_s is None else f"no state report for {age_s:.1f} s"
        return Verdict("land", shown)
    if age_s > config.state_hold_s:
        return Verdict("hold", f"no state report for {age_s:.1f} s")
    return FINE


def judge_battery(battery_pct: int, config: SafetyConfig) -> Verdict:
    """Judge the charge of a flying drone."""
    if battery_pct <= config.battery_land_pct:
        return Verdict("land", f"battery at {battery_pct} %")
    return FINE


def judge_temperature(temperature_c: float, config: SafetyConfig) -> Verdict:
    """Judge the board temperature of a flying drone."""
    if temperature_c >= config.temperature_land_c:
        return Verdict("land", f"{temperature_c:.0f} degrees Celsius")
    return FINE


def judge_fence(position: Array, config: SafetyConfig) -> Verdict:
    """Judge a position against the fence and the ceiling, with their slack."""
    radius = math.hypot(position[0], position[1])
    if radius > config.fence_radius_m + config.fence_slack_m:
        return Verdict("hold", f"{radius:.1f} m from the centre, outside the fence")
    if position[2] > config.ceiling_m + config.fence_slack_m:
        return Verdict("hold", f"{position[2]:.1f} m high, above the ceiling")
    return FINE


def judge_separation(position: Array, others: Iterable[Array], config: SafetyConfig) -> Verdict:
    """Judge the distance to the other flying drones."""
    nearest = min((float(np.linalg.norm(position - other)) for other in others), default=math.inf)
    if nearest < config.separation_m:
        return Verdict("hold", f"another drone {nearest:.2f} m away")
    return FINE


def judge_telemetry(telemetry: Telemetry | None, now_s: float, config: SafetyConfig) -> Verdict:
    """Judge all that a flying drone's state report alone can tell."""
    if telemetry is None:
        return judge_state_age(None, config)
    return worst(
        (
            judge_state_age(now_s - telemetry.received_s, config),
            judge_battery(telemetry.battery_pct, config),
            judge_temperature(telemetry.temperature_c, config),
        )
    )


def judge_pose(pose: CameraPose, others: Iterable[CameraPose], config: SafetyConfig) -> Verdict:
    """Judge a flying drone's believed pose against the fence and the other flying drones."""
    position = pose.position_world
    return worst(
        (
            judge_fence(position, config),
            judge_separation(position, (other.position_world for other in others), config),
        )
    )


def refuse_take_off(telemetry: Telemetry | None, now_s: float, config: SafetyConfig) -> str | None:
    """Return why a drone must not take off, or None when it may."""
    if telemetry is None:
        return "no state report yet"
    age_s = now_s - telemetry.received_s
    if age_s > config.state_hold_s:
        return f"no state report for {age_s:.1f} s"
    if telemetry.battery_pct < config.battery_take_off_pct:
        return f"battery at {telemetry.battery_pct} %, needs {config.battery_take_off_pct} %"
    if telemetry.temperature_c >= config.temperature_take_off_c:
        return f"too hot: {telemetry.temperature_c:.0f} degrees Celsius"
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Limit:
    """``velocity . normal <= speed_m_s``: how fast a drone may go towards something."""

    normal: Array
    speed_m_s: float

    def apply(self, velocity: Array) -> Array:
        along = float(velocity @ self.normal)
        return velocity - max(0.0, along - self.speed_m_s) * self.normal


def limit_setpoint(
    setpoint: Setpoint, pose: CameraPose, target: Box3 | None, config: SafetyConfig
) -> Setpoint:
    """Return the setpoint, slowed so that the drone stays within fence, floor, ceiling, standoff.

    Towards each limit a drone may fly at distance / ``brake_s``; past a limit this becomes a slow
    retreat. Fence, floor and ceiling have the last word over the standoff.

    Args:
        setpoint: Wanted body velocity and yaw rate.
        pose: The drone's believed pose; its heading turns body velocities into world ones.
        target: The object's box, world, or None before it is known.
        config: Thresholds.
    """
    turn = _rotation_z(pose.yaw_rad)
    wish = np.nan_to_num(setpoint.velocity_m_s, nan=0.0, posinf=0.0, neginf=0.0)
    velocity = turn @ np.clip(wish, -_ABSURD_M_S, _ABSURD_M_S)
    speed = float(np.linalg.norm(velocity))
    if speed > config.max_speed_m_s:
        velocity = velocity * (config.max_speed_m_s / speed)
    limits = _limits(pose.position_world, target, config)
    # Limits may disturb one another; a second pass settles all but contradictory ones.
    for _ in range(2):
        for limit in limits:
            velocity = limit.apply(velocity)
    rate = setpoint.yaw_rate_rad_s if math.isfinite(setpoint.yaw_rate_rad_s) else 0.0
    rate = min(max(rate, -config.max_yaw_rate_rad_s), config.max_yaw_rate_rad_s)
    return Setpoint(turn.T @ velocity, rate)


def _limits(position: Array, target: Box3 | None, config: SafetyConfig) -> list[_Limit]:
    def towards(normal: Array, distance_m: float) -> _Limit:
        return _Limit(normal, max(distance_m / config.brake_s, -_RETREAT_M_S))

    limits: list[_Limit] = []
    if target is not None:
        away = position - np.clip(position, target.lower, target.upper)
        distance_m = float(np.linalg.norm(away))
        if distance_m < 1e-6:  # Inside the box: out by the shortest horizontal way.
            away = (position - target.centre) * [1.0, 1.0, 0.0]
            if np.linalg.norm(away) < 1e-6:
                away = np.array([1.0, 0.0, 0.0])
            distance_m = 0.0
        limits.append(towards(-away / np.linalg.norm(away), distance_m - config.standoff_m))
    radius_m = math.hypot(position[0], position[1])
    if radius_m > 1e-6:
        outward = np.array([position[0], position[1], 0.0]) / radius_m
        limits.append(towards(outward, config.fence_radius_m - radius_m))
    limits.append(towards(np.array([0.0, 0.0, 1.0]), config.ceiling_m - position[2]))
    limits.append(towards(np.array([0.0, 0.0, -1.0]), position[2] - config.floor_m))
    return limits


def _rotation_z(yaw_rad: float) -> Array:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
