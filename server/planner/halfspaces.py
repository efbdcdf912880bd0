"""The velocity nearest to a wanted one that satisfies half-spaces and speed limits.

Symbols: a row ``(nx, ny, nz, o)`` asks n . v >= o of a velocity v, with n of unit length; a ball
asks for |v - centre| <= radius; all in m/s. Numbers are plain floats, because a dozen rows in three
dimensions are too few for arrays to pay.

The nearest point of a convex set is found by adding one row after the other: while a new row holds
at the optimum so far, that stays; otherwise the new optimum lies on the row's plane, which is the
same problem with one dimension less (Seidel, "Small-dimensional linear programming and convex
hulls made easy", 1991; van den Berg et al. 2011 use the same idea for ORCA). On a line the problem
is an interval. Nothing iterates to a tolerance, so nothing can fail to converge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]

# How far, in m/s, a row may be violated and still count as satisfied.
_TOLERANCE = 1e-9
# Squared sine of the angle under which two planes count as parallel.
_PARALLEL = 1e-14
# Each halves the interval of the least relaxation, which begins below 2 m/s.
_BISECTIONS = 20


class Ball(NamedTuple):
    """All velocities within ``radius`` of ``centre``, m/s."""

    centre: Vector
    radius: float


def nearest_velocity(
    wanted: Vector, rows: Sequence[Row], ball: Ball, second: Ball | None = None
) -> Vector | None:
    """Return the velocity nearest to ``wanted`` inside all rows and balls, None if there is none.

    With two balls the optimum touches only one of them, which is then the optimum with that ball
    alone, or both; then it lies on the plane through the circle where the two spheres meet.
    """
    found = _in_space(wanted, rows, ball)
    if found is None or second is None or _inside(found, second):
        return found
    found = _in_space(wanted, rows, second)
    if found is None or _inside(found, ball):
        return found
    plane = _plane_between(ball, second)
    return None if plane is None else _on_plane(plane, wanted, rows, ball)


def least_violating_velocity(
    wanted: Vector,
    rows: Sequence[Row],
    give: Sequence[float],
    ball: Ball,
    second: Ball | None = None,
) -> Vector:
    """Return the nearest velocity after relaxing the rows as little as needed.

    Args:
        wanted: The velocity to be near to.
        rows: Half-spaces that contradict one another.
        give: Per row the share, 0..1, of the common relaxation that it gets; 0 for one that stays
            as it is. When that does not help, all rows are relaxed equally.
        ball: A limit that is never relaxed.
        second: Another one, which must meet the first.
    """
    for shares in (give, [1.0] * len(rows)):
        # No velocity inside the ball violates a row by more.
        reach = ball.radius + math.hypot(*ball.centre)
        high = max(((r[3] + reach) / g for r, g in zip(rows, shares, strict=True) if g), default=0)
        low = 0.0
        best = nearest_velocity(wanted, _relaxed(rows, shares, high), ball, second)
        if best is None:
            continue
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2.0
            trial = nearest_velocity(wanted, _relaxed(rows, shares, middle), ball, second)
            if trial is None:
                low = middle
            else:
                best, high = trial, middle
        return best
    # Two balls that hardly touch: their common point is the only choice.
    return nearest_velocity(wanted, [], ball, second) or ball.centre


def _relaxed(rows: Sequence[Row], shares: Sequence[float], by: float) -> list[Row]:
    return [
        (row[0], row[1], row[2], row[3] - by * share) if share else row
        for row, share in zip(rows, shares, strict=True)
    ]


def _inside(v: Vector, ball: Ball) -> bool:
    (x, y, z), radius = ball
    limit = radius + _TOLERANCE
    return (v[0] - x) ** 2 + (v[1] - y) ** 2 + (v[2] - z) ** 2 <= limit * limit


def _plane_between(ball: Ball, second: Ball) -> Row | None:
    """Return the plane of the circle in which the two spheres meet, None if they do not."""
    (ax, ay, az), a = ball
    (bx, by, bz), b = second
    x, y, z = bx - ax, by - ay, bz - az
    apart = math.sqrt(x * x + y * y + z * z)
    if apart < 1e-12 or apart > a + b:
        return None
    x, y, z = x / apart, y / apart, z / apart
    along = (apart * apart + a * a - b * b) / (2.0 * apart)
    return x, y, z, along + x * ax + y * ay + z * az


def _in_space(wanted: Vector, rows: Sequence[Row], ball: Ball) -> Vector | None:
    """Return the optimum over all rows, with one ball."""
    (cx, cy, cz), radius = ball
    x, y, z = wanted[0] - cx, wanted[1] - cy, wanted[2] - cz
    length = math.sqrt(x * x + y * y + z * z)
    shrink = radius / length if length > radius else 1.0
    v = cx + shrink * x, cy + shrink * y, cz + shrink * z
    for index, row in enumerate(rows):
        if row[0] * v[0] + row[1] * v[1] + row[2] * v[2] < row[3] - _TOLERANCE:
            found = _on_plane(row, wanted, rows[:index], ball)
            if found is None:
                return None
            v = found
    return v


def _on_plane(plane: Row, wanted: Vector, rows: Sequence[Row], ball: Ball) -> Vector | None:
    """Return the optimum over ``rows`` on a plane, where the ball is a disc."""
    nx, ny, nz, o = plane
    (cx, cy, cz), radius = ball
    height = o - nx * cx - ny * cy - nz * cz
    squared = radius * radius - height * height
    if squared < 0.0:
        return None
    radius = math.sqrt(squared)
    cx, cy, cz = cx + height * nx, cy + height * ny, cz + height * nz
    height = o - nx * wanted[0] - ny * wanted[1] - nz * wanted[2]
    x = wanted[0] + height * nx - cx
    y = wanted[1] + height * ny - cy
    z = wanted[2] + height * nz - cz
    length = math.sqrt(x * x + y * y + z * z)
    shrink = radius / length if length > radius else 1.0
    v = cx + shrink * x, cy + shrink * y, cz + shrink * z
    for index, row in enumerate(rows):
        if row[0] * v[0] + row[1] * v[1] + row[2] * v[2] < row[3] - _TOLERANCE:
            found = _on_line(plane, row, wanted, rows[:index], ball)
            if found is None:
                return None
            v = found
    return v


def _on_line(
    first: Row, second: Row, wanted: Vector, rows: Sequence[Row], ball: Ball
) -> Vector | None:
    """Return the optimum over ``rows`` on the line where two planes meet."""
    nx, ny, nz, p = first
    mx, my, mz, q = second
    dx, dy, dz = ny * mz - nz * my, nz * mx - nx * mz, nx * my - ny * mx
    squared = dx * dx + dy * dy + dz * dz
    if squared < _PARALLEL:
        # The second row is violated all over the first one's plane.
        return None
    # The line's point nearest to the origin: (p m x d + q d x n) / |d|^2.
    x = (p * (my * dz - mz * dy) + q * (dy * nz - dz * ny)) / squared
    y = (p * (mz * dx - mx * dz) + q * (dz * nx - dx * nz)) / squared
    z = (p * (mx * dy - my * dx) + q * (dx * ny - dy * nx)) / squared
    length = math.sqrt(squared)
    dx, dy, dz = dx / length, dy / length, dz / length
    (cx, cy, cz), radius = ball
    middle = dx * (cx - x) + dy * (cy - y) + dz * (cz - z)
    ex, ey, ez = x + middle * dx - cx, y + middle * dy - cy, z + middle * dz - cz
    squared = radius * radius - ex * ex - ey * ey - ez * ez
    if squared < 0.0:
        return None
    half = math.sqrt(squared)
    low, high = middle - half, middle + half
    for kx, ky, kz, o in rows:
        rises = kx * dx + ky * dy + kz * dz
        missing = o - kx * x - ky * y - kz * z
        if abs(rises) < 1e-9:
            if missing > _TOLERANCE:
                return None
        elif rises > 0.0:
            low = max(low, missing / rises)
        else:
            high = min(high, missing / rises)
        if low > high:
            return None
    t = dx * (wanted[0] - x) + dy * (wanted[1] - y) + dz * (wanted[2] - z)
    t = min(max(t, low), high)
    return x + t * dx, y + t * dy, z + t * dz
