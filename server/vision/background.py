"""How little a pixel looks like the floor, or the wall, that other columns show in the same rows.

Floor and wall run from side to side through the picture; the object fills some columns of it. So a
colour belongs to the background when many columns show it in rows nearby, and to the object when
few do: with p_k the colour's share in block k of columns, its surprise is

    s = - sum_k w_k log p_k / sum_k w_k

(minus the log of a geometric mean, so that blocks without the colour count heavily), less the
surprise that almost all of the background stays below. w_k is small where the object is expected.
The floor's slow change of light is taken off before by a plane that is fitted robustly.

All rows, columns and masks are working pixels; Lab is OpenCV's 8-bit form. Surprise is in nats.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]
Image = NDArray[np.uint8]

_BLOCKS = 12
# Bins of lightness and of the two colour axes, and their widths in 8-bit Lab levels.
_BINS = (24, 16, 16)
_WIDTHS = (8.0, 4.0, 4.0)
# A colour that a block never shows counts as this probable there.
_LEAST = 1e-3
_FIT_ROUNDS = 3
_LEAST_SHARE, _MIDWAY = 0.25, 0.5
# What a shadow's every bin of darkness costs, nats.
_SHADOW_COST = 0.3
# From which bins of darkness on its colour may be one bin further off.
_PALER_FROM = (2, 5)
# A shadow takes at most this share of the lightness.
_DARKEST_SHADOW = 0.4
# Edges are sharp from this many levels and times the usual slope on.
_SHARP_LEVELS, _SHARP_FACTOR = 12.0, 2.0


def levelled(lab: Image, weights: Array32) -> Array32:
    """Return Lab less a robust plane of each channel through the weighted pixels ``(h, w, 3)``.

    Args:
        lab: 8-bit Lab pixels ``(h, w, 3)``.
        weights: How surely each is background ``(h, w)``.
    """
    height, width = lab.shape[:2]
    step = 3  # A ninth of the pixels gives the same plane.
    part = lab[::step, ::step].astype(np.float32)
    y, x = np.mgrid[0:height:step, 0:width:step].astype(np.float32)
    terms = np.stack([np.ones_like(x), x / width - 0.5, y / height - 0.5], axis=2).reshape(-1, 3)
    values, base = part.reshape(-1, 3), weights[::step, ::step].reshape(-1)
    w, plane = base, np.zeros((3, 3), np.float32)
    for _ in range(_FIT_ROUNDS):
        weighted = terms * w[:, None]
        plane = np.linalg.solve(weighted.T @ terms + 1e-3 * np.eye(3), weighted.T @ values)
        miss = np.abs(values - terms @ plane).sum(axis=1)
        scale = max(float(np.median(miss[base > 0.3])) if (base > 0.3).any() else 1.0, 4.0)
        w = base / (1.0 + (miss / scale) ** 2)
    ys = (np.arange(height, dtype=np.float32) / height - 0.5)[:, None, None]
    xs = (np.arange(width, dtype=np.float32) / width - 0.5)[None, :, None]
    return (lab - (plane[0] + xs * plane[1] + ys * plane[2])).astype(np.float32)


def colour_bins(levelled_lab: Array32) -> NDArray[np.int32]:
    """Return every pixel's flat bin ``(h, w)``."""
    flat = np.zeros(levelled_lab.shape[:2], np.int32)
    for axis, (bins, width) in enumerate(zip(_BINS, _WIDTHS, strict=True)):
        number = np.floor(levelled_lab[..., axis] / width).astype(np.int32) + bins // 2
        flat = flat * bins + np.clip(number, 0, bins - 1)
    return flat


def surprise(lab: Image, weights: Array32) -> Array32:
    """Return how little each pixel looks like the other columns' ``(h, w)``, nats.

    Args:
        lab: 8-bit Lab of some rows ``(h, w, 3)``.
        weights: How surely each pixel is background ``(h, w)``; above zero in some columns.
    """
    bins, log_share = _columns_agree(lab, weights)
    return _looked_up(log_share, bins)


def floor_surprise(lab: Image, weights: Array32) -> tuple[Array32, Array32]:
    """Return the same for a floor, first with a shadow counted as floor, then without.

    A shadow keeps the colour and takes lightness. So do dark grey legs: the two maps differ where
    only edges can tell.
    """
    bins, log_share = _columns_agree(lab, weights)
    plain = _looked_up(log_share, bins)
    darkest = round(_DARKEST_SHADOW * float(np.median(lab[..., 0])) / _WIDTHS[0])
    if darkest < 1:
        return plain, plain
    return _looked_up(_with_shadows(log_share, darkest), bins), plain


def sharp_edges(lab: Image) -> NDArray[np.bool_]:
    """Return where lightness changes sharply ``(h, w)``; a shadow's edge is soft."""
    lightness = lab[..., 0]
    slope = cv2.morphologyEx(lightness, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    return slope > _SHARP_FACTOR * float(np.median(slope)) + _SHARP_LEVELS


def _columns_agree(lab: Image, weights: Array32) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return every pixel's bin and each bin's log share, averaged over the blocks of columns."""
    bins = colour_bins(levelled(lab, weights))
    width = lab.shape[1]
    size = int(np.prod(_BINS))
    block = np.minimum(np.arange(width) * _BLOCKS // width, _BLOCKS - 1)
    counts = np.bincount(
        (block[None, :] * size + bins).ravel(), weights=weights.ravel(), minlength=_BLOCKS * size
    ).reshape(_BLOCKS, *_BINS)
    total, mean = 0.0, np.zeros(_BINS)
    for k in range(_BLOCKS):
        weight = float(weights[:, block == k].mean())
        if weight < 0.02:
            continue
        share = _smoothed(counts[k])
        mean += weight * np.log(share / share.sum() + _LEAST)
        total += weight
    return bins, mean / max(total, 1e-9)


def _looked_up(log_share: NDArray[np.float64], bins: NDArray[np.int32]) -> Array32:
    values = (-log_share).astype(np.float32).ravel()[bins]
    return cv2.blur(values, (3, 3)).astype(np.float32, copy=False)


def _with_shadows(log_share: NDArray[np.float64], darkest: int) -> NDArray[np.float64]:
    """Return the log shares with those of darker bins raised to what casts of shadow make of them.

    A shadow keeps the hue and takes lightness, and with it some colour; the darker, the less
    probable.
    """
    raised, paler = log_share.copy(), log_share
    for step in range(1, darkest + 1):
        if step in _PALER_FROM:
            paler = _spread_in_colour(paler)
        lighter = paler[step:] - _SHADOW_COST * step
        np.maximum(raised[:-step], lighter, out=raised[:-step])
    return raised


def _spread_in_colour(log_share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return every bin's highest value among it and its neighbours in a and b."""
    out = log_share.copy()
    for axis in (1, 2):
        moved, source = np.moveaxis(out, axis, 0), np.moveaxis(out, axis, 0).copy()
        np.maximum(moved[1:], source[:-1], out=moved[1:])
        np.maximum(moved[:-1], source[1:], out=moved[:-1])
    return out


def _smoothed(cube: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a histogram blurred by [1 2 1] / 4 along each axis: neighbouring colours are alike."""
    for axis in range(cube.ndim):
        moved = np.moveaxis(cube, axis, 0)
        blurred = 0.5 * moved
        blurred[1:] += 0.25 * moved[:-1]
        blurred[:-1] += 0.25 * moved[1:]
        cube = np.moveaxis(blurred, 0, axis)
    return cube


def threshold(values: Array32, weights: Array32, share: float) -> float:
    """Return the surprise from which on a pixel is hardly background.

    It is what ``share`` of the weighted pixels stay below, but at most half way from the median to
    the surprise of a colour that no column shows: an object that stands where background is
    expected must not count as a background of many colours. On an even floor it is a quarter of
    that way at least.
    """
    order = np.argsort(values, axis=None)
    mass = np.cumsum(weights.ravel()[order])
    places = np.searchsorted(mass, np.array([0.5, share]) * mass[-1])
    median, upper = (float(values.ravel()[order[int(place)]]) for place in places)
    room = -float(np.log(_LEAST)) - median
    return float(np.clip(upper, median + _LEAST_SHARE * room, median + _MIDWAY * room))
