"""Where the object should be in a picture, by the drone's pose and the object's estimate."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose, SeedGeometry
from server.vision.ground import ground_seen
from server.vision.prior import RegionPrior
from server.vision.target import TargetEstimate

# A box's centroid differs from the projection of the object's centre by this share of its size.
_CENTROID_SHARE = 0.15
_SMALLEST_SIGMA_PX = 20.0
# Standard deviations that an object's height hardly exceeds its estimate by.
_SURELY = 1.6
_PARTLY_BEHIND_M = 0.1
_NEAREST_M, _FAR_OUTSIDE_PX = 0.2, -1e5
# Half the extent of an object of unknown size, and how far beyond it the floor is surely free.
_UNKNOWN_EXTENT_M = 0.4
_CLEAR_M = 1.5


def expected_region(
    pose: CameraPose,
    target: TargetEstimate,
    intrinsics: Intrinsics,
    seed: SeedGeometry | None = None,
) -> RegionPrior:
    """Return the prior for the region search.

    An object beside or behind the camera is expected far outside of the picture.

    Args:
        pose: The drone's believed pose.
        target: What is known of the object.
        intrinsics: The drone's camera.
        seed: The seed geometry, once there is one: it gives the expected size.
    """
    centre = target.centre if seed is None else seed.outer.centre
    pixels, depths = intrinsics.project(centre[None], pose.T_world_cam)
    depth_m = float(depths[0])
    if depth_m < _NEAREST_M:
        return RegionPrior(np.array([_FAR_OUTSIDE_PX, 0.0]), _SMALLEST_SIGMA_PX)
    slices = None if seed is None else _seen_slices(seed, pose.T_world_cam, intrinsics)
    size = None if slices is None else np.ptp(slices.reshape(-1, 2), axis=0)
    yaw_sigma = float(np.sqrt(pose.covariance[3, 3]))
    spread_m = np.hypot(pose.position_sigma_m, target.sigma_m)
    sigma = intrinsics.fx * np.hypot(spread_m / depth_m, yaw_sigma)
    if size is not None:
        sigma = np.hypot(sigma, _CENTROID_SHARE * float(size.max()))
    distance_m = float(np.hypot(*(centre - pose.position_world)[:2]))
    extent_m = _UNKNOWN_EXTENT_M if seed is None else 0.5 * float(np.hypot(*seed.outer.size[:2]))
    ground = ground_seen(pose, distance_m, extent_m + 2.0 * spread_m, _CLEAR_M, intrinsics)
    if seed is None:
        highest = _highest_row(pose, target, intrinsics)
        return RegionPrior(
            pixels[0], max(float(sigma), _SMALLEST_SIGMA_PX), None, ground, (), highest
        )
    outlines = () if slices is None else _outlines(slices)
    return RegionPrior(pixels[0], max(float(sigma), _SMALLEST_SIGMA_PX), size, ground, outlines)


def _highest_row(pose: CameraPose, target: TargetEstimate, intrinsics: Intrinsics) -> float | None:
    """Return the row that an object of the estimated height hardly exceeds, None when unknown."""
    sigma_m = float(np.sqrt(target.covariance[2, 2]))
    stretch = float(np.exp(_SURELY * np.sqrt(target.covariance[3, 3])))
    up_m = 0.5 * target.height_m * stretch + _SURELY * sigma_m
    top = target.centre + np.array([0.0, 0.0, up_m])
    pixels, depths = intrinsics.project(top[None], pose.T_world_cam)
    return float(pixels[0, 1]) if depths[0] > _NEAREST_M else None


def _seen_slices(
    seed: SeedGeometry, T_world_cam: NDArray[np.float64], intrinsics: Intrinsics
) -> NDArray[np.float64] | None:
    """Return the pixels of the slices' corners ``(n, 8, 2)``, None when one is partly behind."""
    corners = np.concatenate([box.corners for box in seed.boxes])
    pixels, depths = intrinsics.project(corners, T_world_cam)
    return None if (depths < _PARTLY_BEHIND_M).any() else pixels.reshape(-1, 8, 2)


def _outlines(slices: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the convex outline of each slice."""
    hulls = (cv2.convexHull(pixels.astype(np.float32)) for pixels in slices)
    return tuple(hull[:, 0].astype(np.float64) for hull in hulls)
