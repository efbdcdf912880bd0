"""Where drones land: beside one another and beside what already stands there. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import FlightSpace

Array = NDArray[np.float64]

# Between landing places: twice what a Tello measures, and what is unsure about where each is.
CLEARANCE_M = 0.9
# Where a drone came down that fell silent in flight is known to about so much less.
_LOST_M = 0.9
_RINGS_M = (0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0)
_DIRECTIONS = 16


def landing_places(
    flying: Mapping[str, Array],
    standing: Sequence[Array],
    object_box: Box3 | None,
    space: FlightSpace,
    lost: Sequence[Array] = (),
) -> dict[str, Array]:
    """Return above which place ``(2,)``, world metres, each drone shall go down.

    Each drone takes the nearest place that is clear; without any it stays where it is.

    Args:
        flying: Believed positions ``(3,)`` of the drones that are to land.
        standing: Those of the drones that are down.
        object_box: The object's outer box, None while it is unknown.
        space: Fence and standoff.
        lost: Where drones are believed that have not been heard for a while.
    """
    taken = [(position[:2], CLEARANCE_M) for position in standing]
    taken += [(position[:2], CLEARANCE_M + _LOST_M) for position in lost]
    places: dict[str, Array] = {}
    for drone_id, position in flying.items():
        others = [
            (p[:2], CLEARANCE_M) for d, p in flying.items() if d not in places and d != drone_id
        ]
        clear = (
            place
            for place in _around(position[:2])
            if _is_clear(place, [*taken, *others], object_box, space)
        )
        places[drone_id] = next(clear, position[:2])
        taken.append((places[drone_id], CLEARANCE_M))
    return places


def _around(centre: Array) -> list[Array]:
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [centre + ring_m * way for ring_m in _RINGS_M for way in around]


def _is_clear(
    place: Array,
    taken: Sequence[tuple[Array, float]],
    object_box: Box3 | None,
    space: FlightSpace,
) -> bool:
    if any(np.linalg.norm(place - other) < apart_m for other, apart_m in taken):
        return False
    if np.linalg.norm(place) > space.fence_radius_m:
        return False
    if object_box is None:
        return True
    lower, upper = object_box.lower[:2], object_box.upper[:2]
    beside = np.maximum(0.0, np.maximum(lower - place, place - upper))
    return bool(np.linalg.norm(beside) >= space.standoff_m)
