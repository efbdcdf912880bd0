"""The way between two viewpoints: straight where it is free, else round the object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import PlannerConfig
from server.planner.paths import column, cylindrical, turn

Array = NDArray[np.float64]

# Room between the standoff and the circle flown round the object.
_CLEARANCE_M = 0.15
_SEGMENT_STEPS = 32


def route_velocity(
    position: Array, goal: Array, obstacle: Box3, config: PlannerConfig, turning: int = 0
) -> Array:
    """Return the velocity ``(3,)``, world m/s, with which a lone drone would fly to ``goal``.

    While the object's standoff blocks the straight line, the drone follows a circle round it.

    Args:
        position: Where the drone is ``(3,)``.
        goal: Where it shall go ``(3,)``.
        obstacle: The object's outer box; nobody flies above it.
        config: Standoff and speeds.
        turning: +1 counter-clockwise, -1 clockwise, 0 the shorter way (exactly opposite goals:
            counter-clockwise, so that drones that swap places all turn the same way).
    """
    tracking = config.tracking
    offset = goal - position
    distance = float(np.linalg.norm(offset))
    if distance < 1e-9:
        return np.zeros(3)
    speed = min(tracking.travel_speed_m_s, tracking.travel_gain * distance)
    if straight_is_free(position, goal, obstacle, config.space.standoff_m):
        return offset * (speed / distance)
    circle = float(np.hypot(*(obstacle.size[:2] / 2.0))) + config.space.standoff_m + _CLEARANCE_M
    here, there = cylindrical(np.stack([position, goal]), obstacle.centre)
    way = float(turn(here[0], there[0]))
    sign = float(turning) if turning else (1.0 if way > 0 or way < -np.pi + 0.02 else -1.0)
    # Drift towards the goal's radius on the way, but never inside the circle.
    radius = max(circle, (here[1] + there[1]) / 2.0)
    outwards = np.array([np.cos(here[0]), np.sin(here[0]), 0.0])
    around = sign * np.array([-outwards[1], outwards[0], 0.0])
    limit = 0.6 * tracking.travel_speed_m_s
    radial = float(np.clip(tracking.travel_gain * (radius - here[1]), -limit, limit))
    climb = float(np.clip(tracking.travel_gain * (there[2] - here[2]), -limit, limit))
    velocity = tracking.travel_speed_m_s * around + radial * outwards
    velocity[2] = climb
    return velocity * (tracking.travel_speed_m_s / max(float(np.linalg.norm(velocity)), 1e-9))


def straight_is_free(position: Array, goal: Array, obstacle: Box3, standoff_m: float) -> bool:
    """Return whether the segment keeps ``standoff_m`` to the object, at any height.

    A start or goal that is itself nearer does not count against the way away from it.
    """
    box = column(obstacle)
    share = np.linspace(0.0, 1.0, _SEGMENT_STEPS)[:, None]
    points = position + share * (goal - position)
    beyond = np.maximum(0.0, np.maximum(box.lower - points, points - box.upper))
    distances = np.linalg.norm(beyond, axis=1)
    allowed = min(standoff_m, float(distances[0]), float(distances[-1])) - 0.01
    return bool(distances.min() >= allowed) and float(distances[-1]) > 0.0
