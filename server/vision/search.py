"""The search of a key picture: from evidence against floor and wall to the object's mask.

Equations 1-3 are applied to the map of evidence: each maximum in space and scale proposes the
connected evidence around it, and the largest, most surprising one at the right place with its foot
on the floor is the object. A cut along the picture's edges gives its mask.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.background import floor_surprise, sharp_edges, surprise, threshold
from server.vision.blob import Blob
from server.vision.colour_search import largest_colour_region
from server.vision.confidence import clues, confidence
from server.vision.config import RegionConfig
from server.vision.cutting import cut_within, fitted_outline
from server.vision.found import Found
from server.vision.ground import foot_factor, foot_rows
from server.vision.masks import Mask, keep_object, lab_bins, learn_colours
from server.vision.pyramid import fast_blobs
from server.vision.work import Work

Array32 = NDArray[np.float32]

# Shares of floor and wall that may look like the object.
_FLOOR_SHARE, _WALL_SHARE = 0.05, 0.07
_BAND_ROWS, _BAND_MARGIN = 24, 6
# By which share of its base's width an object may jut out above it: with unknown colours, and with
# those of its base.
_OVERHANG = (0.25, 0.8)
_NECK_ROWS = 8
# Log ratio from which on a colour is the object's own.
_OWN = 1.0
# What evidence above the free floor counts, where the outline's place is looked for.
_BEHIND = 0.5
# Share of the expected outline that must be surprising.
_LEAST_COVERED = 0.2
# Working pixels: twice the rim of an expected outline that may be wrong, and the thinnest limb.
_RIM, _LIMB = 5, 3


def search(work: Work, config: RegionConfig) -> Found | None:
    """Return the object in a key picture, None when nothing stands out."""
    if not work.may_show_it():
        return None
    evidence, maybe, top = background_evidence(work)
    expected = work.expected_mask()
    if expected is not None and expected.sum() > 20:
        known = _search_known_shape(work, evidence, maybe, top, expected, config)
        if known is not None:
            return known
        # An outline that is much too large, because the camera is farther away than believed, may
        # hold too little to be trusted.
    found = _search_on_floor(work, evidence, maybe, top, config)
    if found is None and work.surely_there and work.prior.ground is None:
        # A camera that sees no floor.
        return _search_in_colours(work, config)
    return found


def _search_on_floor(
    work: Work, evidence: Array32, maybe: Mask, top: int, config: RegionConfig
) -> Found | None:
    """Return the largest region of what does not look like floor where only floor can be."""
    best = _largest_region(work, evidence, top, config)
    if best is None:
        return None
    mask, blob = best
    mask = _with_what_rises(mask, evidence, top, work, config)
    mask = _refined(mask, maybe, evidence, work, config)
    foot = foot_factor(mask, work.ground, work.scale)
    return Found(mask, blob, confidence(clues(mask, evidence, foot, work)))


def _search_in_colours(work: Work, config: RegionConfig) -> Found | None:
    """Return the largest region of the colours, for a camera that sees no floor."""
    largest = largest_colour_region(work, config)
    if largest is None:
        return None
    mask, blob, evidence = largest
    mask = _refined(mask, np.zeros_like(mask), evidence, work, config)
    if not mask.any():
        return None
    foot = foot_factor(mask, work.ground, work.scale)
    return Found(mask, blob, confidence(clues(mask, evidence, foot, work)))


def _search_known_shape(
    work: Work,
    evidence: Array32,
    maybe: Mask,
    top: int,
    expected: Mask,
    config: RegionConfig,
) -> Found | None:
    """Return the object where its expected outline, moved a little, covers most evidence."""
    feet = foot_rows(work.ground, work.shape, work.scale)
    # What is seen above the free floor may as well stand behind the object.
    weights = np.where(np.arange(len(evidence)) < top, _BEHIND, 1.0)[:, None]
    shape, share = fitted_outline(evidence * weights, expected, work.sigma, feet)
    if share < _LEAST_COVERED:
        return None
    size = float(np.sqrt(shape.sum()))
    reach = 2 * round(0.12 * size + 3) + 1
    allowed = (
        cv2.dilate(
            shape.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        )
        > 0
    )
    mask = shape & (evidence > -0.5) | allowed & (evidence > 0.0)
    mask = cut_within(work, mask, allowed, evidence, config)
    # Grey legs on a grey floor are known by their edges, where the outline has them.
    edges = shape & maybe & sharp_edges(work.lab)
    mask |= _touching(mask | edges, mask) & shape
    # A cut prefers short borders and so loses necks and arms; what the outline has, its uncertain
    # rim aside, stays unless it looks like background.
    inner = cv2.erode(_bytes(shape), np.ones((_RIM, _RIM), np.uint8)) > 0
    kernel = np.ones((_LIMB, _LIMB), np.uint8)
    mask |= cv2.morphologyEx(_bytes(inner & (evidence > 0.0)), cv2.MORPH_OPEN, kernel) > 0
    ys, xs = np.nonzero(shape)
    blob = Blob(float(xs.mean()), float(ys.mean()), size / float(np.sqrt(2.0 * np.pi)), share)
    mask = keep_object(mask, blob.x_px, blob.y_px, size)
    if mask.sum() < 0.25 * shape.sum():
        # The cut went astray; thin objects in a crude outline have little evidence, but have it.
        surprising = shape & (evidence > 0.0)
        mask = surprising if surprising.sum() > mask.sum() else mask
    foot = foot_factor(shape, work.ground, work.scale)
    return Found(mask, blob, confidence(clues(mask, evidence, foot, work)))


def background_evidence(work: Work) -> tuple[Array32, Mask, int]:
    """Return the evidence, what may be a shadow as well, and the row where free floor begins."""
    height, width = work.shape
    top = int(np.clip(work.ground.free_px / work.scale + 2.0, 0, height - 10))
    half = work.sigma
    if work.prior.size_px is not None:
        half = 0.6 * float(work.prior.size_px[0]) / work.scale
    across = ((np.arange(width) - work.centre[0]) / (work.sigma + half)) ** 2
    # Some weight stays everywhere: the object may not be where it is expected.
    away = (1.05 - np.exp(-0.5 * across)).astype(np.float32)
    weights = np.ascontiguousarray(np.broadcast_to(away, work.shape))
    evidence = np.empty(work.shape, np.float32)
    shaded, plain = floor_surprise(work.lab[top:], weights[top:])
    evidence[top:] = shaded - threshold(shaded, weights[top:], 1.0 - _FLOOR_SHARE)
    maybe = np.zeros(work.shape, bool)
    maybe[top:] = plain > threshold(plain, weights[top:], 1.0 - _FLOOR_SHARE)
    for start in range(0, top, _BAND_ROWS):
        end = min(start + _BAND_ROWS, top)
        first, last = max(start - _BAND_MARGIN, 0), min(end + _BAND_MARGIN, height)
        values = surprise(work.lab[first:last], weights[first:last])
        values -= threshold(values, weights[first:last], 1.0 - _WALL_SHARE)
        evidence[start:end] = values[start - first : end - first]
    return evidence, maybe, top


def _largest_region(
    work: Work, evidence: Array32, top: int, config: RegionConfig
) -> tuple[Mask, Blob] | None:
    """Return the best candidate on the free floor and the maximum that proposed it."""
    y, x = np.ogrid[: work.shape[0], : work.shape[1]]
    reach = work.sigma if work.prior.size_px is None else work.sigma + 4.0
    half = 0.0 if work.prior.size_px is None else 0.5 * work.prior.size_px[0] / work.scale
    near_place = np.exp(-0.25 * ((x - work.centre[0]) / (reach + half)) ** 2)
    strength = np.clip(evidence, 0.0, 3.0) * near_place
    strength[:top] = 0.0
    surprising = evidence > 0.0
    surprising[:top] = False
    window = work.known_window()
    if window is not None:
        surprising &= window.radius(work.shape) < 1.0
    surprising = (
        cv2.morphologyEx(surprising.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)) > 0
    )
    _, pieces = cv2.connectedComponents(_bytes(surprising))
    best: tuple[float, Mask, Blob] | None = None
    for blob in fast_blobs(strength.astype(np.float32), config, 0.1)[: config.candidates]:
        if best is not None and best[1][round(blob.y_px), round(blob.x_px)]:
            continue
        radius = np.sqrt(2.0) * blob.sigma_px
        near = (abs(x - blob.x_px) < 5.0 * radius + 8) & (abs(y - blob.y_px) < 5.0 * radius + 8)
        piece = pieces[round(blob.y_px), round(blob.x_px)]
        whole = surprising & (near | ((pieces == piece) & (piece > 0)))
        mask = keep_object(whole, blob.x_px, blob.y_px, radius)
        if mask.sum() < config.min_area_share * mask.size:
            continue
        score = _score(mask, evidence, work, config)
        if best is None or score > best[0]:
            best = score, mask, blob
    return None if best is None else (best[1], best[2])


def _score(mask: Mask, evidence: Array32, work: Work, config: RegionConfig) -> float:
    """Return size^k times evidence, less where place, foot or extent do not fit the object."""
    columns = np.nonzero(mask.any(axis=0))[0]
    width = float(columns[-1] - columns[0])
    reach = work.sigma + 0.25 * width
    off = (float(np.nonzero(mask)[1].mean()) - work.centre[0]) / reach
    score = float(mask.sum()) ** config.size_exponent * float(evidence[mask].mean())
    score *= foot_factor(mask, work.ground, work.scale) * float(np.exp(-0.5 * off * off))
    across_the_picture = columns[0] <= 1 and columns[-1] >= work.shape[1] - 2
    return 0.2 * score if across_the_picture else score


def _with_what_rises(
    mask: Mask, evidence: Array32, top: int, work: Work, config: RegionConfig
) -> Mask:
    """Return ``mask`` with what is connected to it above the free floor.

    What stands behind the object is seen above it, too. Colours that the object shows on the floor
    are its own wherever they are; others count only above its base.
    """
    ys = np.nonzero(mask.any(axis=1))[0]
    if ys.min() > top + 4 or top <= 4:
        return mask
    # The base may have a shadow around it; where it meets the free floor's end it has none.
    columns = np.nonzero(mask[ys.min() : ys.min() + _NECK_ROWS].any(axis=0))[0]
    width = float(columns[-1] - columns[0]) + 1.0
    x = np.arange(mask.shape[1])[None, :] + np.zeros((mask.shape[0], 1), int)
    above, beside = (
        (x >= columns[0] - share * width - 4) & (x <= columns[-1] + share * width + 4)
        for share in _OVERHANG
    )
    possible = evidence > 0.0
    possible[: work.highest_row()] = False
    # Lines between wall and floor are no part of anything.
    possible = cv2.morphologyEx(_bytes(possible), cv2.MORPH_OPEN, np.ones((3, 1), np.uint8)) > 0
    possible[top + 1 :] &= beside[top + 1 :]
    own = _own_colours(mask & (evidence > 0.7), beside, top, work, config)
    smooth = possible & beside & ~sharp_edges(work.lab)
    hangs_on = _touching(smooth | mask, mask)
    grown = mask | (possible & (above | (beside & (own | hangs_on))))
    return _touching(
        cv2.morphologyEx(_bytes(grown), cv2.MORPH_CLOSE, np.ones((5, 3), np.uint8)) > 0, mask
    )


def _own_colours(mask: Mask, beside: Mask, top: int, work: Work, config: RegionConfig) -> Mask:
    """Return where colours are those of the object's foot rather than of what is far beside it."""
    elsewhere = (~beside).astype(np.float32)
    elsewhere[top + 1 :] *= 0.3
    bins = lab_bins(work.image_bgr, config.histogram_bins)
    model = learn_colours(bins, mask.astype(np.float32), elsewhere, config.histogram_bins)
    return cv2.blur(model.ratio(bins), (3, 3)) > _OWN


def _touching(whole: Mask, part: Mask) -> Mask:
    """Return the pieces of ``whole`` that touch ``part``."""
    _, labels = cv2.connectedComponents(_bytes(whole))
    kept = np.unique(labels[part & whole])
    return np.isin(labels, kept[kept > 0])


def _bytes(mask: Mask) -> NDArray[np.uint8]:
    return mask.astype(np.uint8)


def _refined(mask: Mask, maybe: Mask, evidence: Array32, work: Work, config: RegionConfig) -> Mask:
    """Return ``mask`` cut anew along the picture's edges, not far from where it is."""
    window = work.known_window()
    if window is not None:
        mask = mask & (window.radius(work.shape) < 1.0)
        if not mask.any():
            return mask
    ys, xs = np.nonzero(mask)
    size = float(np.hypot(np.ptp(xs), np.ptp(ys)))
    allowed = _grown(mask, 0.06 * size + 2)
    # What is shadow or leg is left to the cut, where it hangs together with the mask.
    near = maybe & _grown(mask, 0.25 * size + 2)
    edges = _grown(sharp_edges(work.lab), 1)
    cut = cut_within(work, mask | (near & edges), allowed | near, evidence, config)
    middle_x, middle_y = (xs.min() + xs.max()) / 2.0, (ys.min() + ys.max()) / 2.0
    legs = (
        near
        & edges
        & cv2.morphologyEx(_bytes(maybe), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(bool)
    )
    cut |= _touching(cut | legs, cut)
    cut = keep_object(cut, middle_x, middle_y, size)
    kept = float((cut & mask).sum()) / max(float(mask.sum()), 1.0)
    return mask if kept < 0.5 else cut


def _grown(mask: Mask, reach: float) -> Mask:
    size = 2 * max(1, round(reach)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return cv2.dilate(mask.astype(np.uint8), kernel) > 0
