"""What views truly see of an object: rays cast at its mesh.

Symbols: ``n`` views (rows), ``s`` surface samples of equal area (columns). A sample has no outer
side, because the meshes' windings are not to be relied upon: a ray meets whichever side it comes
to, and on a closed body the inner side is hidden by the body itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD, Intrinsics
from server.sim.meshes import ObjectModel
from server.stages import Viewpoint

Array = NDArray[np.float64]

INCIDENCE_MAX_RAD = np.deg2rad(75.0)
DETAIL_PX_PER_M2 = 2e4
# Rays start this far off the surface; thinner than any part of an object that is to be modelled.
_OFF_SURFACE_M = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """What each of n views sees.

    Attributes:
        visible: bool ``(n, s)``: in the picture, not hidden, incidence under 75 degrees.
        detail_px_per_m2: ``(n, s)`` d = cos(incidence) (f / distance)^2, 0 where not visible.
    """

    visible: NDArray[np.bool_]
    detail_px_per_m2: Array

    def visibility(self, chosen: Sequence[int] | NDArray[np.intp], views: int = 1) -> float:
        """Return the share of the area that at least ``views`` of the chosen views see."""
        return float((self.visible[chosen].sum(axis=0) >= views).mean())

    def detail(self, chosen: Sequence[int] | NDArray[np.intp]) -> float:
        """Return the area mean of log(1 + max over the chosen views of d / 2e4)."""
        best = self.detail_px_per_m2[chosen].max(axis=0)
        return float(np.log1p(best / DETAIL_PX_PER_M2).mean())

    def overlap(self, chosen: Sequence[int] | NDArray[np.intp]) -> float:
        """Return the mean over neighbouring views of the Jaccard index of what they see.

        The neighbour of a view is the other one that shares most with it.
        """
        seen = self.visible[chosen].astype(float)
        both = seen @ seen.T
        each = np.diag(both)
        either = np.maximum(each[:, None] + each[None, :] - both, 1e-9)
        shares = both / either
        np.fill_diagonal(shares, 0.0)
        return float(shares.max(axis=1).mean())


class Judge:
    """The true surface of one object."""

    def __init__(self, model: ObjectModel, samples: int, seed: int) -> None:
        self._mesh = model.trimesh
        points, faces = trimesh.sample.sample_surface(self._mesh, samples, seed=seed)[:2]
        self.points_world: Array = np.asarray(points, float)
        self.normals_world: Array = np.asarray(self._mesh.face_normals, float)[np.asarray(faces)]
        self.area_m2 = float(self._mesh.area)

    def look(self, views: Sequence[Viewpoint]) -> Sights:
        """Return what ``views`` see."""
        poses = [view.T_world_cam(TELLO_TILT_RAD) for view in views]
        return self.look_from(poses, [TELLO_INTRINSICS] * len(poses))

    def look_from(self, T_world_cam: Sequence[Array], lenses: Sequence[Intrinsics]) -> Sights:
        """Return what cameras see, by pose ``(4, 4)`` and lens."""
        visible = np.zeros((len(T_world_cam), len(self.points_world)), bool)
        detail = np.zeros(visible.shape)
        for row, (pose, lens) in enumerate(zip(T_world_cam, lenses, strict=True)):
            column, px_per_m2 = self._seen_from(pose, lens)
            visible[row, column] = True
            detail[row, column] = px_per_m2
        return Sights(visible, detail)

    def _seen_from(self, T_world_cam: Array, lens: Intrinsics) -> tuple[NDArray[np.intp], Array]:
        """Return the samples that a camera sees and how sharply."""
        towards = T_world_cam[:3, 3] - self.points_world
        distance = np.linalg.norm(towards, axis=1)
        towards /= distance[:, None]
        cosine = np.abs((towards * self.normals_world).sum(axis=1))
        pixels, depths = lens.project(self.points_world, T_world_cam)
        facing = (cosine > np.cos(INCIDENCE_MAX_RAD)) & (depths > 0.05)
        facing &= lens.contains(pixels)
        column = np.flatnonzero(facing)
        # A camera stands outside the object's bounding box, so nothing lies beyond it on the ray.
        hidden = self._mesh.ray.intersects_any(
            self.points_world[column] + _OFF_SURFACE_M * towards[column], towards[column]
        )
        column = column[~np.asarray(hidden, bool)]
        focal_px2 = lens.fx * lens.fy
        return column, cosine[column] * focal_px2 / distance[column] ** 2
