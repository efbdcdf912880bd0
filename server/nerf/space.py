"""The scene cube: an unbounded room folded into a cube with the object in the middle.

Symbols: ``x`` is a point in scene units, ``x = (p_world - centre) / half_size``; the object's cube
is ``|x| <= 1``, ``|.|`` being the largest coordinate. The encoding sees ``u`` in ``[0, 1]^3``.

The contraction is that of mip-NeRF 360 (Barron et al. 2022, equation 10) in the largest-coordinate
norm, so that the folded space is a cube: ``c(x) = x`` inside and ``(2 - 1/|x|) x/|x|`` outside,
``u = (c + 2) / 4``. Half of every axis belongs to the object.

Density is counted per *path unit*: a ray advancing by ``dt`` scene units at ``x`` advances by
``ds = dt / max(1, |x|)``. A step of constant ``ds`` is fine at the object and coarse far away, and
one density threshold means the same everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.nerf.dataset import Dataset

Array = NDArray[np.float64]

# The object's box is given some air, so that its surface is well inside the fine half.
_BOX_MARGIN = 1.15
# Share of the visible half width at the focus that is taken as the object, when no box is known.
_FOCUS_SHARE = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class SceneSpace:
    """Where the object's cube lies in the world.

    Attributes:
        centre: Middle of the cube ``(3,)``, world metres.
        half_size: Half of the cube's edge, metres.
    """

    centre: Array
    half_size: float

    def to_scene(self, points_world: Array) -> Array:
        """Carry world points ``(..., 3)`` in metres to scene units."""
        return (np.asarray(points_world, float) - self.centre) / self.half_size

    def to_world(self, points: Array) -> Array:
        """Carry points ``(..., 3)`` in scene units to world metres."""
        return np.asarray(points, float) * self.half_size + self.centre


def contract(points: Array) -> Array:
    """Fold ``points`` ``(n, 3)`` in scene units into ``u`` in ``[0, 1]^3``."""
    norm = np.maximum(np.abs(points).max(axis=1, keepdims=True), 1.0)
    return ((2.0 - 1.0 / norm) * points / norm + 2.0) / 4.0


def expand(u: Array) -> Array:
    """Undo ``contract``: ``u`` ``(n, 3)`` in ``(0, 1)^3`` to scene units."""
    folded = np.asarray(u, float) * 4.0 - 2.0
    norm = np.abs(folded).max(axis=1, keepdims=True)
    outside = np.maximum(norm, 1.0)
    return folded / (outside * np.maximum(2.0 - outside, 1e-6))


def focus_point(T_world_cam: Array) -> Array:
    """Return the point ``(3,)`` nearest to all optical axes of ``T_world_cam`` ``(n, 4, 4)``.

    Cameras that look the same way have no such point; then it is a point in front of their middle,
    three times as far away as they are spread (one metre for coinciding cameras).
    """
    origins, forward = T_world_cam[:, :3, 3], T_world_cam[:, :3, 2]
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    normal = across.sum(axis=0)
    if np.linalg.cond(normal) < 1e4:
        point = np.linalg.solve(normal, (across @ origins[:, :, None]).sum(axis=0)[:, 0])
        if (((point - origins) * forward).sum(axis=1) > 0.0).mean() > 0.5:
            return point
    middle = origins.mean(axis=0)
    spread = float(np.linalg.norm(origins - middle, axis=1).max())
    ahead = forward.mean(axis=0)
    return middle + ahead * (3.0 * spread if spread > 0.0 else 1.0)


def scene_space(dataset: Dataset) -> SceneSpace:
    """Return the scene space of ``dataset``: around its object box, else around its focus."""
    box = dataset.object_box
    if box is not None:
        return SceneSpace(box.centre, max(float(box.size.max()) / 2.0 * _BOX_MARGIN, 1e-3))
    centre = focus_point(dataset.T_world_cam)
    distance = float(np.median(np.linalg.norm(dataset.T_world_cam[:, :3, 3] - centre, axis=1)))
    camera = dataset.intrinsics[0]
    half_view = max(camera.width / camera.fx, camera.height / camera.fy) / 2.0
    return SceneSpace(centre, max(distance * half_view * _FOCUS_SHARE, 1e-3))
