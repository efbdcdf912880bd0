"""How squarely a drone faces the object (equation 4), and the yaw error that follows from it.

Symbols as in the paper: C is the camera's centre, C_box the centroid of the box, n_box the normal
of the box at its centroid. The box is upright and parallel to the picture, so seen from the
levelled drone its normal points back along the drone's heading: O = 1 when the centroid lies
straight ahead, and O = cos(yaw error) otherwise. Equation 4 alone has no sign; the side of the
centroid gives it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import R_BODY_LEVEL_CAM
from server.geometry.cameras import Intrinsics
from server.stages import Box

Array = NDArray[np.float64]


def orientation(camera_centre: Array, box_centroid: Array, box_normal: Array) -> float:
    """Return O(C, C_box) = unit(C - C_box) . n_box, equation 4.

    Args:
        camera_centre: C ``(3,)``, metres, any frame.
        box_centroid: C_box ``(3,)`` in the same frame.
        box_normal: n_box ``(3,)``; only its direction counts.

    Raises:
        ValueError: If the two points coincide or the normal has no length.
    """
    towards_camera = np.asarray(camera_centre, float) - np.asarray(box_centroid, float)
    length, normal_length = np.linalg.norm(towards_camera), np.linalg.norm(box_normal)
    if length < 1e-9 or normal_length < 1e-9:
        raise ValueError("orientation needs two distinct points and a normal of some length")
    return float(towards_camera @ box_normal / (length * normal_length))


def centroid_direction_body(box: Box, intrinsics: Intrinsics, tilt_rad: float) -> Array:
    """Return the unit direction ``(3,)`` of the box's centroid in levelled body FLU axes."""
    direction_cam = intrinsics.directions(box.centroid_px[None])[0]
    # The camera looks down by a positive turn about the body's left axis.
    c, s = math.cos(tilt_rad), math.sin(tilt_rad)
    tilt = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return tilt @ R_BODY_LEVEL_CAM @ direction_cam


def yaw_error(box: Box, intrinsics: Intrinsics, tilt_rad: float) -> float:
    """Return how far the drone must turn, counter-clockwise positive, to face the box, radians.

    The vertical part of the direction is dropped: yaw cannot correct it.
    """
    direction = centroid_direction_body(box, intrinsics, tilt_rad)
    level = np.array([direction[0], direction[1], 0.0])
    facing = np.clip(orientation(np.zeros(3), level, np.array([-1.0, 0.0, 0.0])), -1.0, 1.0)
    return float(np.copysign(np.arccos(facing), direction[1]))
