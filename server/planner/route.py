"""The way between two viewpoints: straight where it is free, else round the object.

Symbols: horizontal world metres; nobody flies above the object, so seen from above it is a
rectangle and the way is a segment or an arc.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import PlannerConfig

Array = NDArray[np.float64]
_Point = tuple[float, float]

# Room between the standoff and the circle flown round the object.
_CLEARANCE_M = 0.15
# A way counts as shorter only when it is by more than believed positions wander.
_PROGRESS_M = 0.3
# Nearer than this to its goal a drone is not stuck.
_NEAR_M = 0.6
_PATIENCE_S = 6.0
_PATIENCE_STEP_S = 2.5
# Azimuths this close to opposite count as opposite.
_OPPOSITE_RAD = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """Which way round the object a drone has chosen, and how it gets on; its caller keeps it.

    Attributes:
        goal: Where it is going ``(3,)``.
        turning: +1 counter-clockwise, -1 clockwise, 0 while the way is straight.
        shortest_m: Least way that was left since it was chosen.
        since_s: When that was.
    """

    goal: Array
    turning: int
    shortest_m: float
    since_s: float


def next_detour(
    detour: Detour | None,
    position: Array,
    goal: Array,
    obstacle: Box3,
    config: PlannerConfig,
    now_s: float,
    order: int = 0,
) -> Detour:
    """Return the detour to fly now; pass its ``turning`` to ``route_velocity``.

    A drone keeps the way round that it began, so that noise cannot make it dither. When it gets no
    further for a while, it tries the other way. Two that block one another would both do so and
    meet again, so patience grows with ``order``: the lowest turns first, which frees the others.

    Args:
        detour: That of the last call, None in the first.
        position: Where the drone is ``(3,)``.
        goal: Where it shall go ``(3,)``.
        obstacle: The object's outer box.
        config: Standoff.
        now_s: The clock.
        order: The drone's number, different for each drone of a fleet.
    """
    chosen = 0
    if detour is not None and np.array_equal(detour.goal, goal):
        chosen = detour.turning
    else:
        detour = None
    free = straight_is_free(position, goal, obstacle, config.space.standoff_m)
    turning = 0 if free and not chosen else chosen or shorter_turning(position, goal, obstacle)
    left_m = _way_left(position, goal, obstacle, 0 if free else turning)
    if detour is None or turning != chosen or left_m < detour.shortest_m - _PROGRESS_M:
        return Detour(goal, turning, left_m, now_s)
    stuck_s = now_s - detour.since_s
    if turning and left_m > _NEAR_M and stuck_s > _PATIENCE_S + order * _PATIENCE_STEP_S:
        return Detour(goal, -turning, _way_left(position, goal, obstacle, -turning), now_s)
    return detour


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
    distance = math.hypot(*offset.tolist())
    if distance < 1e-9:
        return np.zeros(3)
    travel = tracking.travel_speed_m_s
    if straight_is_free(position, goal, obstacle, config.space.standoff_m):
        return offset * (min(travel, tracking.travel_gain * distance) / distance)
    x0, y0, x1, y1 = _rectangle(obstacle)
    circle = math.hypot(x1 - x0, y1 - y0) / 2.0 + config.space.standoff_m + _CLEARANCE_M
    azimuth, here_m, there_m = _polar(position, goal, obstacle)
    sign = float(turning) if turning else float(shorter_turning(position, goal, obstacle))
    # Drift towards the goal's radius on the way, but never inside the circle.
    radius = max(circle, (here_m + there_m) / 2.0)
    limit, gain = 0.6 * travel, tracking.travel_gain
    radial = min(max(gain * (radius - here_m), -limit), limit)
    climb = min(max(gain * float(offset[2]), -limit), limit)
    c, s = math.cos(azimuth), math.sin(azimuth)
    velocity = np.array(
        [radial * c - sign * travel * s, radial * s + sign * travel * c, climb], np.float64
    )
    return velocity * (travel / math.hypot(radial, travel, climb))


def shorter_turning(position: Array, goal: Array, obstacle: Box3) -> int:
    """Return +1 when counter-clockwise round the object is shorter (or as short), else -1."""
    way = _turn(position, goal, obstacle)
    return 1 if way > 0.0 or way < -math.pi + _OPPOSITE_RAD else -1


def straight_is_free(position: Array, goal: Array, obstacle: Box3, standoff_m: float) -> bool:
    """Return whether the segment keeps ``standoff_m`` to the object, at any height.

    A start or goal that is itself nearer does not count against the way away from it.
    """
    start, end = (float(position[0]), float(position[1])), (float(goal[0]), float(goal[1]))
    rectangle = _rectangle(obstacle)
    near_start, near_end = _point_distance(start, rectangle), _point_distance(end, rectangle)
    if near_end <= 0.0:
        return False
    allowed = min(standoff_m, near_start, near_end) - 0.01
    return segment_distance(start, end, rectangle) >= allowed


def segment_distance(
    start: _Point, end: _Point, rectangle: tuple[float, float, float, float]
) -> float:
    """Return the distance between a segment and an upright rectangle, 0 when they meet.

    When they are apart, an end of the segment or a corner of the rectangle is one of the nearest
    points.

    Args:
        start: One end.
        end: The other end.
        rectangle: Least x and y, greatest x and y.
    """
    if _meets(start, end, rectangle):
        return 0.0
    x0, y0, x1, y1 = rectangle
    ends = min(_point_distance(start, rectangle), _point_distance(end, rectangle))
    corners = ((x0, y0), (x0, y1), (x1, y0), (x1, y1))
    return min(ends, *(_distance_to_segment(corner, start, end) for corner in corners))


def _meets(start: _Point, end: _Point, rectangle: tuple[float, float, float, float]) -> bool:
    """Return whether a segment and a rectangle meet: per axis, the share of it that is inside."""
    low, high = 0.0, 1.0
    for axis in (0, 1):
        step = end[axis] - start[axis]
        before, behind = rectangle[axis] - start[axis], rectangle[axis + 2] - start[axis]
        if abs(step) < 1e-12:
            if before > 0.0 or behind < 0.0:
                return False
            continue
        enters, leaves = sorted((before / step, behind / step))
        low, high = max(low, enters), min(high, leaves)
    return low <= high


def _distance_to_segment(point: _Point, start: _Point, end: _Point) -> float:
    x, y = end[0] - start[0], end[1] - start[1]
    px, py = point[0] - start[0], point[1] - start[1]
    squared = x * x + y * y
    share = min(max((px * x + py * y) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
    return math.hypot(px - share * x, py - share * y)


def _point_distance(point: _Point, rectangle: tuple[float, float, float, float]) -> float:
    x0, y0, x1, y1 = rectangle
    return math.hypot(
        max(x0 - point[0], 0.0, point[0] - x1), max(y0 - point[1], 0.0, point[1] - y1)
    )


def _rectangle(box: Box3) -> tuple[float, float, float, float]:
    x0, y0, _ = box.lower.tolist()
    x1, y1, _ = box.upper.tolist()
    return x0, y0, x1, y1


def _polar(position: Array, goal: Array, obstacle: Box3) -> tuple[float, float, float]:
    """Return the position's azimuth about the object, and radius of position and goal."""
    x0, y0, x1, y1 = _rectangle(obstacle)
    cx, cy = (x0 + x1) / 2.0, (y0 + y1) / 2.0
    x, y = float(position[0]) - cx, float(position[1]) - cy
    return (
        math.atan2(y, x),
        math.hypot(x, y),
        math.hypot(float(goal[0]) - cx, float(goal[1]) - cy),
    )


def _turn(position: Array, goal: Array, obstacle: Box3) -> float:
    """Return the azimuth from position to goal about the object, in [-pi, pi)."""
    here, _, _ = _polar(position, goal, obstacle)
    there, _, _ = _polar(goal, goal, obstacle)
    return (there - here + math.pi) % (2.0 * math.pi) - math.pi


def _way_left(position: Array, goal: Array, obstacle: Box3, turning: int) -> float:
    """Return the length of the way left, straight (0) or round the object."""
    if not turning:
        return math.hypot(*(goal - position).tolist())
    _, here_m, there_m = _polar(position, goal, obstacle)
    around = (turning * _turn(position, goal, obstacle)) % (2.0 * math.pi)
    return math.hypot(around * (here_m + there_m) / 2.0, float(goal[2] - position[2]))
