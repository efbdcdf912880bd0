"""The half-spaces of velocities that keep a drone apart from drones, boxes and the fence.

Symbols: s is a drone's stopping point, p the relative stopping point, v the relative velocity, R
the summed radii, tau a horizon; metres and m/s, plain floats. Rows are those of
``server.planner.halfspaces``: n . u >= o for the velocity u that the drone is told.

A drone that follows its told velocity u with a first-order lag T stops, told to, at s = x + T v.
That point moves with exactly u, whatever v is now, so half-spaces for s need no approximation of
the lag; and x itself is a weighted mean of where s has been.
"""

from __future__ import annotations

import math

from server.planner.halfspaces import Row, Vector


def reciprocal_row(
    p: Vector, own: Vector, other: Vector, R: float, share: float, horizons: tuple[float, float]
) -> Row:
    """Return the half-space of optimal reciprocal collision avoidance.

    Van den Berg, Guy, Lin, Manocha, "Reciprocal n-body collision avoidance", 2011: u is the least
    change of v that leaves the velocity obstacle, the drone takes ``share`` of it.

    Args:
        p: The other drone's stopping point relative to this one's.
        own: This drone's velocity.
        other: The other drone's velocity.
        R: Distance to keep.
        share: Part of the change that is this drone's to make, 1/2 when both avoid.
        horizons: tau, and the time in which drones that are too close shall be apart again.
    """
    v = own[0] - other[0], own[1] - other[1], own[2] - other[2]
    normal, depth = _way_out(p, v, R, horizons)
    nx, ny, nz = normal
    return nx, ny, nz, nx * own[0] + ny * own[1] + nz * own[2] + share * depth


def stretched(row: Row, factor: float) -> Row:
    """Return a row found in a space where heights are divided by ``factor`` for true heights.

    There velocities are S u with S = diag(1, 1, 1 / factor), and n . S u = (S n) . u.
    """
    nx, ny, nz, o = row
    nz = nz / factor
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    return nx / length, ny / length, nz / length, o / length


def wall_speed(free_m: float, horizon_s: float, recovery_s: float, retreat_max: float) -> float:
    """Return the least velocity away from a wall ``free_m`` away from s (negative: behind it).

    The free distance then decays no faster than exp(-t / horizon), so s never crosses the wall.
    """
    if free_m >= 0.0:
        return -free_m / horizon_s
    return min(-free_m / recovery_s, retreat_max)


def box_direction(s: Vector, lower: Vector, upper: Vector) -> tuple[Vector, float]:
    """Return the unit direction away from a box and the distance, negative inside.

    Inside it is the shortest way out. A side at infinity is never the shortest.
    """
    ax = max(lower[0] - s[0], 0.0, s[0] - upper[0])
    ay = max(lower[1] - s[1], 0.0, s[1] - upper[1])
    az = max(lower[2] - s[2], 0.0, s[2] - upper[2])
    distance = math.sqrt(ax * ax + ay * ay + az * az)
    if distance > 1e-9:
        return (
            (
                math.copysign(ax, s[0] - upper[0]) / distance,
                math.copysign(ay, s[1] - upper[1]) / distance,
                math.copysign(az, s[2] - upper[2]) / distance,
            ),
            distance,
        )
    depth, axis, sign = min(
        (depth, axis, sign)
        for axis in range(3)
        for depth, sign in ((upper[axis] - s[axis], 1.0), (s[axis] - lower[axis], -1.0))
    )
    return (
        sign * float(axis == 0),
        sign * float(axis == 1),
        sign * float(axis == 2),
    ), -max(depth, 0.0)


def _way_out(p: Vector, v: Vector, R: float, horizons: tuple[float, float]) -> tuple[Vector, float]:
    """Return unit normal and depth u of the shortest way of ``v`` out of the velocity obstacle."""
    tau, recovery_s = horizons
    px, py, pz = p
    vx, vy, vz = v
    a = px * px + py * py + pz * pz
    gap = a - R * R
    if gap <= 0.0:
        # Already too close: part, to be R apart after the recovery time. (RVO2 takes v the nearest
        # way out of a ball, but for drones that close in fast that leads through one another.)
        d = math.sqrt(a)
        nx, ny, nz = -px / d, -py / d, -pz / d
        return (nx, ny, nz), (R - d) / recovery_s - (nx * vx + ny * vy + nz * vz)
    wx, wy, wz = vx - px / tau, vy - py / tau, vz - pz / tau
    along = wx * px + wy * py + wz * pz
    if along < 0.0 and along * along > R * R * (wx * wx + wy * wy + wz * wz):
        return _out_of_ball(p, v, R, tau)
    # Nearest point on the cone's mantle: v moved off the axis point t p until it is R t from it.
    # t solves a quadratic equation whose discriminant is (|p x v| R)^2 / gap; written like this it
    # does not cancel when v points along p.
    b = px * vx + py * vy + pz * vz
    kx, ky, kz = py * vz - pz * vy, pz * vx - px * vz, px * vy - py * vx
    sideways = math.sqrt(kx * kx + ky * ky + kz * kz)
    t = (b + sideways * R / math.sqrt(gap)) / a
    x, y, z = vx - t * px, vy - t * py, vz - t * pz
    length = math.sqrt(x * x + y * y + z * z)
    if length > 1e-9:
        return (x / length, y / length, z / length), R * t - length
    # Exactly along the axis every side is as near; the mantle leans by the cone's angle.
    ax, ay, az = across(p)
    lean, root, length = R / math.sqrt(a), math.sqrt(gap), math.sqrt(a)
    return (
        (root * ax - lean * px) / length,
        (root * ay - lean * py) / length,
        (root * az - lean * pz) / length,
    ), R * t


def _out_of_ball(p: Vector, v: Vector, R: float, time_s: float) -> tuple[Vector, float]:
    x, y, z = v[0] - p[0] / time_s, v[1] - p[1] / time_s, v[2] - p[2] / time_s
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-9:
        return across(p), R / time_s
    return (x / length, y / length, z / length), R / time_s - length


def across(p: Vector) -> Vector:
    """Return a unit vector across ``p``, to the right of it; opposite ``p`` give opposite ones."""
    x, y = p[1], -p[0]
    length = math.hypot(x, y)
    if length < 1e-9:
        return (-1.0 if p[2] < 0.0 else 1.0), 0.0, 0.0
    return x / length, y / length, 0.0
