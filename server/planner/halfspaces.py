"""The velocity nearest to a wanted one that satisfies half-spaces and a speed limit.

Symbols: row i of ``normals`` ``(n, 3)`` and ``offsets`` ``(n,)`` asks n_i . v >= o_i; normals have
unit length; velocities in m/s. There are only a dozen rows, so the solver simply tries every set of
one, two or three rows that may hold with equality, which cannot cycle or diverge.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TOLERANCE = 1e-7
_BISECTIONS = 24


def nearest_velocity(
    wanted: Array, normals: Array, offsets: Array, speed_max: float
) -> Array | None:
    """Return the velocity ``(3,)`` nearest to ``wanted`` that every row and the speed limit allow.

    None when there is no such velocity.
    """
    clipped = _clip(wanted, speed_max)
    slack = normals @ clipped - offsets
    if (slack >= -_TOLERANCE).all():
        return clipped
    # The optimum of one violated row alone is the optimum of all when it satisfies the others.
    single = _on_planes(wanted, normals, offsets, speed_max)
    best = _nearest_feasible(single[slack < -_TOLERANCE], wanted, normals, offsets, speed_max)
    if best is not None:
        return best
    candidates = [
        single,
        _on_lines(wanted, normals, offsets, speed_max),
        _on_corners(normals, offsets),
    ]
    return _nearest_feasible(np.concatenate(candidates), wanted, normals, offsets, speed_max)


def least_violating_velocity(
    wanted: Array, normals: Array, offsets: Array, speed_max: float, soft: NDArray[np.bool_]
) -> Array:
    """Return the nearest velocity after relaxing the ``soft`` rows ``(n,)`` as little as needed.

    All of them are relaxed equally. When even that does not help, every row is relaxed.
    """
    for relaxable in (soft, np.ones(len(soft), bool)):
        if not relaxable.any():
            continue
        # With this much slack the rows allow standing still, which the speed limit does too.
        high = float(np.max(offsets[relaxable])) + 1e-6
        low = 0.0
        best = nearest_velocity(wanted, normals, offsets - high * relaxable, speed_max)
        if best is None:
            continue
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2.0
            trial = nearest_velocity(wanted, normals, offsets - middle * relaxable, speed_max)
            if trial is None:
                low = middle
            else:
                best, high = trial, middle
        return best
    return np.zeros(3)


def _clip(velocity: Array, speed_max: float) -> Array:
    speed = float(np.linalg.norm(velocity))
    return velocity if speed <= speed_max else velocity * (speed_max / speed)


def _nearest_feasible(
    candidates: Array, wanted: Array, normals: Array, offsets: Array, speed_max: float
) -> Array | None:
    if len(candidates) == 0:
        return None
    with np.errstate(invalid="ignore"):
        holds = (candidates @ normals.T >= offsets - _TOLERANCE).all(axis=1)
        holds &= np.linalg.norm(candidates, axis=1) <= speed_max + _TOLERANCE
    if not holds.any():
        return None
    feasible = candidates[holds]
    return feasible[np.linalg.norm(feasible - wanted, axis=1).argmin()]


def _on_planes(wanted: Array, normals: Array, offsets: Array, speed_max: float) -> Array:
    """Return per row the point of its plane, inside the speed limit, nearest to ``wanted``."""
    foot = wanted + (offsets - normals @ wanted)[:, None] * normals
    centre = offsets[:, None] * normals
    aside = foot - centre
    length = np.linalg.norm(aside, axis=1, keepdims=True)
    # With the wanted velocity straight above the plane's centre any direction is as near.
    fallback = np.cross(normals, np.roll(normals, 1, axis=1) + np.array([0.3, 0.5, 0.7]))
    fallback /= np.maximum(np.linalg.norm(fallback, axis=1, keepdims=True), 1e-12)
    unit = np.where(length > 1e-12, aside / np.maximum(length, 1e-12), fallback)
    reach = np.sqrt(np.maximum(speed_max**2 - offsets**2, 0.0))[:, None]
    return centre + np.minimum(length, reach) * unit


def _on_lines(wanted: Array, normals: Array, offsets: Array, speed_max: float) -> Array:
    """Return, per pair of rows, the points of their common line that may be nearest."""
    pairs = np.array(list(combinations(range(len(normals)), 2)), dtype=np.intp).reshape(-1, 2)
    n, m = normals[pairs[:, 0]], normals[pairs[:, 1]]
    p, q = offsets[pairs[:, 0]], offsets[pairs[:, 1]]
    along = np.cross(n, m)
    squared = (along**2).sum(axis=1)
    crossing = squared > 1e-10
    n, m, p, q, along, squared = (a[crossing] for a in (n, m, p, q, along, squared))
    point = (p[:, None] * np.cross(m, along) + q[:, None] * np.cross(along, n)) / squared[:, None]
    along = along / np.sqrt(squared)[:, None]
    foot = point + ((wanted - point) * along).sum(axis=1, keepdims=True) * along
    # ``point`` is the line's nearest to the origin, so the speed limit cuts it symmetrically.
    half = np.sqrt(np.maximum(speed_max**2 - (point**2).sum(axis=1), 0.0))[:, None]
    return np.concatenate([foot, point + half * along, point - half * along])


def _on_corners(normals: Array, offsets: Array) -> Array:
    """Return the common points of every three rows."""
    triples = np.array(list(combinations(range(len(normals)), 3)), dtype=np.intp).reshape(-1, 3)
    matrices = normals[triples]
    regular = np.abs(np.linalg.det(matrices)) > 1e-6
    corners = np.linalg.solve(matrices[regular], offsets[triples][regular][..., None])
    return np.asarray(corners[..., 0], np.float64)
