"""Who sees what, how sharply, and how surely: the table all planning works on.

Symbols: D candidates (rows), S surface samples (columns).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import camera_pose, inverse
from server.planner.config import FitnessConfig
from server.planner.surfaces import SurfaceSamples, segments_blocked
from server.stages import Viewpoint

Array = NDArray[np.float64]

# Sight lines end this far in front of a sample, so that its own face does not block it.
OFF_SURFACE_M = 1e-4
# Of normals that are spread evenly over the half-space towards the camera.
_MEAN_COSINE = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityTable:
    """What every candidate sees of every sample.

    Attributes:
        visible: bool ``(D, S)``: in the picture, not hidden, not too oblique.
        detail_px_per_m2: ``(D, S)`` pixels per square metre of surface, 0 where not visible.
        agreement: ``(D, S)`` Algorithm 1's F' in [0, 1], 0 where not visible.
    """

    visible: NDArray[np.bool_]
    detail_px_per_m2: Array
    agreement: Array


class _Pairs(NamedTuple):
    """Pairs of candidate and sample, all ``(n,)``."""

    row: NDArray[np.intp]
    column: NDArray[np.intp]
    cosine: Array
    distance: Array

    def where(self, keep: NDArray[np.bool_]) -> _Pairs:
        """Return the pairs that ``keep`` ``(n,)`` marks."""
        return _Pairs(self.row[keep], self.column[keep], self.cosine[keep], self.distance[keep])


def pose_deviations(config: FitnessConfig) -> Array:
    """Return eight equally likely deviations ``(8, 4)`` in x, y, z (m) and yaw (rad).

    They have the configured variances and no mean (third-degree cubature: the square root of the
    dimension, 2, times each standard deviation, both ways).
    """
    sigma = np.array([*[config.position_sigma_m] * 3, config.yaw_sigma_rad])
    return np.concatenate([np.diag(2.0 * sigma), -np.diag(2.0 * sigma)])


def visibility_table(
    candidates: Sequence[Viewpoint],
    samples: SurfaceSamples,
    boxes: Sequence[Box3],
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: FitnessConfig,
) -> VisibilityTable:
    """Cast a ray from every candidate to every sample and note what it meets.

    Args:
        candidates: D poses.
        samples: S surface samples.
        boxes: What hides samples, normally the seed boxes themselves.
        intrinsics: Camera.
        tilt_rad: How far the camera looks down.
        config: Scales of incidence and agreement.
    """
    positions = np.array([v.position_world for v in candidates])
    yaws = np.array([v.yaw_rad for v in candidates])
    T_cam_world = inverse(_camera_poses(positions, yaws, tilt_rad))
    pairs = _facing_pairs(positions, samples, config)
    pixels = _project_pairs(T_cam_world[pairs.row], samples.points[pairs.column], intrinsics)
    pairs = pairs.where(intrinsics.contains(pixels))
    ends = samples.points[pairs.column] + OFF_SURFACE_M * samples.normals[pairs.column]
    pairs = pairs.where(~segments_blocked(positions[pairs.row], ends, boxes))

    shape = (len(candidates), len(samples))
    visible = np.zeros(shape, bool)
    detail, agreement = np.zeros(shape), np.zeros(shape)
    cells = (pairs.row, pairs.column)
    visible[cells] = True
    cosine = (1.0 - config.normal_doubt) * pairs.cosine + config.normal_doubt * _MEAN_COSINE
    detail[cells] = cosine * intrinsics.fx * intrinsics.fy / pairs.distance**2
    points = samples.points[pairs.column]
    agreement[cells] = _agreement(positions, yaws, pairs.row, points, intrinsics, tilt_rad, config)
    return VisibilityTable(visible, detail, agreement)


def _facing_pairs(positions: Array, samples: SurfaceSamples, config: FitnessConfig) -> _Pairs:
    """Return the pairs of candidate and sample that are not too oblique."""
    # n.(c - p) and |c - p|^2 as products of matrices: no (D, S, 3) array is needed.
    along_normal = positions @ samples.normals.T - (samples.normals * samples.points).sum(axis=1)
    squared = (
        (positions**2).sum(axis=1)[:, None]
        + (samples.points**2).sum(axis=1)
        - 2.0 * positions @ samples.points.T
    )
    distance = np.sqrt(np.maximum(squared, 1e-12))
    cosine = along_normal / distance
    row, column = np.nonzero(cosine > np.cos(config.incidence_max_rad))
    return _Pairs(row, column, cosine[row, column], distance[row, column])


def _camera_poses(positions: Array, yaws: Array, tilt_rad: float) -> Array:
    """Return ``camera_pose`` of ``positions`` ``(n, 3)`` and ``yaws`` ``(n,)`` at once."""
    T = np.zeros((len(yaws), 4, 4))
    cos, sin = np.cos(yaws), np.sin(yaws)
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1], T[:, 2, 2] = cos, -sin, sin, cos, 1.0
    T[:, 3, 3] = 1.0
    T = T @ camera_pose(np.zeros(3), 0.0, tilt_rad)
    T[:, :3, 3] = positions
    return T


def _project_pairs(T_cam_world: Array, points: Array, intrinsics: Intrinsics) -> Array:
    """Project each of ``points`` ``(n, 3)`` with its own ``T_cam_world``; NaN behind the camera."""
    points_cam = np.einsum("nij,nj->ni", T_cam_world[:, :3, :3], points) + T_cam_world[:, :3, 3]
    return intrinsics.pixels_of(points_cam)


def _agreement(
    positions: Array,
    yaws: Array,
    row: NDArray[np.intp],
    points: Array,
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: FitnessConfig,
) -> Array:
    """Return F' ``(n,)``, the mean over the pose deviations, of visible pairs."""
    expected = _project_pairs(
        inverse(_camera_poses(positions, yaws, tilt_rad))[row], points, intrinsics
    )
    total = np.zeros(len(points))
    deviations = pose_deviations(config)
    for deviation in deviations:
        T_deviated = _camera_poses(positions + deviation[:3], yaws + deviation[3], tilt_rad)
        real = _project_pairs(inverse(T_deviated)[row], points, intrinsics)
        in_frame = intrinsics.contains(real)
        squared = ((expected - real) ** 2).sum(axis=1)
        total += np.where(in_frame, np.exp(-squared / (2.0 * config.tau_px**2)), 0.0)
    return total / len(deviations)
