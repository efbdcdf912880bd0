"""Axis conventions and the only conversions between them.

World
    Right-handed, metres, +Z up, origin at the centre of the nominal start circle on the floor,
    +X towards drone 1's nominal azimuth.
Body (FLU)
    x forward, y left, z up. ``yaw_rad`` is the heading: counter-clockwise about world +Z, zero
    when the drone looks along world +X.
Camera (OpenCV)
    x right, y down, z forward. ``T_world_cam`` carries camera points into the world.
OpenGL camera
    x right, y up, looking along -z. It exists only inside ``transforms.json``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Right-multiplied to a camera-to-world pose it flips y and z: half a turn about the camera's x.
_FLIP_YZ = np.diag([1.0, -1.0, -1.0, 1.0])

# Columns are the camera axes (right, down, forward) of an untilted camera, in body axes.
R_BODY_LEVEL_CAM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def opengl_from_opencv(T_world_cam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the OpenGL camera-to-world pose of an OpenCV one, both ``(..., 4, 4)``."""
    return T_world_cam @ _FLIP_YZ


def opencv_from_opengl(T_world_glcam: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the OpenCV camera-to-world pose of an OpenGL one, both ``(..., 4, 4)``."""
    return T_world_glcam @ _FLIP_YZ


def rotation_z(angle_rad: float) -> NDArray[np.float64]:
    """Return the rotation ``(3, 3)`` about +Z, counter-clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_zyx(z_rad: float, y_rad: float, x_rad: float) -> NDArray[np.float64]:
    """Return ``Rz(z) Ry(y) Rx(x)`` ``(3, 3)``."""
    cz, sz = math.cos(z_rad), math.sin(z_rad)
    cy, sy = math.cos(y_rad), math.sin(y_rad)
    cx, sx = math.cos(x_rad), math.sin(x_rad)
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def wrap_angle(angle_rad: float) -> float:
    """Return ``angle_rad`` wrapped into ``[-pi, pi)``."""
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
