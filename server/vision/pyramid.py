"""The fast search for maxima in space and scale: differences of Gaussians over halved pictures.

Symbols: t = sigma^2 the variance of a Gaussian, L(t) the picture blurred by it, R equation 2's
answer. Blurring is diffusion, dL/dt = (g_xx + g_yy) * I / 2, so two blurred pictures give

    R(t) = -t (g_xx + g_yy) * I  =  -2 t (L(t2) - L(t1)) / (t2 - t1),   t = (t1 + t2) / 2

up to the third order of the step. Each scale is the middle of two neighbouring blurs; after an
octave the picture is halved. Maxima are interpolated in x, y and log sigma by parabolas, so that
their place is better than a pixel of the halved picture. ``server.vision.scale_space`` computes
the same without approximation and is the definition that the tests hold this to.

Coordinates given and returned are working pixels.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.blob import Blob, interpolated
from server.vision.config import RegionConfig

Array32 = NDArray[np.float32]

# The first octave is searched on the halved picture: its smallest sigma is some pixels there still.
_FIRST_FACTOR = 2
# What the mean over 2 x 2 pixels adds to the variance, square pixels of the finer picture.
_HALVING_VARIANCE = 0.25
_SEAM = np.float32(0.97)


def fast_blobs(channels: Array32, config: RegionConfig, min_response: float) -> list[Blob]:
    """Return the maxima of |R| in space and scale, strongest first.

    Args:
        channels: Weighted channels ``(h, w, c)``, float32: the magnitude over channels is searched.
            Of a single map ``(h, w)`` only positive answers count.
        config: The scales.
        min_response: Smallest answer that counts.
    """
    count = config.scales_per_octave
    ratio = 2.0 ** (2.0 / count)
    picture, variance, factor = _halved(channels), _HALVING_VARIANCE / 4.0, _FIRST_FACTOR
    sigma = config.sigma_min_px
    blobs: list[Blob] = []
    while sigma < config.sigma_max_px:
        # The octave's scales with one more below and above, as variances in this picture's pixels.
        middles = (sigma / factor) ** 2 * ratio ** np.arange(-1, count + 1)
        edges = np.append(middles, middles[-1] * ratio) * 2.0 / (1.0 + ratio)
        blurred = []
        for edge in edges:
            picture = _diffused(picture, float(edge) - variance)
            variance = float(edge)
            blurred.append(picture)
        stack = _answers(blurred, edges)
        is_last = 2.0 * sigma >= config.sigma_max_px
        # A Gaussian blob answers most strongly at the geometric mean of the two edges.
        sigmas = factor * (edges[:-1] * edges[1:]) ** 0.25
        is_first = factor == _FIRST_FACTOR
        low = 1 if is_first else 0
        ends = is_first, is_last
        blobs.extend(_maxima(stack[low:], sigmas[low:], factor, min_response, ends))
        # The next octave starts from the picture whose blur is still below its first edge.
        picture = _halved(blurred[count - 1])
        variance = (float(edges[count - 1]) + _HALVING_VARIANCE) / 4.0
        sigma, factor = 2.0 * sigma, 2 * factor
        if min(picture.shape[:2]) < 8:
            break
    height, width = channels.shape[:2]
    inside = [blob for blob in blobs if blob.x_px <= width - 1 and blob.y_px <= height - 1]
    return sorted(inside, key=lambda blob: -blob.response)


def _halved(picture: Array32) -> Array32:
    """Return the means over 2 x 2 pixels; odd edges are repeated so that cells stay aligned."""
    odd_rows, odd_columns = picture.shape[0] % 2, picture.shape[1] % 2
    if odd_rows or odd_columns:
        picture = cv2.copyMakeBorder(  # type: ignore[assignment]
            picture, 0, odd_rows, 0, odd_columns, cv2.BORDER_REPLICATE
        )
    size = (picture.shape[1] // 2, picture.shape[0] // 2)
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)


def _diffused(picture: Array32, variance: float) -> Array32:
    sigma = float(np.sqrt(variance))
    # Three sigmas suffice: the pictures are blurred again and again.
    size = 2 * int(np.ceil(3.0 * sigma)) + 1
    blurred = cv2.GaussianBlur(picture, (size, size), sigma, borderType=cv2.BORDER_REFLECT)
    return blurred.astype(np.float32, copy=False)


def _answers(blurred: list[Array32], edges: NDArray[np.float64]) -> Array32:
    """Return |R| ``(n, h, w)`` between ``n + 1`` blurred pictures."""
    layers = []
    for k, (fine, coarse) in enumerate(itertools.pairwise(blurred)):
        gain = (edges[k] + edges[k + 1]) / (edges[k + 1] - edges[k])
        answer = (fine - coarse) * np.float32(gain)
        if answer.ndim == 2:
            layers.append(np.maximum(answer, 0.0))
        else:
            ones = np.ones((1, answer.shape[2]), np.float32)
            layers.append(cv2.sqrt(cv2.transform(cv2.multiply(answer, answer), ones)))
    return np.stack(layers)


def _maxima(
    stack: Array32,
    sigmas_px: NDArray[np.float64],
    factor: int,
    min_response: float,
    ends: tuple[bool, bool],
) -> list[Blob]:
    """Return the maxima of an octave; its end scales count only where nothing lies beyond."""
    is_first, is_last = ends
    kernel = np.ones((3, 3), np.uint8)
    around = [cv2.dilate(layer, kernel) for layer in stack]
    blobs: list[Blob] = []
    for k in range(0 if is_first else 1, len(stack) if is_last else len(stack) - 1):
        # Two octaves sample the scales at their seam a little differently: neither may lose a
        # maximum to the other there.
        below = around[max(k - 1, 0)] * (_SEAM if k == 1 and not is_first else 1.0)
        highest = np.maximum(below, around[k])
        if k + 1 < len(stack):
            highest = np.maximum(highest, around[k + 1])
        layer = stack[k]
        rows, columns = np.nonzero((layer >= highest) & (layer >= min_response))
        for y, x in zip(rows.tolist(), columns.tolist(), strict=True):
            dx, dy, ds = interpolated(stack, k, y, x)
            sigma = float(sigmas_px[k] * (sigmas_px[1] / sigmas_px[0]) ** ds)
            place_x, place_y = (factor * (v + 0.5) - 0.5 for v in (x + dx, y + dy))
            blobs.append(Blob(place_x, place_y, sigma, float(layer[y, x])))
    return blobs
