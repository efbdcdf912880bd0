"""How drones go round the object: distances, arcs and separation that all modules agree on.

Symbols: cylindrical coordinates about the vertical through the object's centre: azimuth a, radius
r, height z. Nobody flies above the object, so for motion it is an endless column.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3

Array = NDArray[np.float64]

# Far above any ceiling and below any floor.
_COLUMN_HALF_HEIGHT_M = 1e3


def column(box: Box3) -> Box3:
    """Return ``box`` stretched into an endless vertical column."""
    lower, upper = box.lower.copy(), box.upper.copy()
    lower[2], upper[2] = -_COLUMN_HALF_HEIGHT_M, _COLUMN_HALF_HEIGHT_M
    return Box3(lower, upper)


def cylindrical(positions: Array, centre: Array) -> Array:
    """Return azimuth, radius and height about ``centre`` of ``positions``, both ``(..., 3)``."""
    offset = positions[..., :2] - centre[:2]
    return np.stack(
        [
            np.arctan2(offset[..., 1], offset[..., 0]),
            np.hypot(offset[..., 0], offset[..., 1]),
            positions[..., 2],
        ],
        axis=-1,
    )


def turn(from_azimuth: Array, to_azimuth: Array) -> Array:
    """Return the shorter turn in ``[-pi, pi)`` between azimuths; half a turn goes clockwise."""
    return (to_azimuth - from_azimuth + np.pi) % (2.0 * np.pi) - np.pi


def arc_length(start: Array, goal: Array) -> Array:
    """Return the length in metres of the way round between cylindrical points ``(..., 3)``."""
    around = np.abs(turn(start[..., 0], goal[..., 0])) * (start[..., 1] + goal[..., 1]) / 2.0
    return np.sqrt(
        around**2 + (goal[..., 1] - start[..., 1]) ** 2 + (goal[..., 2] - start[..., 2]) ** 2
    )


def arc_points(start: Array, goal: Array, steps: int) -> Array:
    """Return points ``(steps, ..., 3)``, without the start, on the way round.

    ``start`` and ``goal`` are cylindrical ``(..., 3)``; the points are Cartesian about the centre.
    """
    share = (np.arange(1, steps + 1) / steps).reshape(-1, *[1] * (start.ndim - 1))
    azimuth = start[..., 0] + share * turn(start[..., 0], goal[..., 0])
    radius = start[..., 1] + share * (goal[..., 1] - start[..., 1])
    height = start[..., 2] + share * (goal[..., 2] - start[..., 2])
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)


def separation(a: Array, b: Array, downwash_factor: float) -> Array:
    """Return the distance in metres between points ``(..., 3)``, heights shrunk by the downwash."""
    difference = b - a
    return np.sqrt(
        difference[..., 0] ** 2
        + difference[..., 1] ** 2
        + (difference[..., 2] / downwash_factor) ** 2
    )
