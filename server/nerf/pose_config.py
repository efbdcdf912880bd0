"""Configuration of the pose refinement that follows a capture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace


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
        mapping_error_px: Observations with a larger error are removed while pictures are registered
            with lenses as calibrated: a per cent is five pixels at a picture's edge, and what
            would correct the lenses must not be thrown away.
        max_reprojection_error_px: Observations with a larger error in the end are removed.
        adjustments: Most steps of the last bundle adjustment.
        refine_lens: Whether each drone's focal length, and its principal point across, are found
            with the poses.
        min_focal_pictures: Fewest pictures of a drone for that.
        focal_sigma: Standard deviation of the calibrated focal length, as a share.
        principal_sigma_px: Standard deviation of the calibrated principal point, pixels.
        robust_noises: Error beyond which an observation pulls less and less, in standard deviations
            of its picture.
        sigma_factor: Standard deviations of refined poses are this many times what independent
            observations would give: features share their errors.
        max_sigma_m: A position known less well is not called refined, metres per axis.
        max_sigma_rad: A rotation known less well is not called refined, radians per axis.
        thorough_features: Where some still could not be refined, everything is tried again with
            so many features per picture and pictures of ``thorough_image_size_px``; 0 never.
        thorough_image_size_px: Longer side of the pictures in that second try.
        min_model_pictures: A connected reconstruction with fewer pictures is dropped.
        drone_offset_sigma_m: Standard deviation of the error that all believed positions of one
            drone have in common (how exactly it was set down), metres per axis.
        drone_yaw_sigma_rad: The same for its heading, radians.
        picture_sigma_floor_m: Believed positions are never trusted better than this, metres.
        yaw_sigma_floor_rad: Believed headings are never trusted better than this, radians.
        tilt_sigma_rad: Standard deviation of the believed pitch and roll, radians. It is what
            keeps the world's Z axis upright.
        outline_sigma_px: How exactly masks are cut: standard deviation of an object's outline,
            pixels of the whole picture.

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
    mapping_error_px: float = 8.0
    max_reprojection_error_px: float = 3.0
    adjustments: int = 12
    refine_lens: bool = True
    min_focal_pictures: int = 8
    focal_sigma: float = 0.01
    principal_sigma_px: float = 2.0
    robust_noises: float = 2.0
    sigma_factor: float = 5.0
    max_sigma_m: float = 0.05
    max_sigma_rad: float = math.radians(1.5)
    thorough_features: int = 4000
    thorough_image_size_px: int = 2000
    min_model_pictures: int = 3
    drone_offset_sigma_m: float = 0.2
    drone_yaw_sigma_rad: float = math.radians(8.0)
    picture_sigma_floor_m: float = 0.03
    yaw_sigma_floor_rad: float = math.radians(1.0)
    tilt_sigma_rad: float = math.radians(2.0)
    outline_sigma_px: float = 8.0

    def thorough(self) -> PoseConfig:
        """Return the settings of the second try."""
        return replace(
            self,
            max_image_size_px=self.thorough_image_size_px,
            max_features=max(self.thorough_features, self.max_features),
            max_view_angle_rad=1.4 * self.max_view_angle_rad,
            pairs_per_drone=2 * self.pairs_per_drone,
        )

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
            "thorough_features": 0,
            "thorough_image_size_px": 64,
            "adjustments": 0,
            "min_focal_pictures": 3,
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
            "mapping_error_px",
            "max_reprojection_error_px",
            "focal_sigma",
            "principal_sigma_px",
            "robust_noises",
            "max_sigma_m",
            "max_sigma_rad",
            "sigma_factor",
            "drone_offset_sigma_m",
            "drone_yaw_sigma_rad",
            "picture_sigma_floor_m",
            "yaw_sigma_floor_rad",
            "tilt_sigma_rad",
            "outline_sigma_px",
        )
        for name in positive:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, is {value}")
        if self.max_match_ratio > 1.0:
            raise ValueError(f"max_match_ratio must not exceed 1, is {self.max_match_ratio}")
