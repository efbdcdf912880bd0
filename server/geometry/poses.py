"""Rigid and similarity transforms, and the pose of a drone's camera.

Symbols: ``T_parent_child`` is ``(4, 4)``, ``R_parent_child`` ``(3, 3)``; quaternions are ``wxyz``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.axes import R_BODY_LEVEL_CAM, rotation_zyx

Array = NDArray[np.float64]


def transform_from(R: Array, t: Array) -> Array:
    """Return the ``(4, 4)`` transform of rotation ``R`` ``(3, 3)`` and translation ``t``."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def inverse(T: Array) -> Array:
    """Return the inverse of rigid transforms ``(..., 4, 4)``."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    out = np.zeros_like(T)
    out[..., :3, :3] = R_t
    out[..., :3, 3] = -(R_t @ T[..., :3, 3:])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def transform_points(T: Array, points: Array) -> Array:
    """Carry ``points`` ``(n, 3)`` through ``T`` ``(4, 4)``."""
    return points @ T[:3, :3].T + T[:3, 3]


def wxyz_from_rotation(R: Array) -> Array:
    """Return the unit quaternion ``(4,)``, scalar first, of ``R`` ``(3, 3)``."""
    return Rotation.from_matrix(R).as_quat(scalar_first=True)


def camera_pose(position_world: Array, yaw_rad: float, tilt_rad: float) -> Array:
    """Return ``T_world_cam`` of a camera at ``position_world`` ``(3,)`` metres.

    Args:
        position_world: Camera centre, world metres.
        yaw_rad: Heading of the drone, counter-clockwise about +Z.
        tilt_rad: How far the camera looks below the horizon (positive is down).
    """
    # A turn about the body's left axis (+y) pitches the nose down when positive.
    R_world_body = rotation_zyx(yaw_rad, tilt_rad, 0.0)
    return transform_from(R_world_body @ R_BODY_LEVEL_CAM, position_world)


def yaw_of_camera(T_world_cam: Array) -> float:
    """Return the heading in radians of a camera pose ``(4, 4)`` that does not look down."""
    forward = T_world_cam[:3, 2]
    return float(np.arctan2(forward[1], forward[0]))


def look_at(position_world: Array, target_world: Array) -> Array:
    """Return the ``T_world_cam`` at ``position_world`` that looks at ``target_world``, level.

    Raises:
        ValueError: If the two points coincide or the view is straight up or down.
    """
    forward = np.asarray(target_world, float) - np.asarray(position_world, float)
    length = np.linalg.norm(forward)
    if length < 1e-9:
        raise ValueError("look_at: position and target coincide")
    forward = forward / length
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        raise ValueError("look_at: the view is straight up or down, its roll is undefined")
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return transform_from(
        np.stack([right, down, forward], axis=1), np.asarray(position_world, float)
    )


@dataclass(frozen=True, slots=True)
class Similarity:
    """``y = scale * R x + t``: carries points of one frame into another of other scale.

    Attributes:
        scale: Positive factor.
        R: Rotation ``(3, 3)``.
        t: Translation ``(3,)`` in the target frame.
    """

    scale: float
    R: Array
    t: Array

    def points(self, points: Array) -> Array:
        """Carry ``points`` ``(n, 3)``."""
        return self.scale * points @ self.R.T + self.t

    def poses(self, T_world_cam: Array) -> Array:
        """Carry camera-to-world poses ``(n, 4, 4)``; their rotations stay orthonormal."""
        out = np.array(T_world_cam, float)
        out[:, :3, :3] = self.R @ out[:, :3, :3]
        out[:, :3, 3] = self.points(out[:, :3, 3])
        return out


def fit_similarity(source: Array, target: Array) -> Similarity:
    """Return the least-squares similarity from ``source`` to ``target``, both ``(n, 3)``, n >= 3.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    PAMI 1991.

    Raises:
        ValueError: With fewer than three points, or when all source points coincide.
    """
    if len(source) < 3:
        raise ValueError("fit_similarity needs at least three points")
    mean_s, mean_t = source.mean(0), target.mean(0)
    s, t = source - mean_s, target - mean_t
    variance = float((s**2).sum() / len(source))
    if variance < 1e-18:
        raise ValueError("fit_similarity: the source points coincide")
    U, D, Vt = np.linalg.svd(t.T @ s / len(source))
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = U @ S @ Vt
    scale = float((D * np.diag(S)).sum() / variance)
    return Similarity(scale, R, mean_t - scale * R @ mean_s)
