"""The visual hull: where the object of cut-out pictures can be at all (Laurentini 1994).

A cell is outside when enough pictures show nothing where it would appear. Cells are tested by their
centres against masks grown by what a cell covers in the picture, so that none is lost to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from server.geometry.boxes import Box3
from server.geometry.cameras import whole_pixels
from server.nerf.dataset import Dataset
from server.nerf.space import SceneSpace, expand, scene_space

# Cells per axis of the first look for the object.
_SEARCH_CELLS = 96
# The same for a box of masks that are only roughly right; so large a share of them may disagree.
_BOX_CELLS = 64
_DISSENTING_SHARE = 0.3
# A box so much smaller or larger than believed is of something else.
_LEAST_SHARE = 0.4
# Share of the pictures that must agree that a cell is outside: a single mask may be wrong.
_AGREEING_SHARE = 0.05
# Parts of the cube nearer to a camera than this share of its distance are taken as that far.
_NEAREST_SHARE = 0.3


def grown_mask(
    dataset: Dataset, index: int, space: SceneSpace, cells: int, *, times: int = 1
) -> NDArray[np.bool_]:
    """Return where picture ``index`` may show a cell of the hull, ``(h, w)``.

    Args:
        dataset: Cut-out pictures.
        index: Of the picture.
        space: Scene space.
        cells: Cells per axis over the whole folded cube.
        times: How many times the reach of a cell to grow by.
    """
    alpha = dataset.alphas[index]
    if alpha is None:
        raise ValueError(f"picture {index} is not cut out")
    camera = dataset.intrinsics[index]
    distance = float(np.linalg.norm(dataset.T_world_cam[index, :3, 3] - space.centre))
    nearest = max(distance - math.sqrt(3.0) * space.half_size, _NEAREST_SHARE * distance)
    reach_m = math.sqrt(3.0) / 2.0 * 4.0 / cells * space.half_size
    reach_px = math.ceil(times * reach_m * max(camera.fx, camera.fy) / nearest)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1, 2 * reach_px + 1))
    return cv2.dilate((alpha > 0).astype(np.uint8), disc) > 0


def tight_space(dataset: Dataset) -> SceneSpace:
    """Return the scene space around the visual hull of cut-out pictures that come without a box."""
    wide = scene_space(dataset)
    hull = visual_hull(dataset, range(len(dataset)), wide, _SEARCH_CELLS)
    corners = np.argwhere(hull)
    lower, upper = corners.min(axis=0) / _SEARCH_CELLS, (corners.max(axis=0) + 1) / _SEARCH_CELLS
    lower, upper = wide.centre + wide.half_size * expand(np.stack([lower, upper]))
    return SceneSpace((lower + upper) / 2.0, float((upper - lower).max()) / 2.0)


def box_of_masks(dataset: Dataset, near: Box3) -> Box3 | None:
    """Return the box of what the masks of posed pictures agree on, None when they do not.

    Args:
        dataset: Pictures whose masks show the object, each perhaps only roughly.
        near: Where the object was believed; it is looked for in twice that size.
    """
    reach_m = float(near.size.max())
    axes = [middle + np.linspace(-reach_m, reach_m, _BOX_CELLS) for middle in near.centre]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    seen = np.zeros(len(points), np.int16)
    beside = np.zeros(len(points), np.int16)
    masked = [index for index, mask in enumerate(dataset.masks) if mask is not None]
    for index in masked:
        mask = dataset.masks[index]
        assert mask is not None
        pixels, depths = dataset.intrinsics[index].project(points, dataset.T_world_cam[index])
        u, v = whole_pixels(pixels).T
        shown = (depths > 0) & (u >= 0) & (u < mask.shape[1]) & (v >= 0) & (v < mask.shape[0])
        seen += shown
        beside[shown] += ~mask[v[shown], u[shown]]
    # Masks are cut short here and there; shadows in single ones reach far.
    agreed = (2 * seen >= len(masked)) & (seen > 0) & (beside <= _DISSENTING_SHARE * seen)
    labels = np.zeros((_BOX_CELLS,) * 3, np.int32)
    ndimage.label(agreed.reshape(labels.shape), output=labels)
    if not labels.any():
        return None
    largest = 1 + int(np.bincount(labels.reshape(-1))[1:].argmax())
    corners = np.argwhere(labels == largest)
    half_cell_m = reach_m / (_BOX_CELLS - 1)
    lower = [axis[k] for axis, k in zip(axes, corners.min(axis=0), strict=True)]
    upper = [axis[k] for axis, k in zip(axes, corners.max(axis=0), strict=True)]
    found = Box3(np.array(lower) - half_cell_m, np.array(upper) + half_cell_m)
    share = float(found.size.max()) / reach_m
    return found if _LEAST_SHARE < share < 1.0 / _LEAST_SHARE else None


def visual_hull(
    dataset: Dataset, indices: Sequence[int], space: SceneSpace, cells: int
) -> NDArray[np.bool_]:
    """Return which cells ``(cells, cells, cells)`` over ``u`` may hold a part of the object.

    Only the object's own cube is looked at: a cut-out object has no room around it. Without any
    cell left, as with masks that contradict each other, all of the cube is returned.

    Args:
        dataset: Cut-out pictures.
        indices: Training pictures.
        space: Scene space.
        cells: Cells per axis.
    """
    axis = (np.arange(cells) + 0.5) / cells
    middle = np.flatnonzero(np.abs(axis - 0.5) < 0.25)
    inner = axis[middle]
    grid = np.stack(np.meshgrid(inner, inner, inner, indexing="ij"), axis=-1).reshape(-1, 3)
    points = space.centre + space.half_size * expand(grid)
    outside = np.zeros(len(points), np.int16)
    for index in indices:
        mask = grown_mask(dataset, index, space, cells)
        pixels, _ = dataset.intrinsics[index].project(points, dataset.T_world_cam[index])
        u, v = whole_pixels(pixels).T
        shown = (u >= 0) & (u < mask.shape[1]) & (v >= 0) & (v < mask.shape[0])
        outside[shown] += ~mask[v[shown], u[shown]]
    left = outside < max(1, math.ceil(_AGREEING_SHARE * len(indices)))
    if not left.any():
        left[:] = True
    hull = np.zeros((cells, cells, cells), bool)
    hull[np.ix_(middle, middle, middle)] = left.reshape((len(middle),) * 3)
    return hull
