"""Where drones land: beside one another and beside what already stands there. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.planner.config import FlightSpace

Array = NDArray[np.float64]

# Between landing places: twice what a Tello measures, and what is usually unsure about where each
# is: this many standard deviations of a usual pose.
CLEARANCE_M = 0.9
_SIGMAS = 2.0
_USUAL_SIGMA_M = 0.25
# Wherever a drone may be, some room must be left for the others.
_MOST_EXTRA_M = 1.5
# Nobody steers a landing: a wind that rises meanwhile must not carry it over the fence.
_OFF_FENCE_M = 1.0
_RINGS_M = (0.0, 0.3, 0.6, 0.9, 1.2, 1.6, 2.0, 2.5, 3.2, 4.0)
_DIRECTIONS = 16


@dataclass(frozen=True, slots=True, eq=False)
class Down:
    """A drone that is down, or a place where one that fell silent may be.

    Attributes:
        position: Believed position ``(3,)``, world metres.
        sigma_m: Its standard deviation.
    """

    position: Array
    sigma_m: float

    @property
    def apart_m(self) -> float:
        """How far from it others land."""
        extra_m = _SIGMAS * (self.sigma_m - _USUAL_SIGMA_M)
        return CLEARANCE_M + min(max(0.0, extra_m), _MOST_EXTRA_M)


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """A drone that is to land.

    Attributes:
        position: Believed position ``(3,)``, world metres.
        drift_m: How far ``(2,)`` the wind will carry it, world metres: nobody steers a landing.
    """

    position: Array
    drift_m: Array = field(default_factory=lambda: np.zeros(2))


def landing_places(
    flying: Mapping[str, Landing],
    down: Sequence[Down],
    object_box: Box3 | None,
    space: FlightSpace,
) -> dict[str, Array]:
    """Return above which place ``(2,)``, world metres, each drone shall begin to land.

    Each drone touches down at the nearest place that is clear; without any, at the one with most
    room about it.

    Args:
        flying: The drones that are to land.
        down: What nobody may land on.
        object_box: The object's outer box, None while it is unknown.
        space: Fence, standoff and no-go volumes.
    """
    taken = [(other.position[:2], other.apart_m) for other in down]
    places: dict[str, Array] = {}
    for drone_id, landing in flying.items():
        others = [
            (other.position[:2] + other.drift_m, CLEARANCE_M)
            for d, other in flying.items()
            if d not in places and d != drone_id
        ]
        unsteered = landing.position[:2] + landing.drift_m
        touch_down = _best(unsteered, [*taken, *others], object_box, space)
        places[drone_id] = touch_down - landing.drift_m
        taken.append((touch_down, CLEARANCE_M))
    return places


def _best(
    here: Array, taken: Sequence[tuple[Array, float]], object_box: Box3 | None, space: FlightSpace
) -> Array:
    best, most_room_m = here, -np.inf
    for place in _around(here):
        if not _is_allowed(place, object_box, space):
            continue
        room_m = min((float(np.linalg.norm(place - p)) - apart for p, apart in taken), default=0.0)
        if room_m >= 0.0:
            return place
        if room_m > most_room_m:
            best, most_room_m = place, room_m
    return best


def _around(centre: Array) -> list[Array]:
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return [centre + ring_m * way for ring_m in _RINGS_M for way in around]


def _is_allowed(place: Array, object_box: Box3 | None, space: FlightSpace) -> bool:
    if np.linalg.norm(place) > space.fence_radius_m - _OFF_FENCE_M:
        return False
    for x_0, y_0, _, x_1, y_1, _ in space.no_go:
        lower, upper = np.array([x_0, y_0]), np.array([x_1, y_1])
        if _beside_m(place, lower, upper) < space.no_go_clearance_m:
            return False
    if object_box is None:
        return True
    return _beside_m(place, object_box.lower[:2], object_box.upper[:2]) >= space.standoff_m


def _beside_m(place: Array, lower: Array, upper: Array) -> float:
    """Return the distance of ``place`` ``(2,)`` from the rectangle, 0 inside."""
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(lower - place, place - upper))))
