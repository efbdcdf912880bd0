"""What the 3D scene shows and how often."""

from __future__ import annotations

import math
from dataclasses import dataclass

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD, Intrinsics


@dataclass(frozen=True, slots=True)
class SceneConfig:
    """Sizes and rates of the 3D scene.

    Attributes:
        start_radius_m: Radius of the nominal start circle, drawn on the floor.
        floor_m: Edge of the floor grid.
        thumbnail_hz: Most live thumbnails per second and drone.
        trail_hz: Most trail updates per second and drone.
        trail_points: Longest trail.
        trail_step_m: A trail grows by steps of this length.
        drone_frustum_m: Size of a drone's camera frustum.
        small_frustum_m: Size of the frusta of planned viewpoints and captured pictures.
        candidate_m: Diameter of the points that stand for candidates left over.
        preview_frustum_m: Size of the preview's frustum.
        planned_intrinsics: Camera of planned viewpoints.
        planned_tilt_rad: How far the camera of planned viewpoints looks below the horizon.

    Raises:
        ValueError: If a value is out of its range.
    """

    start_radius_m: float = 2.0
    floor_m: float = 10.0
    thumbnail_hz: float = 5.0
    trail_hz: float = 2.0
    trail_points: int = 400
    trail_step_m: float = 0.03
    drone_frustum_m: float = 0.25
    small_frustum_m: float = 0.12
    candidate_m: float = 0.022
    preview_frustum_m: float = 0.4
    planned_intrinsics: Intrinsics = TELLO_INTRINSICS
    planned_tilt_rad: float = TELLO_TILT_RAD

    def __post_init__(self) -> None:
        for name in (
            "start_radius_m",
            "floor_m",
            "thumbnail_hz",
            "trail_hz",
            "trail_step_m",
            "drone_frustum_m",
            "small_frustum_m",
            "candidate_m",
            "preview_frustum_m",
        ):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value}")
        if self.trail_points < 2:
            raise ValueError(f"trail_points must be at least 2, got {self.trail_points}")
        if not abs(self.planned_tilt_rad) < math.pi / 2:
            raise ValueError(
                f"planned_tilt_rad must be below a right angle, got {self.planned_tilt_rad}"
            )
