"""Which part of a field is the object: cells in its box that no masks show beside it.

Floor, table and room have their densities too. What is to show the object alone, its surface or a
film of it, samples only here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from server.geometry.boxes import Box3
from server.geometry.cameras import whole_pixels
from server.nerf.dataset import Dataset
from server.nerf.space import SceneSpace, contract, expand

Array = NDArray[np.float64]

# Air around the box, as a share of its size.
_AIR = 0.05
# What is no higher above the floor, or no higher than a cell, is the floor: its texture is as thick
# as that in a field.
_FLOOR_M = 0.015
# A mask that follows the object loosely must not cut into it: so much of the picture it is grown
# by, and more than this share of the masks that see a place must say that it is beside the object.
_MASK_SLACK = 0.02
_AGREEING_SHARE = 0.4
# Masks are asked at every so many cells: their slack is wider than that.
_MASK_STEP = 2


@dataclass(frozen=True, slots=True, eq=False)
class ObjectPart:
    """Cubic cells in which the object may be.

    Attributes:
        cells: bool ``(nx, ny, nz)``.
        corner: Middle of the first cell ``(3,)``, world metres.
        cell_m: Edge of a cell, metres.
        box: The box they fill, with a layer of empty cells around.
        space: The field's scene space.
        coarse: The same over ``u``, bool ``(m, m, m)``; some that do not touch it are among them.
    """

    cells: NDArray[np.bool_]
    corner: Array
    cell_m: float
    box: Box3
    space: SceneSpace
    coarse: NDArray[np.bool_]

    def points(self) -> Array:
        """Return the middles ``(n, 3)`` of the cells that may hold it, world metres."""
        return self.corner + self.cell_m * np.argwhere(self.cells)

    def holds(self, u: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return which of the folded points ``u`` ``(n, 3)`` lie in these cells."""
        points = self.space.to_world(expand(u.astype(np.float64)))
        index = np.round((points - self.corner) / self.cell_m).astype(np.int64)
        inside = np.all((index >= 0) & (index < self.cells.shape), axis=1)
        x, y, z = np.where(inside[:, None], index, 0).T
        return inside & self.cells[x, y, z]


def object_part(dataset: Dataset, space: SceneSpace, cells: int, coarse: int) -> ObjectPart:
    """Return where the object may be.

    Args:
        dataset: Its box, or the field's own cube where none is known, and its masks, if any.
        space: The field's scene space.
        cells: Cells along the longest side of the box.
        coarse: Cells per axis over ``u``.
    """
    box = _airy_box(dataset, space)
    cell_m = float(box.size.max()) / cells
    corner = box.lower - cell_m
    counts = [math.ceil(size / cell_m) + 3 for size in box.size]
    inner = np.zeros(counts, bool)
    inner[1:-2, 1:-2, 1:-2] = True
    if dataset.floor_z is not None:
        heights = corner[2] + cell_m * np.arange(counts[2])
        inner[:, :, heights < dataset.floor_z + max(_FLOOR_M, cell_m)] = False
    axes = [c + cell_m * np.arange(0, n, _MASK_STEP) for c, n in zip(corner, counts, strict=True)]
    middles = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    allowed = on_object(dataset, middles.reshape(-1, 3)).reshape(middles.shape[:3])
    for axis, count in enumerate(counts):
        allowed = np.take(allowed, np.arange(count) // _MASK_STEP, axis=axis)
    inner &= allowed
    points = corner + cell_m * np.argwhere(inner)
    return ObjectPart(inner, corner, cell_m, box, space, _touched(points, space, coarse))


def on_object(dataset: Dataset, points_world: Array) -> NDArray[np.bool_]:
    """Return for each of ``points_world`` ``(n, 3)`` whether the masks let it be on the object.

    Without any mask every point may be.
    """
    seen = np.zeros(len(points_world), np.int16)
    beside = np.zeros(len(points_world), np.int16)
    for index in range(len(dataset)):
        alpha, mask = dataset.alphas[index], dataset.masks[index]
        shown = mask if alpha is None else alpha > 0
        if shown is None:
            continue
        reach_px = max(1, round(_MASK_SLACK * max(shown.shape)))
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1,) * 2)
        grown = cv2.dilate(shown.astype(np.uint8), disc) > 0
        pixels, depths = dataset.intrinsics[index].project(points_world, dataset.T_world_cam[index])
        u, v = whole_pixels(pixels).T
        visible = (depths > 0) & (u >= 0) & (u < shown.shape[1]) & (v >= 0) & (v < shown.shape[0])
        seen += visible
        beside[visible] += ~grown[v[visible], u[visible]]
    if not any(each is not None for each in (*dataset.alphas, *dataset.masks)):
        return np.ones(len(points_world), bool)
    return (seen > 0) & (beside <= _AGREEING_SHARE * seen)


def _touched(points_world: Array, space: SceneSpace, cells: int) -> NDArray[np.bool_]:
    """Return which of ``cells`` per axis over ``u`` hold a point, and their neighbours.

    Where these cells are finer than the points lie, some between two points hold none.
    """
    found = np.zeros((cells, cells, cells), bool)
    u = contract(space.to_scene(points_world))
    found[tuple(np.clip((u * cells).astype(np.int64), 0, cells - 1).T)] = True
    return np.asarray(binary_dilation(found, np.ones((3, 3, 3), bool)), bool)


def _airy_box(dataset: Dataset, space: SceneSpace) -> Box3:
    """Return the object's box with some air, or the field's own cube where no box is known."""
    box = dataset.object_box
    cube = Box3(space.centre - space.half_size, space.centre + space.half_size)
    if box is None:
        return cube
    air = _AIR * box.size
    return Box3(np.maximum(box.lower - air, cube.lower), np.minimum(box.upper + air, cube.upper))
