"""Configuration of the pose refinement that follows a capture."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PoseConfig:
    """How camera poses are recovered from the pictures and carried into the world frame.

    Attributes:
        seed: Seed of every random choice (RANSAC, mapper).
        threads: Threads the native code may use. With one, a run repeats exactly; with more, the
            sums of the bundle adjustment are formed in varying order.
        max_image_size_px: Pictures are reduced to this longer side before features are sought.
        max_features: Features kept per picture, the largest scales first.
        first_octave: Octave of the finest features: -1 doubles the picture first (slower, more
            features on weak texture), 0 starts at its own size.
        peak_threshold: Smallest difference-of-Gaussians response of a feature, grey levels / 255.
        time_neighbours: Each picture is matched with so many later ones of the same drone.
        max_view_angle_rad: Pictures whose believed viewing directions differ by more are not
            matched: SIFT does not bridge wider angles.
        pairs_per_drone: Each picture is matched with so many pictures of every drone, those with
            the most similar believed viewing direction.
        max_match_ratio: Largest distance ratio of best to second-best descriptor.
        max_epipolar_error_px: Largest error of a verified match, pixels.
        min_pair_matches: Fewest verified matches of a pair that is used.
        min_resection_matches: Fewest verified 2D-3D matches that register a picture.
        min_triangulation_angle_rad: Rays that meet at a smaller angle make no point.
        max_reprojection_error_px: Observations with a larger error are removed.
        min_model_pictures: A connected reconstruction with fewer pictures is dropped.
        drone_offset_sigma_m: Standard deviation of the error that all believed positions of one
            drone have in common (how exactly it was set down), metres per axis.
        drone_yaw_sigma_rad: The same for its heading, radians.
        picture_sigma_floor_m: Believed positions are never trusted better than this, metres.
        yaw_sigma_floor_rad: Believed headings are never trusted better than this, radians.
        tilt_sigma_rad: Standard deviation of the believed pitch and roll, radians. It is what
            keeps the world's Z axis upright.

    Raises:
        ValueError: If a field is out of range; the message names it.
    """

    seed: int = 0
    threads: int = 2
    max_image_size_px: int = 640
    max_features: int = 1000
    first_octave: int = 0
    peak_threshold: float = 0.003
    time_neighbours: int = 3
    max_view_angle_rad: float = math.radians(50.0)
    pairs_per_drone: int = 3
    max_match_ratio: float = 0.8
    max_epipolar_error_px: float = 3.0
    min_pair_matches: int = 15
    min_resection_matches: int = 15
    min_triangulation_angle_rad: float = math.radians(1.5)
    max_reprojection_error_px: float = 3.0
    min_model_pictures: int = 3
    drone_offset_sigma_m: float = 0.2
    drone_yaw_sigma_rad: float = math.radians(8.0)
    picture_sigma_floor_m: float = 0.03
    yaw_sigma_floor_rad: float = math.radians(1.0)
    tilt_sigma_rad: float = math.radians(2.0)

    def __post_init__(self) -> None:
        at_least = {
            "seed": 0,
            "threads": 1,
            "max_image_size_px": 64,
            "max_features": 16,
            "first_octave": -1,
            "time_neighbours": 0,
            "pairs_per_drone": 0,
            "min_pair_matches": 8,
            "min_resection_matches": 6,
            "min_model_pictures": 3,
        }
        for name, least in at_least.items():
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}, is {getattr(self, name)}")
        positive = (
            "peak_threshold",
            "max_view_angle_rad",
            "max_match_ratio",
            "max_epipolar_error_px",
            "min_triangulation_angle_rad",
            "max_reprojection_error_px",
            "drone_offset_sigma_m",
            "drone_yaw_sigma_rad",
            "picture_sigma_floor_m",
            "yaw_sigma_floor_rad",
            "tilt_sigma_rad",
        )
        for name in positive:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, is {value}")
        if self.max_match_ratio > 1.0:
            raise ValueError(f"max_match_ratio must not exceed 1, is {self.max_match_ratio}")
