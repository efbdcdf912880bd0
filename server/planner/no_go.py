"""Volumes that no drone may enter: whether planned places keep clear of them.

Symbols: points ``(..., 3)`` and the volumes of ``FlightSpace.no_go`` are in one frame, the world's
unless a function says otherwise; metres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from server.planner.config import FlightSpace

Array = NDArray[np.float64]


def intrusion(points: Array, space: FlightSpace) -> Array:
    """Return by how many metres points ``(..., 3)`` miss the clearance, ``(...)``, 0 when clear."""
    worst = np.zeros(points.shape[:-1])
    for corners in space.no_go:
        lower, upper = np.array(corners[:3]), np.array(corners[3:])
        outside = np.maximum(np.maximum(lower - points, points - upper), 0.0)
        missing = space.no_go_clearance_m - np.linalg.norm(outside, axis=-1)
        # Inside, the way to the nearest face is missing, too; with no clearance it alone counts.
        depth = np.minimum(points - lower, upper - points).min(axis=-1)
        worst = np.maximum(worst, np.maximum(missing, 0.0) + np.maximum(depth, 0.0))
    return worst


def space_about(centre: Array, space: FlightSpace) -> FlightSpace:
    """Return ``space`` with its volumes in coordinates about ``centre`` ``(3,)``, world axes.

    The vertical is counted from the floor in both.
    """
    shift = np.array([centre[0], centre[1], 0.0])
    moved = []
    for corners in space.no_go:
        x0, y0, z0, x1, y1, z1 = (np.array(corners) - np.tile(shift, 2)).tolist()
        moved.append((x0, y0, z0, x1, y1, z1))
    return replace(space, no_go=tuple(moved))
