"""The right-hand rule: what drones do so that nobody waits for ever for somebody else.

Reciprocal avoidance is symmetric: drones that meet head-on would brake and stand. A drone that has
another one ahead turns its wish to the right, the more the nearer the other and the less progress
it makes. Four that meet in the middle thus go round it counter-clockwise. The rule needs no memory.

Symbols: world metres and m/s, plain floats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from server.planner.config import AvoidanceConfig
from server.planner.halfspaces import Vector

# A drone that wants to move slower than this only keeps its place: it will not make room for long.
_PARKED_M_S = 0.15
# Slower wishes have no direction worth turning.
_STILL_M_S = 0.03
# Others count as ahead within this cosine of the wanted direction.
_AHEAD = 0.3


class Mover(NamedTuple):
    """A drone in plain numbers.

    Attributes:
        position: Where it is.
        velocity: Its velocity.
        stop: Where it would come to rest.
        wanted: Velocity it would take if it were alone.
        intended: Velocity that others may count on: its wish, or what it does if it cannot yield.
        radius: Its protected radius.
        yields: Whether it follows what it is told.
        known: Whether its position is finite.
    """

    position: Vector
    velocity: Vector
    stop: Vector
    wanted: Vector
    intended: Vector
    radius: float
    yields: bool
    known: bool


class Bounds(NamedTuple):
    """A box to keep away from: its corners, perhaps at infinity, and the least distance."""

    lower: Vector
    upper: Vector
    standoff_m: float


def sidestepped(
    index: int,
    movers: Sequence[Mover],
    boxes: Sequence[Bounds],
    fence_radius_m: float,
    config: AvoidanceConfig,
) -> Vector:
    """Return what ``movers[index]`` wants, turned a little aside for every drone ahead.

    A drone that hovers at its goal will not make room, so it is passed on the side where there is
    room between ``boxes`` and fence, and with more will.
    """
    me = movers[index]
    wx, wy, wz = me.wanted
    speed = math.sqrt(wx * wx + wy * wy + wz * wz)
    if speed < _STILL_M_S:
        return me.wanted
    heading = wx / speed, wy / speed, wz / speed
    rx, ry = _right(heading, index)
    progress = sum(a * b for a, b in zip(me.velocity, heading, strict=True)) / speed
    stalled = 1.0 - min(max(progress, 0.0), 1.0)
    reach = 2.0 * config.radius_m + config.speed_max_m_s * config.horizon_s
    step = 0.0
    for other, it in enumerate(movers):
        if other == index or not it.known:
            continue
        tx, ty, tz = (b - a for a, b in zip(me.position, it.position, strict=True))
        distance = math.sqrt(tx * tx + ty * ty + tz * tz)
        along = tx * heading[0] + ty * heading[1] + tz * heading[2]
        if not (1e-9 < distance < reach and along > _AHEAD * distance):
            continue
        will = (config.sidestep + config.sidestep_stalled * stalled) * (1.0 - distance / reach)
        if not it.yields or math.hypot(*it.wanted) < _PARKED_M_S:
            ox, oy = _open_side(boxes, fence_radius_m, it.position, 2.0 * config.radius_m)
            will *= config.parked_factor if ox * rx + oy * ry >= 0.0 else -config.parked_factor
        step += will
    return wx + step * speed * rx, wy + step * speed * ry, wz


def _right(heading: Vector, index: int) -> tuple[float, float]:
    """Return the horizontal unit vector to the right of ``heading``."""
    x, y = heading[1], -heading[0]
    length = math.hypot(x, y)
    if length < 0.1:
        # Straight up or down there is no right; each drone has its own way aside.
        return math.cos(2.4 * index), math.sin(2.4 * index)
    return x / length, y / length


def _open_side(
    boxes: Sequence[Bounds], fence_radius_m: float, position: Vector, needed_m: float
) -> tuple[float, float]:
    """Return the horizontal unit vector to the side of ``position`` where there is room to pass.

    That is the side away from the nearest box, unless the fence is nearer and leaves no room; zero
    where all sides are open.
    """
    px, py, _ = position
    nearest_m, away = math.inf, (0.0, 0.0)
    for lower, upper, standoff_m in boxes:
        dx = max(lower[0] - px, 0.0, px - upper[0])
        dy = max(lower[1] - py, 0.0, py - upper[1])
        room_m = math.hypot(dx, dy) - standoff_m
        if room_m < nearest_m:
            x, y = px - (lower[0] + upper[0]) / 2.0, py - (lower[1] + upper[1]) / 2.0
            length = max(math.hypot(x, y), 1e-9)
            nearest_m, away = room_m, (x / length, y / length)
    radius = math.hypot(px, py)
    fence_m = fence_radius_m - radius
    if fence_m < needed_m and fence_m < nearest_m and radius > 1e-9:
        return -px / radius, -py / radius
    return away
