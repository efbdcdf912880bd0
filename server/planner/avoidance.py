"""Keeping drones apart, off the object and inside the fence: reciprocal avoidance in 3-D.

Between drones: optimal reciprocal collision avoidance (van den Berg, Guy, Lin, Manocha,
"Reciprocal n-body collision avoidance", 2011), in which each of two drones takes half of the
velocity change that keeps them apart for the horizon. Heights are divided by the downwash factor
first, so that drones keep a larger distance above one another than beside one another.

Object and fence do not react, so each drone takes the whole change: the free distance to them may
be used up no faster than in the wall horizon.

Symbols: p relative position, v relative velocity, R summed radii, tau the horizon.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import AvoidanceConfig, FlightSpace
from server.planner.halfspaces import least_violating_velocity, nearest_velocity
from server.planner.paths import column
from server.stages import CameraPose

Array = NDArray[np.float64]

# A drone that wants to move slower than this is as good as at its goal.
_PARKED_M_S = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Agent:
    """One flying drone.

    Attributes:
        drone_id: Which drone.
        position_world: ``(3,)`` metres.
        velocity_world: Present velocity ``(3,)``, m/s.
        preferred_world: Velocity ``(3,)`` it would take if it were alone, m/s.
        sigma_m: Standard deviation of its position.
    """

    drone_id: str
    position_world: Array
    velocity_world: Array
    preferred_world: Array
    sigma_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """Something to fly around, never over.

    Attributes:
        box: Its outer box.
        standoff_m: Least horizontal distance to it.
    """

    box: Box3
    standoff_m: float


def agent_from_pose(pose: CameraPose, velocity_world: Array, preferred_world: Array) -> Agent:
    """Return the agent for a drone at ``pose``."""
    return Agent(
        pose.drone_id,
        pose.position_world,
        velocity_world,
        preferred_world,
        pose.position_sigma_m,
    )


def avoid(
    agents: Sequence[Agent],
    obstacles: Sequence[Obstacle],
    fence: FlightSpace,
    config: AvoidanceConfig,
    dt_s: float,
) -> list[Array]:
    """Return a safe velocity ``(3,)`` in the world, m/s, per agent, as near as can be to preferred.

    Args:
        agents: All flying drones, also those that only hover.
        obstacles: The object and whatever else is known.
        fence: Fence, floor and ceiling.
        config: Radii and horizons.
        dt_s: Time until the next call; nothing is recovered from in less.
    """
    velocities = []
    for index, agent in enumerate(agents):
        others = [other for i, other in enumerate(agents) if i != index]
        rows = [reciprocal_row(agent, other, config, dt_s) for other in others]
        soft = [True] * len(rows)
        for row in fence_rows(agent.position_world, fence, config):
            rows.append(row)
            soft.append(True)
        for obstacle in obstacles:
            rows.append(obstacle_row(agent.position_world, obstacle, config))
            soft.append(False)
        normals = np.array([normal for normal, _ in rows])
        offsets = np.array([offset for _, offset in rows])
        wanted = _with_sidestep(agent, others, obstacles, index, config)
        velocity = nearest_velocity(wanted, normals, offsets, config.speed_max_m_s)
        if velocity is None:
            velocity = least_violating_velocity(
                wanted, normals, offsets, config.speed_max_m_s, np.array(soft)
            )
        velocities.append(velocity)
    return velocities


def protected_radius(agent: Agent, config: AvoidanceConfig) -> float:
    """Return the radius in metres of the agent's sphere, grown by what is unsure about its pose."""
    margin = min(config.sigma_factor * agent.sigma_m, config.sigma_margin_max_m)
    return config.radius_m + margin


def reciprocal_row(
    agent: Agent, other: Agent, config: AvoidanceConfig, dt_s: float
) -> tuple[Array, float]:
    """Return normal ``(3,)`` and offset of the half-space that ``agent`` owes ``other``."""
    squash = np.array([1.0, 1.0, 1.0 / config.downwash_factor])
    p = squash * (other.position_world - agent.position_world)
    own = squash * agent.velocity_world
    v = own - squash * other.velocity_world
    R = protected_radius(agent, config) + protected_radius(other, config)
    normal, depth = _way_out(p, v, R, config, dt_s)
    offset = float(normal @ own + depth / 2.0)
    # Back to true heights: normal . (squash v) = (squash normal) . v.
    normal = squash * normal
    length = float(np.linalg.norm(normal))
    return normal / length, offset / length


def obstacle_row(
    position: Array, obstacle: Obstacle, config: AvoidanceConfig
) -> tuple[Array, float]:
    """Return the half-space that keeps the standoff to ``obstacle``."""
    box = column(obstacle.box)
    away = position - np.clip(position, box.lower, box.upper)
    distance = float(np.linalg.norm(away))
    if distance < 1e-6:
        # Inside: out through the centre's far side, the only direction that is surely right.
        away = position - box.centre
        away[2] = 0.0
        if np.linalg.norm(away) < 1e-6:
            away = np.array([1.0, 0.0, 0.0])
    normal = away / np.linalg.norm(away)
    return normal, _wall_offset(distance - obstacle.standoff_m, config)


def fence_rows(
    position: Array, fence: FlightSpace, config: AvoidanceConfig
) -> list[tuple[Array, float]]:
    """Return the half-spaces of fence, floor and ceiling."""
    radius = float(np.hypot(position[0], position[1]))
    rows = [
        (np.array([0.0, 0.0, 1.0]), _wall_offset(float(position[2]) - fence.floor_m, config)),
        (np.array([0.0, 0.0, -1.0]), _wall_offset(fence.ceiling_m - float(position[2]), config)),
    ]
    if radius > 1e-6:
        inwards = np.array([-position[0] / radius, -position[1] / radius, 0.0])
        rows.append((inwards, _wall_offset(fence.fence_radius_m - radius, config)))
    return rows


def _wall_offset(free_m: float, config: AvoidanceConfig) -> float:
    """Return the least velocity away from a wall that is ``free_m`` away (negative: behind it)."""
    return (
        float(max(-free_m / config.wall_horizon_s, -10.0))
        if free_m > 0
        else float(min(-free_m / config.recovery_s, 0.5 * config.speed_max_m_s))
    )


def _way_out(
    p: Array, v: Array, R: float, config: AvoidanceConfig, dt_s: float
) -> tuple[Array, float]:
    """Return unit normal and depth u of the shortest way of ``v`` out of the velocity obstacle."""
    gap = float(p @ p) - R * R
    if gap <= 0.0:
        # Already too close: be R apart after the recovery time.
        time_s = max(config.recovery_s, dt_s)
        return _out_of_ball(p, v, R, time_s)
    tau = config.horizon_s
    w = v - p / tau
    along = float(w @ p)
    if along < 0.0 and along**2 > R * R * float(w @ w):
        return _out_of_ball(p, v, R, tau)
    # Nearest point on the cone's mantle: v shifted along the axis until it is R from it.
    a = float(p @ p)
    b = float(p @ v)
    crossed = np.cross(p, v)
    c = float(v @ v) - float(crossed @ crossed) / gap
    t = (b + np.sqrt(max(b * b - a * c, 0.0))) / a
    aside = v - t * p
    length = float(np.linalg.norm(aside))
    if length < 1e-9:
        # Exactly along the axis every side is as near; the mantle leans by the cone's angle.
        return (np.sqrt(gap) * _any_normal(p) - R * p / np.sqrt(a)) / np.sqrt(a), R * t
    return aside / length, R * t - length


def _out_of_ball(p: Array, v: Array, R: float, time_s: float) -> tuple[Array, float]:
    w = v - p / time_s
    length = float(np.linalg.norm(w))
    if length < 1e-9:
        return _any_normal(p), R / time_s
    return w / length, R / time_s - length


def _any_normal(p: Array) -> Array:
    """Return a unit vector across ``p``; two drones with opposite ``p`` get opposite ones."""
    across = np.cross(p, [0.0, 0.0, 1.0])
    if np.linalg.norm(across) < 1e-9:
        across = np.array([np.sign(p[2]) or 1.0, 0.0, 0.0])
    return across / np.linalg.norm(across)


def _with_sidestep(
    agent: Agent,
    others: Sequence[Agent],
    obstacles: Sequence[Obstacle],
    index: int,
    config: AvoidanceConfig,
) -> Array:
    """Return the preferred velocity, turned a little aside for every drone ahead.

    Reciprocal avoidance is symmetric: drones that meet head-on would brake and stand for ever.
    All passing on the right resolves it, and the same way every time. A drone that hovers at its
    goal will not make room, so it is passed on the side away from the object, and with more will.
    """
    wanted = agent.preferred_world
    speed = float(np.linalg.norm(wanted))
    if speed < _PARKED_M_S:
        return wanted
    heading = wanted / speed
    right = np.cross(heading, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 0.1:
        # Straight up or down there is no right; each drone has its own way aside.
        right = np.array([np.cos(2.4 * index), np.sin(2.4 * index), 0.0])
    right = right / np.linalg.norm(right)
    reach = 2.0 * config.radius_m + config.speed_max_m_s * config.horizon_s
    step = np.zeros(3)
    for other in others:
        towards = other.position_world - agent.position_world
        distance = float(np.linalg.norm(towards))
        if not (1e-9 < distance < reach and float(towards @ heading) > 0.3 * distance):
            continue
        will = config.sidestep * speed * (1.0 - distance / reach)
        if float(np.linalg.norm(other.preferred_world)) < _PARKED_M_S:
            open_side = right * (1.0 if _away_from(obstacles, other) @ right >= 0.0 else -1.0)
            step += config.parked_factor * will * open_side
        else:
            step += will * right
    return wanted + step


def _away_from(obstacles: Sequence[Obstacle], agent: Agent) -> Array:
    """Return the sum of horizontal unit vectors ``(3,)`` from the obstacles to ``agent``."""
    total = np.zeros(3)
    for obstacle in obstacles:
        away = agent.position_world - obstacle.box.centre
        away[2] = 0.0
        total += away / max(float(np.linalg.norm(away)), 1e-9)
    return total
