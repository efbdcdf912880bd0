"""Safety rules: values in, verdicts and limited setpoints out. No I/O, no clock, no state.

Three questions: may this drone take off (``take_off_refusals``), what do its pilot's beliefs say to
the failsafe table (``flight_readings``; the table itself is ``server.swarm.failsafes``), and how
fast may it go where it wants to go (``limit_setpoint``).

Symbols: positions and velocities are ``(3,)`` world metres unless the name says body (FLU).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.stages import CameraPose, Setpoint, Telemetry
from server.swarm.coasting import coastable, past_limit
from server.swarm.config import SafetyConfig
from server.swarm.failsafes import Action, Fired, FlightReadings

Array = NDArray[np.float64]

# Inside the standoff or outside the fence a drone is driven back, but never faster than this.
_RETREAT_M_S = 0.25
# The fence is drawn in by so many standard deviations of the position, but not beyond the maximum.
_SIGMAS = 2.0
_MARGIN_MAX_M = 1.0
_COAST_UNSURE_MAX_M = 0.5
# A drone past a limit gives up its turn for so much more speed.
_SLOWER_M_S = 0.01
# Speeds that differ by less are equal, m/s.
_ROUNDING_M_S = 1e-9
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
    pose: CameraPose, others: Iterable[CameraPose], obstacles: Iterable[Box3], config: SafetyConfig
) -> FlightReadings:
    """Return what a believed pose means for the failsafe table.

    Args:
        pose: The drone's believed pose.
        others: Those of the other flying drones.
        obstacles: The boxes of the object and of no-go volumes, world.
        config: Fence and ceiling.
    """
    position = pose.position_world
    apart = (float(np.linalg.norm(position - other.position_world)) for other in others)
    return FlightReadings(
        fence_m=math.hypot(position[0], position[1]) - config.fence_radius_m,
        ceiling_m=float(position[2]) - config.ceiling_m,
        floor_m=config.floor_m - float(position[2]),
        standoff_m=min((box.distance(position) for box in obstacles), default=None),
        separation_m=min(apart, default=None),
        pose_sigma_m=pose.position_sigma_m,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Limit:
    """``velocity . normal <= speed_m_s``: how fast a drone may go towards something."""

    normal: Array
    speed_m_s: float

    def allows(self, velocity: Array) -> bool:
        return float(velocity @ self.normal) <= self.speed_m_s + _ROUNDING_M_S

    def apply(self, velocity: Array) -> Array:
        along = float(velocity @ self.normal)
        return velocity - max(0.0, along - self.speed_m_s) * self.normal


def fence_for(pose: CameraPose, config: SafetyConfig) -> float:
    """Return the radius in metres that a drone keeps to: less, the less sure its place is."""
    return config.fence_radius_m - _unsure_m(pose)


def _unsure_m(pose: CameraPose) -> float:
    """Return how far a drone may be from where it is believed to be, as far as that counts."""
    return min(_SIGMAS * pose.position_sigma_m, _MARGIN_MAX_M)


def _coast_unsure_m(pose: CameraPose) -> float:
    """Return the same for the way of a coasting drone.

    Less is counted: with more, wind drove drones out that might not fly back in against it.
    """
    return min(_unsure_m(pose), _COAST_UNSURE_MAX_M)


def limit_setpoint(
    setpoint: Setpoint, pose: CameraPose, obstacles: Sequence[Box3], config: SafetyConfig
) -> Setpoint:
    """Return the setpoint, slowed so that the drone stays within fence, floor, ceiling, standoff.

    Towards each limit a drone may fly at distance / ``brake_s``; past a limit this becomes a slow
    retreat. Of two obstacles that contradict one another the later has the last word, and fence,
    floor and ceiling have it over the standoff. The fence is drawn in by
    what is unsure about the pose. No velocity would do harm if the link died with it, see
    ``server.swarm.coasting``: that has the very last word, also over a retreat. Where a drone that
    is past a limit cannot both turn and go back, it does not turn.

    Args:
        setpoint: Wanted body velocity and yaw rate.
        pose: The drone's believed pose; its heading turns body velocities into world ones.
        obstacles: Boxes to keep away from, world: the object's once it is known, no-go volumes.
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
    limited = _limited(pose, velocity, rate, obstacles, config)
    if rate and past_limit(pose.position_world, obstacles, config, _coast_unsure_m(pose)):
        straight = _limited(pose, velocity, 0.0, obstacles, config)
        if np.linalg.norm(straight) > np.linalg.norm(limited) + _SLOWER_M_S:
            limited, rate = straight, 0.0
    return Setpoint(turn.T @ limited, rate)


def _limited(
    pose: CameraPose,
    velocity: Array,
    yaw_rate: float,
    obstacles: Sequence[Box3],
    config: SafetyConfig,
) -> Array:
    """Return the world velocity ``(3,)``, kept to every limit, of a drone that turns as well."""
    position, unsure_m = pose.position_world, _coast_unsure_m(pose)
    coasting = coastable(position, velocity, yaw_rate, obstacles, config, unsure_m)
    fence_m = fence_for(pose, config)
    limits, limited = _limits(position, obstacles, fence_m, config), coasting
    # Limits may disturb one another; a second pass settles all but contradictory ones, and one more
    # for each further obstacle.
    for _ in range(max(2, 1 + len(obstacles))):
        for limit in limits:
            limited = limit.apply(limited)
    if np.array_equal(limited, coasting):
        return limited
    # What they made of it may lead elsewhere: a retreat from the fence to the object, or back.
    coasting = coastable(position, limited, yaw_rate, obstacles, config, unsure_m)
    if all(limit.allows(coasting) for limit in limits):
        return coasting
    # Slowed along one axis only, it turned towards a limit: slow the others as much.
    evenly = _slowed_evenly(limited, coasting)
    flies_on = coastable(position, evenly, yaw_rate, obstacles, config, unsure_m)
    retreats = all(limit.allows(evenly) for limit in limits if limit.allows(coasting))
    if retreats and np.allclose(flies_on, evenly, atol=_ROUNDING_M_S):
        return evenly
    return coasting


def _slowed_evenly(velocity: Array, slower: Array) -> Array:
    """Return ``velocity`` scaled by the smallest share that ``slower`` kept of any axis."""
    moving = np.abs(velocity) > _ROUNDING_M_S
    shares = slower[moving] / velocity[moving]
    return velocity * float(np.clip(shares.min(initial=1.0), 0.0, 1.0))


def _limits(
    position: Array, obstacles: Sequence[Box3], fence_m: float, config: SafetyConfig
) -> list[_Limit]:
    def towards(normal: Array, distance_m: float) -> _Limit:
        return _Limit(normal, max(distance_m / config.brake_s, -_RETREAT_M_S))

    limits: list[_Limit] = []
    for box in obstacles:
        away = position - np.clip(position, box.lower, box.upper)
        distance_m = float(np.linalg.norm(away))
        if distance_m < 1e-6:  # Inside the box: out by the shortest horizontal way.
            away, distance_m = _way_out(position, box), 0.0
        limits.append(towards(-away / np.linalg.norm(away), distance_m - config.standoff_m))
    radius_m = math.hypot(position[0], position[1])
    if radius_m > 1e-6:
        outward = np.array([position[0], position[1], 0.0]) / radius_m
        limits.append(towards(outward, fence_m - radius_m))
    limits.append(towards(np.array([0.0, 0.0, 1.0]), config.ceiling_m - position[2]))
    limits.append(towards(np.array([0.0, 0.0, -1.0]), position[2] - config.floor_m))
    return limits


def _way_out(position: Array, box: Box3) -> Array:
    """Return the direction ``(3,)`` of the side of ``box`` that is nearest, upright ones only."""
    depths = np.concatenate([box.upper[:2] - position[:2], position[:2] - box.lower[:2]])
    side = int(np.argmin(depths))
    way = np.zeros(3)
    way[side % 2] = 1.0 if side < 2 else -1.0
    return way


def _rotation_z(yaw_rad: float) -> Array:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
