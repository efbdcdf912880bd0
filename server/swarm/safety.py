"""Safety rules: values in, verdicts and limited setpoints out. No I/O, no clock, no state.

Three questions: may this drone take off (``take_off_refusals``), what do its pilot's beliefs say to
the failsafe table (``flight_readings``; the table itself is ``server.swarm.failsafes``), and how
fast may it go where it wants to go (``limit_setpoint``).

Symbols: positions and velocities are ``(3,)`` world metres unless the name says body (FLU).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.stages import CameraPose, Setpoint, Telemetry
from server.swarm.config import SafetyConfig
from server.swarm.failsafes import Action, Fired, FlightReadings

Array = NDArray[np.float64]

# Inside the standoff or outside the fence a drone is driven back, but never faster than this.
_RETREAT_M_S = 0.25
# The fence is drawn in by so many standard deviations of the position, but not beyond the maximum.
_SIGMAS = 2.0
_MARGIN_MAX_M = 0.6
# A coasting drone is where it is believed to be to within this, and its speed and turn are those
# told to within these factors: sticks are no speeds.
_COAST_MARGIN_M = 0.35
_SPEED_FACTOR = 1.1
_TURN_FACTORS = np.array([0.85, 1.0, 1.15])
# When, as shares of the coasting time, it must be inside the fence and clear of the object.
_COAST_SHARES = np.linspace(0.0, 1.0, 17)[1:]
# From then on it comes down wherever it is.
_SINKS = _COAST_SHARES > 0.9
# Shares of the wished velocity that are tried until the coasting drone passes the object.
_SLOWER = np.concatenate([np.geomspace(1.0, 0.03, 20), [0.0]])
# No wish is faster than this; far more would overflow when squared.
_ABSURD_M_S = 1e3


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the failsafe table demands.

    Attributes:
        action: The strongest action that fires, ``none`` when nothing does.
        reason: For people; empty when there is nothing to do.
    """

    action: Action
    reason: str


FINE = Verdict("none", "")


def verdict_of(fired: tuple[Fired, ...]) -> Verdict:
    """Return the verdict of the rows that fire, strongest first."""
    return Verdict(fired[0].failsafe.action, fired[0].text) if fired else FINE


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a drone must not take off.

    Attributes:
        name: ``state``, ``battery`` or ``temperature``.
        text: For people.
        final: True when no operator may override it.
    """

    name: str
    text: str
    final: bool


def take_off_refusals(
    telemetry: Telemetry | None, now_s: float, config: SafetyConfig
) -> tuple[Refusal, ...]:
    """Return why a drone must not take off; empty when it may."""
    if telemetry is None:
        return (Refusal("state", "no state report yet", final=True),)
    refusals: list[Refusal] = []
    age_s = now_s - telemetry.received_s
    if age_s > config.state_fresh_s:
        refusals.append(Refusal("state", f"no state report for {age_s:.1f} s", final=True))
    charge, wanted = telemetry.battery_pct, config.battery_take_off_pct
    if charge < wanted:
        # Below the failsafe it would land again at once: there is nothing to override.
        final = charge <= max(config.failsafes.battery_pct.values())
        refusals.append(Refusal("battery", f"battery at {charge} %, needs {wanted} %", final))
    if telemetry.temperature_c >= config.temperature_take_off_c:
        text = f"too hot: {telemetry.temperature_c:.0f} degrees Celsius"
        limit = min(config.failsafes.temperature_c.values(), default=math.inf)
        refusals.append(Refusal("temperature", text, telemetry.temperature_c >= limit))
    return tuple(refusals)


def flight_readings(
    pose: CameraPose, others: Iterable[CameraPose], target: Box3 | None, config: SafetyConfig
) -> FlightReadings:
    """Return what a believed pose means for the failsafe table.

    Args:
        pose: The drone's believed pose.
        others: Those of the other flying drones.
        target: The object's box, world, or None before it is known.
        config: Fence and ceiling.
    """
    position = pose.position_world
    apart = (float(np.linalg.norm(position - other.position_world)) for other in others)
    standoff = None
    if target is not None:
        outside = position - np.clip(position, target.lower, target.upper)
        standoff = float(np.linalg.norm(outside))
    return FlightReadings(
        fence_m=math.hypot(position[0], position[1]) - config.fence_radius_m,
        ceiling_m=float(position[2]) - config.ceiling_m,
        standoff_m=standoff,
        separation_m=min(apart, default=None),
        pose_sigma_m=pose.position_sigma_m,
    )


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
    retreat. Fence, floor and ceiling have the last word over the standoff. The fence is drawn in by
    what is unsure about the pose, and no velocity would carry the drone over it, through the
    ceiling or to the object within ``coast_s``, nor let it come down on the object then: a Tello
    whose link dies flies on with its last sticks and lands.

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
    rate = setpoint.yaw_rate_rad_s if math.isfinite(setpoint.yaw_rate_rad_s) else 0.0
    rate = min(max(rate, -config.max_yaw_rate_rad_s), config.max_yaw_rate_rad_s)
    velocity = _coastable(pose.position_world, velocity, rate, target, config)
    fence_m = config.fence_radius_m - min(_SIGMAS * pose.position_sigma_m, _MARGIN_MAX_M)
    limits = _limits(pose.position_world, target, fence_m, config)
    # Limits may disturb one another; a second pass settles all but contradictory ones.
    for _ in range(2):
        for limit in limits:
            velocity = limit.apply(velocity)
    return Setpoint(turn.T @ velocity, rate)


def _coastable(
    position: Array, velocity: Array, yaw_rate: float, target: Box3 | None, config: SafetyConfig
) -> Array:
    """Return ``velocity`` ``(3,)``, slowed until a drone that coasts with it stays in free room.

    Sticks are in the body's axes: whoever also turns flies a circle, not a line. A drone that goes
    round the object facing it is at full speed as safe as one that creeps straight on.
    """
    headroom_m = config.ceiling_m - _COAST_MARGIN_M - float(position[2])
    if headroom_m > 0.0:
        velocity = velocity.copy()
        velocity[2] = min(float(velocity[2]), headroom_m / config.coast_s)
    moved = _coasted(velocity, yaw_rate, config.coast_s)
    along_floor = moved[..., :2].reshape(-1, 2)
    velocity = velocity * [*2 * [_share_inside(position[:2], along_floor, config)], 1.0]
    if target is not None:
        # The scaled path is again the path of the scaled velocity.
        moved = _coasted(velocity, yaw_rate, config.coast_s)
        velocity = velocity * _share_clear(position, moved, target, config.coast_clearance_m)
    return velocity


def _coasted(velocity: Array, yaw_rate: float, coast_s: float) -> Array:
    """Return where a coasting drone may be, relative to now, ``(turns, moments, 3)``."""
    times_s = coast_s * _COAST_SHARES
    angles = yaw_rate * times_s * _TURN_FACTORS[:, None]
    # Displacement per unit of velocity: the integral of the rotation over time.
    along = _SPEED_FACTOR * times_s * np.sinc(angles / np.pi)
    aside = _SPEED_FACTOR * times_s * np.sinc(angles / (2.0 * np.pi)) * np.sin(angles / 2.0)
    x, y, z = velocity
    climbed = np.broadcast_to(z * times_s, along.shape)
    return np.stack([along * x - aside * y, aside * x + along * y, climbed], axis=-1)


def _share_inside(place: Array, moved: Array, config: SafetyConfig) -> float:
    """Return the largest share s, at most 1, with |place + s moved| inside the fence throughout."""
    reach_m = config.fence_radius_m - _COAST_MARGIN_M
    if np.hypot(place[0], place[1]) >= reach_m:
        return 1.0  # Out there the fence's own limit leads back.
    a = (moved**2).sum(axis=1)
    half_b = moved @ place
    c = float(place @ place) - reach_m**2
    shares = (-half_b + np.sqrt(half_b**2 - a * c)) / np.maximum(a, 1e-12)
    return min(1.0, float(shares.min()))


def _share_clear(place: Array, moved: Array, target: Box3, clearance_m: float) -> float:
    """Return a share s, at most 1, with place + s moved clear of the object throughout.

    In the end the drone comes down: there the object counts from the floor up without end, unless
    the drone is above it already.
    """

    def clear(points: Array, axes: int = 3) -> NDArray[np.bool_]:
        away = points - np.clip(points, target.lower, target.upper)
        return (away[..., :axes] ** 2).sum(axis=-1) >= clearance_m**2

    if not clear(place):
        return 1.0  # So near the standoff's limit leads away.
    paths = place + _SLOWER[:, None, None, None] * moved
    passes = clear(paths).all(axis=(1, 2))
    if clear(place, axes=2):
        passes &= clear(paths[:, :, _SINKS], axes=2).all(axis=(1, 2))
    return float(_SLOWER[int(np.argmax(passes))])


def _limits(
    position: Array, target: Box3 | None, fence_m: float, config: SafetyConfig
) -> list[_Limit]:
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
        limits.append(towards(outward, fence_m - radius_m))
    limits.append(towards(np.array([0.0, 0.0, 1.0]), config.ceiling_m - position[2]))
    limits.append(towards(np.array([0.0, 0.0, -1.0]), position[2] - config.floor_m))
    return limits


def _rotation_z(yaw_rad: float) -> Array:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
