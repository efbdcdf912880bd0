"""How probable it is that a found box fits the object: intersection over union of a half at least.

A logistic model of what the search knows about its own result; the coefficients come from pictures
of simulated rooms with known truth (``dronerf bench regions`` prints how well they hold).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.masks import Mask
from server.vision.work import Work

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

_INTERCEPT = -7.573
_COEFFICIENTS = np.array([1.068, -2.725, 2.008, 1.011, 2.038, 1.012, -0.572, 1.187])


def clues(mask: Mask, evidence: Array32, foot: float, work: Work) -> Array:
    """Return what speaks for and against a mask ``(n,)``.

    In order: how surprising the mask is; how surprising its surroundings are; the share of its
    outline on edges of the picture; how well its foot stands on the floor; how near it is to the
    expected place; whether the shape was known; how much of the picture's border it touches; the
    logarithm of its size.
    """
    inner = mask.astype(np.uint8)
    gap = cv2.dilate(inner, np.ones((3, 3), np.uint8))
    ring = (cv2.dilate(inner, np.ones((9, 9), np.uint8)) > 0) & (gap == 0)
    outline = (inner > 0) & (cv2.erode(inner, np.ones((3, 3), np.uint8)) == 0)
    grey = work.lab[..., 0]
    slope = cv2.morphologyEx(grey, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    usual = float(np.mean(slope)) + 4.0
    on_edges = float(np.mean(np.minimum(slope[outline] / usual, 3.0))) if outline.any() else 0.0
    ys, xs = np.nonzero(mask)
    height, width = work.shape
    borders = [xs.min() == 0, xs.max() == width - 1, ys.min() == 0, ys.max() == height - 1]
    off = (np.array([xs.mean(), ys.mean()]) - work.centre) / (work.sigma + 0.25 * np.sqrt(len(xs)))
    known = work.prior.size_px is not None
    return np.array(
        [
            float(np.clip(evidence[mask], -1.0, 2.5).mean()),
            float(np.clip(evidence[ring], -1.0, 2.5).mean()) if ring.any() else 0.0,
            on_edges,
            foot,
            float(np.exp(-0.5 * (off @ off))) if work.surely_there else 0.5,
            float(known),
            float(sum(borders)),
            float(np.log(len(xs) / mask.size)) + 3.0,
        ]
    )


def confidence(values: Array) -> float:
    """Return the probability for the clues of a mask."""
    return float(1.0 / (1.0 + np.exp(-(_INTERCEPT + _COEFFICIENTS @ values))))
