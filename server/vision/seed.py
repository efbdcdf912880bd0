"""The crude geometry of the object from a handful of views.

Every box spans four side planes through its camera; the views of an orthogonal pair bound the
object on all sides, and where the pairs' boxes agree lies the object. Poses are wrong by decimetres
and degrees, so a plain intersection may be empty. Three things keep it sound:

1. the rays through the box centres are brought to one common point (each view is turned by the few
   degrees it misses it by; most of a pose's error shows as exactly that turn),
2. places are kept by vote: a share of the views that see a place must hold it to be the object,
3. a view abstains on places beyond its picture.

First the boxes vote, which gives the outer box; then, inside it, the masks vote, and what is left
is cut along the vertical into slices, one box each, where the cuts leave the least empty space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.boxes import Box3, union
from server.geometry.poses import inverse, transform_points
from server.stages import SeedGeometry, View
from server.vision.config import SeedConfig

Array = NDArray[np.float64]
Grid = NDArray[np.bool_]


class SeedError(ValueError):
    """The views cannot be combined into one geometry; the text says why."""


def seed_from_views(views: Sequence[View], config: SeedConfig) -> SeedGeometry:
    """Return the crude geometry of the object seen in ``views``.

    Args:
        views: At least ``config.min_views``, two of them an orthogonal pair.
        config: Settings.

    Raises:
        SeedError: If there are too few views, no orthogonal pair among them, or they look at
            different things.
    """
    if len(views) < config.min_views:
        raise SeedError(f"the seed needs at least {config.min_views} views, got {len(views)}")
    _require_orthogonal_pair(views, config)
    centre = common_centre(views, config)
    turned = [_turned_towards(view, centre) for view in views]
    half = _half_size(turned, centre)
    lower, upper = centre - half, centre + half
    lower[2], upper[2] = max(lower[2], 0.0), max(upper[2], config.min_size_m)
    carved = _carve(turned, lower, upper, config, by_mask=False)
    if not carved.any():
        raise SeedError("the views' boxes have no place in common; were they taken of one object?")
    outer = _bounds(carved, lower, upper, config).grown(config.margin_m)
    by_mask = _carve(turned, outer.lower, outer.upper, config, by_mask=True)
    boxes = _slices(by_mask, outer, config) if by_mask.any() else (outer,)
    return SeedGeometry(outer, boxes, len(views))


def refine_seed(seed: SeedGeometry, views: Sequence[View], config: SeedConfig) -> SeedGeometry:
    """Return the geometry from all ``views`` so far, or ``seed`` itself when they make none.

    Later rounds never lose what earlier ones had: when the views cannot be combined the old
    geometry stays.
    """
    try:
        return seed_from_views(views, config)
    except SeedError:
        return seed


# Directions and the common centre ---------------------------------------------------------------


def _centre_direction(view: View) -> Array:
    """Return the unit world direction ``(3,)`` of the ray through the box's centroid."""
    direction_cam = view.intrinsics.directions(view.box.centroid_px[None])[0]
    return view.pose.T_world_cam[:3, :3] @ direction_cam


def _require_orthogonal_pair(views: Sequence[View], config: SeedConfig) -> None:
    level = np.stack([_centre_direction(view)[:2] for view in views])
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    angles = np.arccos(np.clip(level @ level.T, -1.0, 1.0))
    if not (np.abs(angles - np.pi / 2.0) <= np.pi / 2.0 - config.pair_min_rad).any():
        least = np.rad2deg(config.pair_min_rad)
        raise SeedError(
            f"no two views differ by {least:.0f} to {180 - least:.0f} degrees of azimuth"
        )


def common_centre(views: Sequence[View], config: SeedConfig) -> Array:
    """Return the point ``(3,)`` nearest all rays through the box centres, robustly.

    Iteratively reweighted least squares with Cauchy weights: one view of something else pulls
    little.

    Raises:
        SeedError: If the rays miss it by more than ``config.max_miss_m`` in the median.
    """
    origins = np.stack([view.pose.position_world for view in views])
    directions = np.stack([_centre_direction(view) for view in views])
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weights = np.array([0.3 if view.box.touches_edge else 1.0 for view in views])
    robust = np.ones(len(views))
    centre, miss = np.zeros(3), np.zeros(len(views))
    for _ in range(10):
        A = np.einsum("n,nij->ij", weights * robust, across)
        b = np.einsum("n,nij,nj->i", weights * robust, across, origins)
        centre = np.linalg.solve(A + 1e-9 * np.eye(3), b)
        miss = np.linalg.norm(np.einsum("nij,nj->ni", across, centre - origins), axis=1)
        robust = 1.0 / (1.0 + (miss / 0.15) ** 2)
    if float(np.median(miss)) > config.max_miss_m:
        raise SeedError(
            f"the views look past one another by {np.median(miss):.2f} m in the median "
            f"(at most {config.max_miss_m:g} m)"
        )
    return centre


def _turned_towards(view: View, centre: Array) -> View:
    """Return ``view`` turned in place so that its box's centre ray passes through ``centre``.

    A box cut off by the picture's edge keeps its elevation: its true centre lies beyond.
    """
    seen = _centre_direction(view)
    wanted = centre - view.pose.position_world
    turn = np.arctan2(wanted[1], wanted[0]) - np.arctan2(seen[1], seen[0])
    R = Rotation.from_euler("z", turn).as_matrix()
    if not view.box.touches_edge:
        seen = R @ seen
        axis = np.cross(seen, wanted)
        size = float(np.linalg.norm(axis))
        if size > 1e-12:
            angle = np.arctan2(size, float(seen @ wanted))
            R = Rotation.from_rotvec(axis / size * angle).as_matrix() @ R
    T = view.pose.T_world_cam.copy()
    T[:3, :3] = R @ T[:3, :3]
    return replace(view, pose=replace(view.pose, T_world_cam=T))


def _half_size(views: Sequence[View], centre: Array) -> float:
    """Return half the edge of a cube around ``centre`` that surely holds the object, metres."""
    sizes = []
    for view in views:
        depth = float(transform_points(inverse(view.pose.T_world_cam), centre[None])[0, 2])
        sizes.append(float(view.box.size_px.max()) / view.intrinsics.fx * max(depth, 0.1))
    return float(0.8 * np.median(sizes) + 0.15)


# Carving ----------------------------------------------------------------------------------------


def _cell_centres(lower: Array, upper: Array, cells: int) -> Array:
    """Return the cells' centres ``(cells^3, 3)``, x outermost."""
    steps = (np.arange(cells) + 0.5) / cells
    axes = [lower[a] + steps * (upper[a] - lower[a]) for a in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _carve(
    views: Sequence[View], lower: Array, upper: Array, config: SeedConfig, *, by_mask: bool
) -> Grid:
    """Return the cells ``(n, n, n)`` that enough of the views seeing them hold to be the object."""
    points = _cell_centres(lower, upper, config.voxels)
    votes, voters = np.zeros(len(points)), np.zeros(len(points))
    for view in views:
        pixels, depths = view.intrinsics.project(points, view.pose.T_world_cam)
        seen = (depths > 0.0) & view.intrinsics.contains(pixels)
        votes[seen] += _in_mask(view, pixels[seen]) if by_mask else _in_box(view, pixels[seen])
        # An object that touches no edge is wholly in the picture: what is outside is not it.
        voters += seen if view.box.touches_edge else 1.0
    # With one voter fewer than views a place is judged by the rest; unseen by most, it is out.
    enough = voters >= max(2.0, 0.5 * len(views))
    carved = enough & (votes >= config.agreement * voters - 1e-9)
    return carved.reshape((config.voxels,) * 3)


def _in_box(view: View, pixels: Array) -> Grid:
    left, top, right, bottom = view.box.xyxy_px
    x, y = pixels[:, 0], pixels[:, 1]
    return (x >= left) & (x <= right) & (y >= top) & (y <= bottom)


def _in_mask(view: View, pixels: Array) -> Grid:
    mask, scale = view.region.mask, view.region.mask_scale
    columns = np.clip(((pixels[:, 0] + 0.5) / scale).astype(int), 0, mask.shape[1] - 1)
    rows = np.clip(((pixels[:, 1] + 0.5) / scale).astype(int), 0, mask.shape[0] - 1)
    return mask[rows, columns]


def _bounds(carved: Grid, lower: Array, upper: Array, config: SeedConfig) -> Box3:
    """Return the upright box around the carved cells, no edge below the smallest size."""
    step = (upper - lower) / config.voxels
    filled = np.argwhere(carved)
    box = Box3(lower + filled.min(axis=0) * step, lower + (filled.max(axis=0) + 1) * step)
    short = np.maximum(config.min_size_m - box.size, 0.0) / 2.0
    return Box3(box.lower - short, box.upper + short)


# Slices -----------------------------------------------------------------------------------------


def _slices(carved: Grid, outer: Box3, config: SeedConfig) -> tuple[Box3, ...]:
    """Return one box per slice, bottom first, cut so that the boxes' total volume is least."""
    layers = np.nonzero(carved.any(axis=(0, 1)))[0]
    first, last = int(layers[0]), int(layers[-1]) + 1
    cuts = best_cuts(_slab_areas(carved, first, last), min(config.slices, last - first))
    boxes = []
    for low, high in pairwise(cuts):
        part = np.zeros_like(carved)
        part[:, :, first + low : first + high] = carved[:, :, first + low : first + high]
        if part.any():
            boxes.append(_clipped(_bounds(part, outer.lower, outer.upper, config), outer))
    return tuple(boxes)


def _clipped(box: Box3, outer: Box3) -> Box3:
    return Box3(np.maximum(box.lower, outer.lower), np.minimum(box.upper, outer.upper))


def _slab_areas(carved: Grid, first: int, last: int) -> Array:
    """Return ``(n + 1, n + 1)``: footprint in cells of the box around layers [i, j)."""
    n = last - first
    limits = np.full((n, 4), [carved.shape[0], carved.shape[1], -1, -1])
    for i in range(n):
        filled = np.argwhere(carved[:, :, first + i])
        if len(filled):
            limits[i] = np.concatenate([filled.min(axis=0), filled.max(axis=0)])
    areas = np.zeros((n + 1, n + 1))
    for i in range(n):
        low = np.minimum.accumulate(limits[i:, :2], axis=0)
        high = np.maximum.accumulate(limits[i:, 2:], axis=0)
        areas[i, i + 1 :] = np.prod(np.maximum(high - low + 1, 0), axis=1)
    return areas


def best_cuts(areas: Array, count: int) -> list[int]:
    """Return ``count + 1`` rising layer numbers that cut the layers with least total volume.

    Dynamic programming over (slices used, layers used).

    Args:
        areas: ``(n + 1, n + 1)``, footprint of layers [i, j) taken as one slice.
        count: Number of slices, at most n.
    """
    n = len(areas) - 1
    heights = np.arange(n + 1)
    volumes = areas * np.maximum(heights[None, :] - heights[:, None], 0)
    volumes[heights[None, :] <= heights[:, None]] = np.inf
    best = np.full((count + 1, n + 1), np.inf)
    best[0, 0] = 0.0
    origin = np.zeros((count + 1, n + 1), int)
    for k in range(1, count + 1):
        totals = best[k - 1][:, None] + volumes
        origin[k] = totals.argmin(axis=0)
        best[k] = totals.min(axis=0)
    cuts = [n]
    for k in range(count, 0, -1):
        cuts.append(int(origin[k, cuts[-1]]))
    return cuts[::-1]


def as_single_box(seed: SeedGeometry) -> Box3:
    """Return the smallest box around the slices (at most the outer box)."""
    return union(seed.boxes)
