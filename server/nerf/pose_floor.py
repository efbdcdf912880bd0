"""The floor, found in the points of a reconstruction, puts it upright and at its height.

Beliefs of the flight carry a reconstruction into the world to a few centimetres and tenths of a
degree. The floor is seen by all drones, mostly in hundreds of points, and is known: z = 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.poses import Similarity

Array = NDArray[np.float64]

# The beliefs miss the floor by no more than this, metres and degrees.
_FARTHEST_M, _STEEPEST_DEG = 0.3, 5.0
# Points of the floor are so near to one plane; the plane needs so many, and such a share of those
# that may be floor.
_THICKNESS_M, _LEAST_POINTS, _LEAST_SHARE = 0.01, 60, 0.25
# What has a layer below it, of this share of its own points, is a table. Single points are often
# wrong and lie anywhere.
_LEAST_BELOW_M, _LAYER_M, _LAYER_SHARE = 0.03, 0.02, 0.1
_TRIES = 500


def on_the_floor(similarity: Similarity, points_model: Array, seed: int = 0) -> Similarity | None:
    """Return ``similarity`` corrected so that the floor among the points lies at z = 0, level.

    None comes back where no floor is found.

    Args:
        similarity: From the model's frame into the world, to a few centimetres.
        points_model: ``(m, 3)`` in the model's frame.
        seed: Of the choice of triples.
    """
    points = similarity.points(points_model)
    near = points[np.abs(points[:, 2]) < _FARTHEST_M]
    plane = _floor_plane(near, np.random.default_rng(seed))
    if plane is None:
        return None
    normal, middle = plane
    axis = np.cross(normal, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    turn = np.zeros(3) if sine < 1e-12 else axis / sine * np.arcsin(min(sine, 1.0))
    R = Rotation.from_rotvec(turn).as_matrix()
    # Turned about the floor's middle, so that nothing moves far.
    t = middle - R @ middle - [0.0, 0.0, middle[2]]
    return Similarity(similarity.scale, R @ similarity.R, R @ similarity.t + t)


def _floor_plane(points: Array, rng: np.random.Generator) -> tuple[Array, Array] | None:
    """Return upward normal ``(3,)`` and middle ``(3,)`` of the floor, None when there is none."""
    if len(points) < _LEAST_POINTS:
        return None
    best = np.zeros(len(points), bool)
    for _ in range(_TRIES):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = _upward(np.cross(b - a, c - a))
        if normal is not None:
            on_it = np.abs((points - a) @ normal) < _THICKNESS_M
            best = on_it if on_it.sum() > best.sum() else best
    if best.sum() < max(_LEAST_POINTS, _LEAST_SHARE * len(points)):
        return None
    middle = points[best].mean(axis=0)
    _, _, axes = np.linalg.svd(points[best] - middle, full_matrices=False)
    normal = _upward(axes[2])
    if normal is None:
        return None
    heights = (points - middle) @ normal
    layers = np.floor(heights[heights < -_LEAST_BELOW_M] / _LAYER_M).astype(np.int64)
    thickest = int(np.unique(layers, return_counts=True)[1].max(initial=0))
    return None if thickest > _LAYER_SHARE * best.sum() else (normal, middle)


def _upward(normal: Array) -> Array | None:
    """Return the unit normal that points up, None when it is steep or no direction."""
    length = float(np.linalg.norm(normal))
    if length < 1e-9:
        return None
    unit = normal / length * np.sign(normal[2])
    return unit if unit[2] > np.cos(np.deg2rad(_STEEPEST_DEG)) else None
