"""The crude geometry of the object from a handful of views.

Every box spans four side planes through its camera; the views of an orthogonal pair bound the
object on all sides, and where the pairs' boxes agree lies the object. Poses are wrong by decimetres
and degrees, so a plain intersection may be empty. Three things keep it sound:

1. the rays through the box centres are brought towards one common point (each view is turned by its
   pose's share of the few degrees it misses it by; most of a pose's error shows as exactly that),
2. places are kept by vote: a share of the views that see a place must hold it to be the object,
3. a view abstains on places beyond its picture.

First the boxes vote, which gives the outer box; then, inside it, the regions' shapes vote
(``server.vision.seed_carving``), and what they keep is cut into boxes where the cuts leave the
least empty space (``server.vision.seed_boxes``). How many votes a place needs is chosen by what
the views show: nearly all of them remove what one took along, fewer keep what one lost or a wrong
pose moved, and the boxes whose silhouettes match the regions best are taken. Later views vote along
with the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.boxes import Box3
from server.geometry.poses import inverse, transform_points
from server.stages import SeedGeometry, View
from server.vision.config import SeedConfig
from server.vision.seed_boxes import Block, boxes_around
from server.vision.seed_carving import Carving, carve, main_body

Array = NDArray[np.float64]

# Votes asked for are lowered in steps of this share of the views.
_STEP = 0.05
# Corners are drawn no farther outside of a picture, mask pixels.
_FAR_PX = 4000.0


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
    turned = [_turned_towards(view, centre, config) for view in views]
    half = _half_size(turned, centre)
    lower, upper = centre - half, centre + half
    lower[2], upper[2] = max(lower[2], 0.0), max(upper[2], config.min_size_m)
    by_box = carve(turned, Box3(lower, upper), config, by_region=False)
    outer = _around(by_box, config)
    if outer is None:
        raise SeedError("the views' boxes have no place in common; were they taken of one object?")
    outer = outer.grown(config.margin_m)
    boxes, confidences = _boxes(turned, carve(turned, outer, config, by_region=True), config)
    if not boxes:
        boxes, confidences = (outer,), (0.0,)
    return SeedGeometry(outer, boxes, len(views), confidences)


def refine_seed(seed: SeedGeometry, views: Sequence[View], config: SeedConfig) -> SeedGeometry:
    """Return the geometry from all ``views`` so far, or ``seed`` itself when they make none.

    Later rounds never lose what earlier ones had: when the views cannot be combined the old
    geometry stays, and the operator's priorities stay in any case.
    """
    try:
        refined = seed_from_views(views, config)
    except SeedError:
        return seed
    return replace(refined, priorities=seed.priorities)


def kept_within(seed: SeedGeometry, outer: Box3) -> SeedGeometry:
    """Return ``seed`` with ``outer`` as its outer box and its boxes cut to it.

    When nothing is left, all of ``outer`` is the one box.
    """
    kept = [
        (_clipped(box, outer), confidence)
        for box, confidence in zip(seed.boxes, seed.box_confidences, strict=True)
        if (np.minimum(box.upper, outer.upper) > np.maximum(box.lower, outer.lower)).all()
    ] or [(outer, 0.0)]
    boxes, confidences = zip(*kept, strict=True)
    return replace(seed, outer=outer, boxes=boxes, confidences=confidences)


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


def _turned_towards(view: View, centre: Array, config: SeedConfig) -> View:
    """Return ``view`` turned in place so that its box's centre ray passes ``centre`` more closely.

    A ray misses it for two reasons: the pose is wrong, or the box's centre is not the object's, as
    it is in perspective and where the search lost a part. The view is turned by the pose's share
    of the miss. A box cut off by the picture's edge keeps its elevation: its true centre lies
    beyond.
    """
    seen = _centre_direction(view)
    offset = centre - view.pose.position_world
    distance_m = max(float(np.linalg.norm(offset)), 1e-6)
    wanted = seen + _pose_share(view, distance_m, config) * (offset / distance_m - seen)
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


def _pose_share(view: View, distance_m: float, config: SeedConfig) -> float:
    """Return the pose's share, 0 to 1, of the variance of the direction to the object."""
    pose = (view.pose.position_sigma_m / distance_m) ** 2 + float(view.pose.covariance[3, 3])
    box = (config.centroid_share * float(view.box.size_px.max()) / view.intrinsics.fx) ** 2
    return pose / (pose + box)


def _half_size(views: Sequence[View], centre: Array) -> float:
    """Return half the edge of a cube around ``centre`` that surely holds the object, metres."""
    sizes = []
    for view in views:
        depth = float(transform_points(inverse(view.pose.T_world_cam), centre[None])[0, 2])
        sizes.append(float(view.box.size_px.max()) / view.intrinsics.fx * max(depth, 0.1))
    return float(0.8 * np.median(sizes) + 0.15)


# Boxes ------------------------------------------------------------------------------------------


def _around(carving: Carving, config: SeedConfig) -> Box3 | None:
    """Return the box around what the views hold, no edge below the smallest size; None: nothing."""
    filled = np.argwhere(carving.held(config.agreement))
    if len(filled) == 0:
        return None
    return _no_thinner(carving.bounds(filled.min(axis=0), filled.max(axis=0) + 1), config)


def _boxes(
    views: Sequence[View], carving: Carving, config: SeedConfig
) -> tuple[tuple[Box3, ...], tuple[float, ...]]:
    """Return the boxes, lowest first, and per box how surely the object fills it.

    They are of the vote whose boxes look most like what the views show; of equals the strictest.
    """
    best_match, boxes, blocks = 0.0, (), []
    strictest = 1.0 - config.shape_doubt / np.sqrt(len(views))
    levels = np.arange(strictest, config.least_agreement - 1e-9, -_STEP)
    for agreement in levels:
        cells = main_body(carving.held(float(agreement)), config.least_piece)
        tried = boxes_around(cells, config.slices, config.least_saved)
        if not tried:
            continue
        fitted = tuple(_box(carving, block, config) for block in tried)
        match = silhouette_match(views, fitted)
        if match > best_match:
            best_match, boxes, blocks = match, fitted, tried
    return boxes, tuple(float(np.mean(block.of(carving.shares))) for block in blocks)


def _box(carving: Carving, block: Block, config: SeedConfig) -> Box3:
    return _clipped(_no_thinner(carving.bounds(block.first, block.end), config), carving.space)


def silhouette_match(views: Sequence[View], boxes: Sequence[Box3]) -> float:
    """Return how much a union of 3D boxes looks like the regions, 0 to 1.

    Per view, the IoU of the boxes' silhouette with the region's mask: what a region took along
    counts as much as what it lost. Of these the median, so that one bad view asks for nothing.
    """
    matches = []
    for view in views:
        mask = view.region.mask
        silhouette = np.zeros(mask.shape, np.uint8)
        pixels, depths = view.intrinsics.project(
            np.concatenate([box.corners for box in boxes]), view.pose.T_world_cam
        )
        if (depths <= 0.0).any():
            continue
        places = (pixels + 0.5) / view.region.mask_scale - 0.5
        for corners in np.clip(places, -_FAR_PX, _FAR_PX).astype(np.float32).reshape(-1, 8, 2):
            outline = np.rint(cv2.convexHull(corners)).astype(np.int32)
            cv2.fillConvexPoly(silhouette, outline, 1)
        shown = silhouette > 0
        matches.append(float((shown & mask).sum()) / max(float((shown | mask).sum()), 1.0))
    return float(np.median(matches)) if matches else 0.0


def _no_thinner(box: Box3, config: SeedConfig) -> Box3:
    short = np.maximum(config.min_size_m - box.size, 0.0) / 2.0
    return Box3(box.lower - short, box.upper + short)


def _clipped(box: Box3, outer: Box3) -> Box3:
    return Box3(np.maximum(box.lower, outer.lower), np.minimum(box.upper, outer.upper))
