"""Where the field is looked at from: views on a sphere about the object, the orbit among them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.poses import look_at

Array = NDArray[np.float64]

ELEVATION_MAX_RAD = 1.5
DISTANCE_LEAST, DISTANCE_MOST = 0.2, 4.0


@dataclass(frozen=True, slots=True)
class OrbitView:
    """Where somebody looks at the object from.

    Attributes:
        azimuth_rad: About the object, counter-clockwise from the world's +X.
        elevation_rad: Above the object's middle.
        distance: From there, as a share of the training cameras' median distance.

    Raises:
        ValueError: If it is no place to look from.
    """

    azimuth_rad: float
    elevation_rad: float
    distance: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.azimuth_rad):
            raise ValueError(f"azimuth_rad must be finite, not {self.azimuth_rad!r}")
        # Straight from above a picture has no upright.
        if not abs(self.elevation_rad) <= ELEVATION_MAX_RAD:
            raise ValueError(f"elevation_rad must be within {ELEVATION_MAX_RAD} of level")
        if not DISTANCE_LEAST <= self.distance <= DISTANCE_MOST:
            raise ValueError(f"distance must be {DISTANCE_LEAST} to {DISTANCE_MOST}")


def orbit_view(T_world_cam: Array, centre: Array, turn: float) -> OrbitView:
    """Return the view ``turn`` (0 to 1) of the way round ``centre``.

    Args:
        T_world_cam: Training cameras ``(n, 4, 4)``; the orbit has their median distance and height.
        centre: Middle of the object ``(3,)``, world metres.
        turn: Share of the circle; 0 is at the first camera's azimuth.
    """
    offsets = T_world_cam[:, :3, 3] - centre
    across = max(float(np.median(np.linalg.norm(offsets[:, :2], axis=1))), 1e-3)
    height = float(np.median(offsets[:, 2]))
    azimuth_rad = float(np.arctan2(offsets[0, 1], offsets[0, 0])) + 2.0 * np.pi * turn
    distance = float(np.hypot(across, height)) / _median_distance(T_world_cam, centre)
    return OrbitView(
        azimuth_rad,
        float(np.clip(np.arctan2(height, across), -ELEVATION_MAX_RAD, ELEVATION_MAX_RAD)),
        float(np.clip(distance, DISTANCE_LEAST, DISTANCE_MOST)),
    )


def view_pose(T_world_cam: Array, centre: Array, view: OrbitView) -> Array:
    """Return the pose ``(4, 4)`` of ``view`` about ``centre`` ``(3,)``, looking at it."""
    level, up = np.cos(view.elevation_rad), np.sin(view.elevation_rad)
    towards = [level * np.cos(view.azimuth_rad), level * np.sin(view.azimuth_rad), up]
    distance = view.distance * _median_distance(T_world_cam, centre)
    return look_at(centre + distance * np.array(towards), centre)


def orbit_pose(T_world_cam: Array, centre: Array, turn: float) -> Array:
    """Return the pose of ``orbit_view``."""
    return view_pose(T_world_cam, centre, orbit_view(T_world_cam, centre, turn))


def _median_distance(T_world_cam: Array, centre: Array) -> float:
    distances = np.linalg.norm(T_world_cam[:, :3, 3] - centre, axis=1)
    return max(float(np.median(distances)), 1e-3)
