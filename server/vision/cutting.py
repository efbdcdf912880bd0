"""Cutting the object out along the picture's edges, and moving a known outline onto it.

Working pixels throughout; evidence is above zero where a pixel does not look like background.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.config import RegionConfig
from server.vision.masks import Mask
from server.vision.work import Work

Array32 = NDArray[np.float32]

# Evidence, nats, that no cut overrules.
SURE = 2.5
# Evidence beyond these limits says no more about an outline's place.
_LEAST_SPEAKS, _MOST_SPEAKS = -0.5, 2.0
# The band around the outline, as a share of its size, and what evidence there costs against as much
# of it within: whoever lies on a wider thing, a shelf or a rug, is not the object.
_BAND_SHARE, _BAND_COST = 0.3, 0.6
# What a move by one standard deviation costs, in mean evidence within the outline; and what each
# working pixel costs by which its foot misses the rows where it can stand.
_MOVE_COST, _FOOT_COST = 0.1, 0.03


def fitted_outline(
    evidence: Array32,
    expected: Mask,
    sigma: float,
    feet: tuple[float, float] = (-np.inf, np.inf),
) -> tuple[Mask, float]:
    """Return the expected outline moved to where it stands out most, and the share covered.

    As the Laplacian of equation 1 does, it compares the inside with what surrounds it: evidence
    within the outline speaks for a place, evidence in the band around it against it.

    Args:
        evidence: Evidence against the background ``(h, w)``.
        expected: Expected outline, filled ``(h, w)``.
        sigma: How wrong its place may be, working pixels.
        feet: Uppermost and lowest row at which its foot can stand, working pixels.
    """
    height, width = expected.shape
    half = (width // 2, height // 2)
    speaks = np.clip(evidence, _LEAST_SPEAKS, _MOST_SPEAKS)
    speaks = cv2.resize(speaks, half, interpolation=cv2.INTER_AREA)
    ys, xs = np.nonzero(expected)
    left, top, right, bottom = xs.min() // 2, ys.min() // 2, xs.max() // 2 + 1, ys.max() // 2 + 1
    small = cv2.resize(expected.astype(np.float32), half, interpolation=cv2.INTER_AREA)
    shape = np.asarray(small[top:bottom, left:right], np.float32)
    # Half pixels of an odd picture's last row and column are not there.
    bottom, right = top + shape.shape[0], left + shape.shape[1]
    band = max(2, round(_BAND_SHARE * float(np.sqrt(shape.sum()))))
    template = _against_surroundings(shape, band)
    reach = int(np.ceil(1.25 * sigma))
    margin = reach + band
    padded = cv2.copyMakeBorder(
        speaks, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0.0
    )
    part = padded[top : bottom + 2 * margin, left : right + 2 * margin]
    fit = cv2.matchTemplate(part.astype(np.float32), template, cv2.TM_CCORR)
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1][:, : fit.shape[0], : fit.shape[1]]
    off = (dx**2 + dy**2) * (2.0 / sigma) ** 2
    foot = float(ys.max()) + 2.0 * dy
    misses = np.maximum(feet[0] - foot, 0.0) + np.maximum(foot - feet[1], 0.0)
    fit = fit - _MOVE_COST * off - _FOOT_COST * misses
    best = np.unravel_index(int(np.argmax(fit)), fit.shape)
    move = np.array([[1.0, 0.0, 2.0 * dx[best]], [0.0, 1.0, 2.0 * dy[best]]])
    moved = cv2.warpAffine(expected.astype(np.uint8), move, (width, height)) > 0
    covered = float((evidence[moved] > 0.0).mean()) if moved.any() else 0.0
    return moved, covered


def _against_surroundings(shape: Array32, band: int) -> Array32:
    """Return the template whose sum of products is the mean inside less a share of that around."""
    inner = cv2.copyMakeBorder(shape, band, band, band, band, cv2.BORDER_CONSTANT, value=0.0)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
    around = cv2.dilate(inner, disc) - inner
    template = inner / float(inner.sum()) - _BAND_COST * around / float(around.sum())
    return template.astype(np.float32)


def cut_within(
    work: Work, mask: Mask, allowed: Mask, evidence: Array32, config: RegionConfig
) -> Mask:
    """Return ``mask`` cut anew along the picture's edges, all of it ``allowed``."""
    ys, xs = np.nonzero(allowed)
    height, width = work.shape
    pad_x, pad_y = (int(0.2 * np.ptp(v)) + 6 for v in (xs, ys))
    left, right = max(xs.min() - pad_x, 0), min(xs.max() + pad_x + 1, width)
    top, bottom = max(ys.min() - pad_y, 0), min(ys.max() + pad_y + 1, height)
    part = np.s_[top:bottom, left:right]
    labels = np.where(mask[part], cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[~allowed[part]] = cv2.GC_BGD
    if (labels == cv2.GC_PR_FGD).sum() < 20 or (labels == cv2.GC_BGD).sum() < 20:
        return mask
    image = np.ascontiguousarray(work.image_bgr[part])
    back, front = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)  # GrabCut starts from k-means; the same picture must give the same mask.
    cv2.grabCut(image, labels, None, back, front, config.refine_iterations, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    cut = np.zeros(work.shape, bool)
    cut[part] = labels == cv2.GC_PR_FGD
    # A cut prefers short borders and so loses thin legs; what clearly is no floor stays.
    return cut | (mask & (evidence > SURE))
