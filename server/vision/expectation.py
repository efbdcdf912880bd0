"""Where the object should be in a picture, by the drone's pose and the object's estimate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose, SeedGeometry
from server.vision.ground import ground_seen
from server.vision.localization import TargetEstimate
from server.vision.region import RegionPrior

# A box's centroid differs from the projection of the object's centre by this share of its size.
_CENTROID_SHARE = 0.15
_SMALLEST_SIGMA_PX = 20.0
# Half the extent of an object of unknown size, and how far beyond it the floor is surely free.
_UNKNOWN_EXTENT_M = 0.4
_CLEAR_M = 1.5


def expected_region(
    pose: CameraPose,
    target: TargetEstimate,
    intrinsics: Intrinsics,
    seed: SeedGeometry | None = None,
) -> RegionPrior | None:
    """Return the prior for the region search, or None when the object is behind the camera.

    Args:
        pose: The drone's believed pose.
        target: What is known of the object.
        intrinsics: The drone's camera.
        seed: The seed geometry, once there is one: it gives the expected size.
    """
    centre = target.centre if seed is None else seed.outer.centre
    pixels, depths = intrinsics.project(centre[None], pose.T_world_cam)
    depth_m = float(depths[0])
    if depth_m < 0.2:
        return None
    size = None if seed is None else _expected_size(seed, pose.T_world_cam, intrinsics)
    yaw_sigma = float(np.sqrt(pose.covariance[3, 3]))
    spread_m = np.hypot(pose.position_sigma_m, target.sigma_m)
    sigma = intrinsics.fx * np.hypot(spread_m / depth_m, yaw_sigma)
    if size is not None:
        sigma = np.hypot(sigma, _CENTROID_SHARE * float(size.max()))
    distance_m = float(np.hypot(*(centre - pose.position_world)[:2]))
    extent_m = _UNKNOWN_EXTENT_M if seed is None else 0.5 * float(np.hypot(*seed.outer.size[:2]))
    ground = ground_seen(pose, distance_m, extent_m + 2.0 * spread_m, _CLEAR_M, intrinsics)
    return RegionPrior(pixels[0], max(float(sigma), _SMALLEST_SIGMA_PX), size, ground)


def _expected_size(
    seed: SeedGeometry, T_world_cam: NDArray[np.float64], intrinsics: Intrinsics
) -> NDArray[np.float64] | None:
    """Return width and height ``(2,)`` of the slices' projection, None when partly behind."""
    corners = np.concatenate([box.corners for box in seed.boxes])
    pixels, depths = intrinsics.project(corners, T_world_cam)
    if (depths < 0.1).any():
        return None
    return pixels.max(axis=0) - pixels.min(axis=0)
