"""Which places the views hold to be the object: a grid of cells, each view with one vote.

Votes are counted, not multiplied: a region search loses thin parts in one view and takes a shadow
along in another, and poses are wrong, so no single view may decide. Four rules:

1. a view holds a place to be the object where its projection lies inside the region's shape, or
   outside it by no more than a tolerance: what a cut is wrong by, and what the believed distance
   is wrong by (a camera ``sigma`` nearer shows everything ``sigma / depth`` larger). Beyond that
   its vote fades with distance, so that being slightly outside in one view is no verdict;
2. a view abstains on places beyond its picture when its box touches the edge;
3. of what rises in front of furniture a search loses more than it takes along, so "not there"
   counts less above all that a view shows than beside it or below: by ``1 - unsure_views / n`` of
   ``n`` views;
4. a place needs the votes of a share of the views that have one; half of all views must have one,
   and two must hold it without any doubt.

Symbols: ``n`` cells along each axis; grids are ``(n, n, n)``, x outermost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from server.geometry.boxes import Box3
from server.stages import View
from server.vision.config import SeedConfig

Array = NDArray[np.float64]
Cells = NDArray[np.bool_]

# Around a mask, distances are known this far out; farther away it is simply outside.
_PAD = 24
_LEAST_CERTAIN = 2


@dataclass(frozen=True, slots=True, eq=False)
class Carving:
    """The votes on one block of space.

    Attributes:
        space: The block, world metres.
        shares: ``(n, n, n)`` share of the votes that hold a cell to be the object, 0 where too few
            views have a vote.
    """

    space: Box3
    shares: Array

    def held(self, agreement: float) -> Cells:
        """Return the cells ``(n, n, n)`` that at least the share ``agreement`` holds."""
        return self.shares >= agreement - 1e-9

    def bounds(self, first: NDArray[np.int64], end: NDArray[np.int64]) -> Box3:
        """Return the box of the cells from ``first`` to before ``end``, both ``(3,)``."""
        step = self.space.size / self.shares.shape
        return Box3(self.space.lower + first * step, self.space.lower + end * step)


def carve(views: Sequence[View], space: Box3, config: SeedConfig, *, by_region: bool) -> Carving:
    """Let ``views`` vote on the cells of ``space``.

    Args:
        views: The views.
        space: The block of space.
        config: Settings.
        by_region: True to judge by the regions' shapes, False by the boxes.
    """
    n = config.voxels
    points = cell_centres(space, (n, n, n))
    # Per cell: the votes for it, what they can be at most, the views that have one, and those that
    # hold it without doubt.
    votes, most, voters, certain = (np.zeros(len(points)) for _ in range(4))
    above_weight = max(0.0, 1.0 - config.unsure_views / len(views))
    for view in views:
        pixels, depths = view.intrinsics.project(points, view.pose.T_world_cam)
        in_front = depths > 0.0
        seen = in_front & view.intrinsics.contains(pixels)
        may_vote = seen if view.box.touches_edge else np.ones(len(points), bool)
        judged = may_vote & in_front
        held, against = np.zeros(len(points)), may_vote.astype(float)
        if by_region:
            held[judged] = _in_region(view, pixels[judged], depths[judged], config)
        else:
            held[judged] = _in_box(view, pixels[judged])
        against[judged] = np.where(_above(view, pixels[judged]), above_weight, 1.0)
        votes += held
        most += held + (1.0 - held) * against
        voters += may_vote
        certain += held >= 1.0
    known = (voters >= max(2.0, 0.5 * len(views))) & (certain >= _LEAST_CERTAIN)
    shares = np.where(known, votes / np.maximum(most, 1e-9), 0.0)
    return Carving(space, shares.reshape((n, n, n)))


def cell_centres(space: Box3, counts: tuple[int, int, int]) -> Array:
    """Return the centres ``(m, 3)`` of ``counts`` cells along x, y, z that fill ``space``."""
    axes = [
        space.lower[a] + (np.arange(count) + 0.5) / count * space.size[a]
        for a, count in enumerate(counts)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def main_body(cells: Cells, least_share: float) -> Cells:
    """Return ``cells`` without the loose specks: pieces below ``least_share`` of the largest."""
    labels = np.zeros(cells.shape, np.int32)
    ndimage.label(cells, np.ones((3, 3, 3)), output=labels)
    if labels.max() < 2:
        return cells
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    kept = sizes >= least_share * sizes.max()
    return np.asarray(kept[labels], bool) & cells


def _in_box(view: View, pixels: Array) -> Array:
    left, top, right, bottom = view.box.xyxy_px
    x, y = pixels[:, 0], pixels[:, 1]
    return ((x >= left) & (x <= right) & (y >= top) & (y <= bottom)).astype(float)


def _above(view: View, pixels: Array) -> Cells:
    """Return which pixels ``(m, 2)`` lie straight above the view's box."""
    left, top, right, _ = view.box.xyxy_px
    x, y = pixels[:, 0], pixels[:, 1]
    return (x >= left) & (x <= right) & (y < top)


def _in_region(view: View, pixels: Array, depths: Array, config: SeedConfig) -> Array:
    outside_px = _distance_outside(view, config)
    scale = view.region.mask_scale
    places = np.rint((pixels + 0.5) / scale - 0.5).astype(int) + _PAD
    height, width = outside_px.shape
    columns = np.clip(places[:, 0], 0, width - 1)
    rows = np.clip(places[:, 1], 0, height - 1)
    size_px = float(view.box.size_px.max()) / scale
    pose_px = 0.5 * size_px * view.pose.position_sigma_m / np.maximum(depths, 0.1)
    tolerance_px = config.tolerance_px / scale + np.minimum(pose_px, 0.15 * size_px)
    beyond_px = outside_px[rows, columns] - tolerance_px
    return np.clip(1.0 - beyond_px / max(config.fade_share * size_px, 1e-6), 0.0, 1.0)


def _distance_outside(view: View, config: SeedConfig) -> NDArray[np.float32]:
    """Return how far each mask pixel lies outside the region's shape, padded, mask pixels."""
    shape = np.pad(_shape(view.region.mask, config.closing_share), _PAD)
    return cv2.distanceTransform((1 - shape).astype(np.uint8), cv2.DIST_L2, 5).astype(np.float32)


def _shape(mask: Cells, closing_share: float) -> NDArray[np.uint8]:
    """Return the mask with its gaps closed up to a share of its size, its hull from 1 on.

    Searches break thin parts off and leave holes; a gap between legs is closed along with them.
    """
    shape = mask.astype(np.uint8)
    rows, columns = np.nonzero(shape)
    if len(rows) == 0:
        return shape
    if closing_share >= 1.0:
        hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
        return cv2.fillConvexPoly(shape, hull, 1).astype(np.uint8)
    side = max(np.ptp(rows), np.ptp(columns)) + 1
    radius = round(0.5 * closing_share * float(side))
    if radius < 1:
        return shape
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    padded = np.pad(shape, radius)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, kernel)
    return closed[radius:-radius, radius:-radius].astype(np.uint8)
