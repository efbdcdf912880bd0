"""Keeping drones apart, off the object and inside the fence: reciprocal avoidance in 3-D.

Between drones: optimal reciprocal collision avoidance (van den Berg, Guy, Lin, Manocha,
"Reciprocal n-body collision avoidance", 2011), in which each of two drones takes half of the
velocity change that keeps them apart for the horizon. Heights are divided by the downwash factor
first, so that drones keep a larger distance above one another than beside one another.

Object, no-go volumes and fence do not react, so each drone takes the whole change: the free
distance to them may be used up no faster than in the wall horizon.

All distances are what would be left if everybody were told to stop now
(``server.planner.velocity_obstacles``), so a safe stop always stays possible. Told velocities also
stay within what the drone can accelerate to.

Symbols: x position, v velocity, s stopping point, u told velocity; world metres and m/s.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import AvoidanceConfig, FlightSpace
from server.planner.halfspaces import (
    Ball,
    Row,
    Vector,
    least_violating_velocity,
    nearest_velocity,
)
from server.planner.sidestep import Bounds, Mover, sidestepped
from server.planner.velocity_obstacles import (
    box_direction,
    reciprocal_row,
    stretched,
    wall_speed,
)
from server.stages import CameraPose

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Agent:
    """One flying drone.

    Attributes:
        drone_id: Which drone.
        position_world: ``(3,)`` metres.
        velocity_world: Present velocity ``(3,)``, m/s.
        preferred_world: Velocity ``(3,)`` it would take if it were alone, m/s.
        sigma_m: Standard deviation of its position.
        yields: False for a drone that will not follow what it is told (held, taking off, landing):
            the others then make all of the room.
    """

    drone_id: str
    position_world: Array
    velocity_world: Array
    preferred_world: Array
    sigma_m: float = 0.0
    yields: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """Something to keep away from.

    Attributes:
        box: Its outer box.
        standoff_m: Least distance to it.
        endless: True when nobody may fly above or below it either (the object), False for a volume
            that may be passed above and below.
    """

    box: Box3
    standoff_m: float
    endless: bool = True


def agent_from_pose(
    pose: CameraPose, velocity_world: Array, preferred_world: Array, yields: bool = True
) -> Agent:
    """Return the agent for a drone at ``pose``."""
    return Agent(
        pose.drone_id,
        pose.position_world,
        velocity_world,
        preferred_world,
        pose.position_sigma_m,
        yields,
    )


def avoid(
    agents: Sequence[Agent],
    obstacles: Sequence[Obstacle],
    fence: FlightSpace,
    config: AvoidanceConfig,
    dt_s: float,
) -> list[Array]:
    """Return a safe velocity ``(3,)`` in the world, m/s, per agent, as near as can be to preferred.

    An agent with a position that is not finite is told to hover, and nobody can avoid it.

    Args:
        agents: All flying drones, also those that only hover.
        obstacles: The object, no-go volumes and whatever else is known.
        fence: Fence, floor and ceiling.
        config: Radii and horizons.
        dt_s: Time until the next call; nothing is recovered from in less.
    """
    boxes = [bounds_of(obstacle) for obstacle in obstacles]
    movers = movers_of(agents, boxes, fence, config)
    everyone = range(len(movers))
    rows = [_rows(i, movers, boxes, fence, config, dt_s) for i in everyone]
    found = [_nearest(movers[i], rows[i], config) for i in everyone]
    if None in found:
        movers = [
            _calmed(mover, config) if velocity is None else mover
            for mover, velocity in zip(movers, found, strict=True)
        ]
        rows = [_rows(i, movers, boxes, fence, config, dt_s) for i in everyone]
        found = [
            _nearest(movers[i], rows[i], config) or _compromise(i, movers, rows[i], config)
            for i in everyone
        ]
    return [np.array(velocity) for velocity in found]


def movers_of(
    agents: Sequence[Agent], boxes: Sequence[Bounds], fence: FlightSpace, config: AvoidanceConfig
) -> list[Mover]:
    """Return the agents in plain numbers, their wishes turned by the right-hand rule."""
    movers = [_mover(agent, config) for agent in agents]
    radius_m = fence.fence_radius_m
    wishes = [sidestepped(i, movers, boxes, radius_m, config) for i in range(len(movers))]
    return [
        mover._replace(wanted=wish, intended=wish if mover.yields else mover.velocity)
        for mover, wish in zip(movers, wishes, strict=True)
    ]


def bounds_of(obstacle: Obstacle) -> Bounds:
    """Return the obstacle in plain numbers; an endless one reaches to infinity."""
    lower, upper = _vector(obstacle.box.lower), _vector(obstacle.box.upper)
    if obstacle.endless:
        lower = lower[0], lower[1], -math.inf
        upper = upper[0], upper[1], math.inf
    return Bounds(lower, upper, obstacle.standoff_m)


def protected_radius(sigma_m: float, config: AvoidanceConfig) -> float:
    """Return the radius in metres of a drone's sphere, grown by what is unsure about its pose."""
    return config.radius_m + _unsure(sigma_m, config)


def drone_row(
    movers: Sequence[Mover], index: int, other: int, config: AvoidanceConfig, dt_s: float
) -> Row:
    """Return the half-space that the drone ``index`` owes the drone ``other``."""
    me, it = movers[index], movers[other]
    squash = 1.0 / config.downwash_factor
    p = _still_apart(me, it, squash)
    if p == (0.0, 0.0, 0.0):
        # One on top of the other: any way apart will do, but they must not choose the same.
        p = (1e-6 if index < other else -1e-6), 0.0, 0.0
    row = reciprocal_row(
        p,
        (me.intended[0], me.intended[1], squash * me.intended[2]),
        (it.intended[0], it.intended[1], squash * it.intended[2]),
        me.radius + it.radius,
        0.5 if it.yields else 1.0,
        (config.horizon_s, max(config.recovery_s, dt_s)),
    )
    return stretched(row, config.downwash_factor)


def wall_rows(
    mover: Mover, boxes: Sequence[Bounds], fence: FlightSpace, config: AvoidanceConfig
) -> list[Row]:
    """Return the half-spaces of boxes, floor, ceiling and fence.

    Uncertainty keeps drones farther from boxes. Fence, floor and ceiling have that margin already:
    the planner's lie within the safety limits.
    """
    x, y, z = mover.stop
    times = config.wall_horizon_s, config.recovery_s, 0.5 * config.speed_max_m_s
    rows: list[Row] = []
    for box in boxes:
        (nx, ny, nz), distance = box_direction(mover.position, box.lower, box.upper)
        # As between drones, only what stopping brings nearer counts.
        distance += min(0.0, _dot((nx, ny, nz), mover.stop) - _dot((nx, ny, nz), mover.position))
        free_m = distance - box.standoff_m - (mover.radius - config.radius_m)
        rows.append((nx, ny, nz, wall_speed(free_m, *times)))
    rows.append((0.0, 0.0, 1.0, wall_speed(z - fence.floor_m, *times)))
    rows.append((0.0, 0.0, -1.0, wall_speed(fence.ceiling_m - z, *times)))
    radius = math.hypot(x, y)
    if radius > 1e-6:
        outside = wall_speed(fence.fence_radius_m - radius, *times)
        rows.append((-x / radius, -y / radius, 0.0, outside))
    return rows


def _rows(
    index: int,
    movers: Sequence[Mover],
    boxes: Sequence[Bounds],
    fence: FlightSpace,
    config: AvoidanceConfig,
    dt_s: float,
) -> list[tuple[Row, float]]:
    """Return what binds a drone: half-spaces, and how much of a compromise each may bear."""
    me = movers[index]
    if not me.known:
        return []
    rows = [(row, 0.0) for row in wall_rows(me, boxes, fence, config)]
    for other, it in enumerate(movers):
        if other != index and it.known:
            give = _give(_apart(me.position, it.position, 1.0 / config.downwash_factor), config)
            rows.append((drone_row(movers, index, other, config, dt_s), give))
    # Rows that every velocity within the speed limit satisfies cost only time.
    return [pair for pair in rows if pair[0][3] > -config.speed_max_m_s]


def _nearest(mover: Mover, rows: list[tuple[Row, float]], config: AvoidanceConfig) -> Vector | None:
    """Return the velocity nearest to the wish that every row allows, None if there is none."""
    if not mover.known:
        return 0.0, 0.0, 0.0
    return nearest_velocity(mover.wanted, [row for row, _ in rows], *_limits(mover, config))


def _compromise(
    index: int, movers: Sequence[Mover], rows: list[tuple[Row, float]], config: AvoidanceConfig
) -> Vector:
    mover = movers[index]
    normals, gives = [row for row, _ in rows], [give for _, give in rows]
    return least_violating_velocity(mover.wanted, normals, gives, *_limits(mover, config))


def _limits(mover: Mover, config: AvoidanceConfig) -> tuple[Ball, Ball]:
    """Return the speed limit and what can be told without too much acceleration.

    With a first-order lag the acceleration is (u - v) / lag.
    """
    reach = config.acceleration_max_m_s2 * config.lag_s
    return Ball((0.0, 0.0, 0.0), config.speed_max_m_s), Ball(mover.velocity, reach)


def _calmed(mover: Mover, config: AvoidanceConfig) -> Mover:
    """Return the drone with less of its wish left, the faster it flies.

    If nobody wished to move, standing still would always be allowed; so who finds no way wishes
    less. Drones that hardly move keep their wish: else a crowd would stand for ever.
    """
    if not mover.yields:
        return mover
    x, y, z = mover.intended
    keep = 1.0 - config.calm_share * min(1.0, math.hypot(*mover.velocity) / config.speed_max_m_s)
    return mover._replace(intended=(keep * x, keep * y, keep * z))


def _still_apart(me: Mover, it: Mover, squash: float) -> Vector:
    """Return where the other drone is, nearer by the way that both still come closer in stopping.

    Heights are squashed. What stopping moves sideways does not count: passing a drone begins only
    when the lag is over.
    """
    p, s = it.position, it.stop
    x, y, z = p[0] - me.position[0], p[1] - me.position[1], squash * (p[2] - me.position[2])
    squared = x * x + y * y + z * z
    if squared < 1e-12:
        return 0.0, 0.0, 0.0
    along = x * (s[0] - me.stop[0]) + y * (s[1] - me.stop[1]) + squash * z * (s[2] - me.stop[2])
    # However fast they close in, the direction to the other one must not be lost.
    left = min(1.0, max(1e-3, along / squared))
    return left * x, left * y, left * z


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _apart(a: Vector, b: Vector, squash: float) -> float:
    return math.hypot(b[0] - a[0], b[1] - a[1], squash * (b[2] - a[2]))


def _give(apart_m: float, config: AvoidanceConfig) -> float:
    """Return how much a drone's row may bear: those that are near have least to give."""
    share = (apart_m - config.radius_m) / (config.speed_max_m_s * config.horizon_s)
    return min(max(share, 0.1), 1.0)


def _mover(agent: Agent, config: AvoidanceConfig) -> Mover:
    """Return the agent in plain numbers, with nonsense in its velocities taken out."""
    position = _vector(agent.position_world)
    known = all(map(math.isfinite, position))
    velocity = _limited(_vector(agent.velocity_world), config.speed_max_m_s)
    ahead_s = config.lag_s + config.latency_s
    return Mover(
        position=position,
        velocity=velocity,
        stop=(
            position[0] + ahead_s * velocity[0],
            position[1] + ahead_s * velocity[1],
            position[2] + ahead_s * velocity[2],
        ),
        wanted=_limited(_vector(agent.preferred_world), config.speed_max_m_s),
        intended=velocity,
        radius=protected_radius(agent.sigma_m, config),
        yields=agent.yields,
        known=known,
    )


def _unsure(sigma_m: float, config: AvoidanceConfig) -> float:
    margin = config.sigma_factor * sigma_m
    # Written so that NaN becomes the greatest margin.
    return margin if margin < config.sigma_margin_max_m else config.sigma_margin_max_m


def _vector(values: Array) -> Vector:
    x, y, z = np.asarray(values, float).tolist()
    return x, y, z


def _limited(v: Vector, speed_max: float) -> Vector:
    """Return ``v`` no faster than ``speed_max``; standing when it is not finite."""
    speed = math.hypot(*v)
    if speed <= speed_max:
        return v
    if not math.isfinite(speed):
        return 0.0, 0.0, 0.0
    share = speed_max / speed
    return share * v[0], share * v[1], share * v[2]
