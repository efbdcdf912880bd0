"""What the floor says about a picture: where free floor must be, and what on it is not floor.

The object stands on the floor near the middle of a fence that has been cleared of everything else.
So whatever is seen in front of free floor, and does not look like floor, is the object; and its
foot appears between the rows at which the floor is as near and as far as the object can be. What
rises above the free floor is told from the wall behind it by the same rows to its left and right.

Symbols: h the camera's height above the floor, d a horizontal distance, v a picture row (down).
All rows and masks are working pixels; surprise is -log P(colour | background), in nats.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose
from server.vision.masks import Mask, colour_histogram

Array32 = NDArray[np.float32]
Bins = NDArray[np.intp]

# A colour that never occurs in the background surprises by -log of this.
_LEAST_PROBABILITY = 2e-5
# Share of the background that may surprise more than the threshold.
_FLOOR_SHARE, _WALL_SHARE = 0.03, 0.07
_WALL_LEAST = 4.5
_BAND_ROWS, _BAND_MARGIN = 12, 8
_FOOT_TOLERANCE = 8.0


@dataclass(frozen=True, slots=True)
class Ground:
    """The rows that matter, full-picture pixels.

    Attributes:
        free_px: From this row downwards nothing but free floor lies behind the object.
        foot_far_px: Row of the floor at the farthest distance the object may stand at.
        foot_near_px: Row of the floor at the nearest.
    """

    free_px: float
    foot_far_px: float
    foot_near_px: float


def ground_seen(
    pose: CameraPose,
    distance_m: float,
    uncertainty_m: float,
    clear_m: float,
    intrinsics: Intrinsics,
) -> Ground | None:
    """Return the rows for a camera that looks towards the object, None too near the floor.

    Args:
        pose: The camera's believed pose.
        distance_m: Horizontal distance to the object's centre.
        uncertainty_m: How wrong that may be, the object's own extent included.
        clear_m: How far beyond the object the floor is surely free.
        intrinsics: The camera.
    """
    height_m = float(pose.position_world[2])
    if height_m < 0.3:
        return None
    forward = pose.T_world_cam[:3, 2]
    below_rad = -float(np.arcsin(np.clip(forward[2], -1.0, 1.0)))

    def row(d: float) -> float:
        tangent = np.tan(np.arctan2(height_m, d) - below_rad)
        return float(intrinsics.cy + intrinsics.fy * tangent)

    nearest = max(0.3, 0.4 * distance_m, distance_m - uncertainty_m)
    return Ground(row(distance_m + clear_m), row(distance_m + uncertainty_m), row(nearest))


def foot_factor(mask: Mask, ground: Ground, scale: int) -> float:
    """Return how well a mask's lowest row fits an object that stands on the floor, 0 to 1."""
    ys = np.nonzero(mask.any(axis=1))[0]
    if len(ys) == 0:
        return 0.0
    lowest = float(ys[-1])
    if lowest < ground.foot_far_px / scale - _FOOT_TOLERANCE:
        return 0.03
    at_edge = ground.foot_near_px / scale >= mask.shape[0] - 2
    if not at_edge and lowest > ground.foot_near_px / scale + _FOOT_TOLERANCE:
        return 0.3
    return 1.0


def floor_evidence(bins_lab: Bins, bins: int, ground: Ground, scale: int, away: Array32) -> Array32:
    """Return how much every pixel surprises as floor ``(h, w)``, above a threshold; -1 elsewhere.

    Args:
        bins_lab: Colour bins of the picture.
        bins: Bins per axis.
        ground: The rows.
        scale: Full-picture pixels per working pixel.
        away: Weight ``(h, w)`` with which pixels count as surely floor: small near the object.
    """
    evidence = np.full(bins_lab.shape, -1.0, np.float32)
    top = int(np.clip(ground.free_px / scale + 2.0, 0, len(bins_lab) - 1))
    weights = np.ascontiguousarray(away[top:])
    if weights.sum() < 100.0:
        return evidence
    surprise = _surprise(bins_lab[top:], colour_histogram(bins_lab[top:], weights, bins))
    evidence[top:] = surprise - _quantile(surprise, weights, 1.0 - _FLOOR_SHARE)
    return evidence


def grow_up(mask: Mask, bins_lab: Bins, bins: int, ground: Ground, scale: int) -> Mask:
    """Return ``mask`` grown above the free floor by what differs from the wall beside it."""
    top = int(np.clip(ground.free_px / scale + 2.0, 0, len(bins_lab) - 1))
    ys, xs = np.nonzero(mask)
    if ys.min() > top + 4 or top <= 4:
        return mask
    width = mask.shape[1]
    spread = 0.2 * (xs.max() - xs.min() + 1) + 3
    left, right = int(max(0, xs.min() - spread)), int(min(width - 1, xs.max() + spread))
    beside = np.ones(mask.shape, np.float32)
    beside[:, left : right + 1] = 0.0
    grown = mask.copy()
    for start in range(0, top + 1, _BAND_ROWS):
        first = max(0, start - _BAND_MARGIN)
        last = min(top + 6, start + _BAND_ROWS + _BAND_MARGIN)
        weights = np.ascontiguousarray(beside[first:last])
        if weights.sum() < 100.0:
            continue
        band = bins_lab[first:last]
        surprise = _surprise(band, colour_histogram(band, weights, bins))
        limit = max(_quantile(surprise, weights, 1.0 - _WALL_SHARE), _WALL_LEAST)
        end = min(start + _BAND_ROWS, top + 1)
        rows = (surprise > limit)[start - first : end - first, left : right + 1]
        grown[start:end, left : right + 1] |= rows
    closed = cv2.morphologyEx(grown.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8))
    _, labels = cv2.connectedComponents(closed)
    kept = np.unique(labels[mask & (closed > 0)])
    return np.isin(labels, kept[kept > 0])


def _surprise(bins_lab: Bins, histogram: Array32) -> Array32:
    probability = histogram.ravel()[bins_lab] + _LEAST_PROBABILITY
    return cv2.blur((-np.log(probability)).astype(np.float32), (3, 3)).astype(np.float32)


def _quantile(values: Array32, weights: Array32, share: float) -> float:
    order = np.argsort(values, axis=None)
    mass = np.cumsum(weights.ravel()[order])
    return float(values.ravel()[order[int(np.searchsorted(mass, share * mass[-1]))]])
