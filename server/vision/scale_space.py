"""The scale-normalised Laplacian of Gaussian and its maxima (equations 1-3).

Symbols: I the picture, sigma the scale in working pixels, g the one-dimensional Gaussian.
Equation 1 is minus the Laplacian of a Gaussian up to a constant factor, so bright blobs answer
positively; equation 2 multiplies by sigma^2, which makes answers of different scales comparable
(Lindeberg, "Feature detection with automatic scale selection", IJCV 1998):

    R(x, y; sigma) = -sigma^2 (g_xx + g_yy) * I

A disc of radius r answers most strongly at sigma = r / sqrt(2). Objects are brighter or darker than
what surrounds them, or differ in colour alone, so the magnitude over the Lab channels is searched:
|R| = sqrt(R_L^2 + w^2 (R_a^2 + R_b^2)), both signs at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.config import RegionConfig

Array32 = NDArray[np.float32]

# Beyond this sigma an octave is halved first: a kernel of six sigmas stays short and the result
# stays exact to a few per cent because the picture has no detail left at that scale.
_OCTAVE_SIGMA = 8.0


@dataclass(frozen=True, slots=True)
class Blob:
    """A maximum of the magnitude in space and scale.

    Attributes:
        x_px: Place along x, working pixels.
        y_px: Place along y, working pixels.
        sigma_px: Scale, working pixels.
        response: Magnitude there, Lab units.
    """

    x_px: float
    y_px: float
    sigma_px: float
    response: float


def lab_float(image_bgr: NDArray[np.uint8]) -> Array32:
    """Return the Lab picture ``(h, w, 3)``, L in 0..100, a and b around zero."""
    lab = cv2.cvtColor(image_bgr.astype(np.float32) / 255.0, cv2.COLOR_BGR2Lab)
    return lab.astype(np.float32, copy=False)


def scales(config: RegionConfig) -> Array32:
    """Return the geometric series of searched sigmas ``(n,)``, working pixels."""
    octaves = np.log2(config.sigma_max_px / config.sigma_min_px)
    count = int(np.ceil(octaves * config.scales_per_octave)) + 1
    return np.geomspace(config.sigma_min_px, config.sigma_max_px, count).astype(np.float32)


def log_kernels(sigma_px: float) -> tuple[Array32, Array32]:
    """Return the Gaussian g and sigma^2 g'' as one-dimensional kernels ``(k,)``.

    The second is corrected to sum to zero, so that a constant picture answers zero.
    """
    radius = int(np.ceil(4.0 * sigma_px))
    x = np.arange(-radius, radius + 1, dtype=np.float64)
    g = np.exp(-(x**2) / (2.0 * sigma_px**2))
    g /= g.sum()
    second = (x**2 / sigma_px**2 - 1.0) * g
    second -= g * second.sum()
    return g.astype(np.float32), second.astype(np.float32)


def log_response(channels: Array32, sigma_px: float) -> Array32:
    """Return R ``(h, w, c)`` of every channel at one scale (equation 2 applied to I)."""
    g, second = log_kernels(sigma_px)
    along_x = cv2.sepFilter2D(channels, cv2.CV_32F, second, g, borderType=cv2.BORDER_REFLECT)
    along_y = cv2.sepFilter2D(channels, cv2.CV_32F, g, second, borderType=cv2.BORDER_REFLECT)
    return -(along_x + along_y).astype(np.float32, copy=False)


def log_stack(channels: Array32, sigmas_px: Array32, chroma_weight: float = 1.0) -> Array32:
    """Return |R| ``(n, h, w)`` of a Lab picture ``(h, w, 3)`` for every sigma, working pixels.

    Large scales are filtered on halved pictures (one halving per octave) and enlarged again.
    """
    height, width = channels.shape[:2]
    weights = np.array([1.0, chroma_weight, chroma_weight], np.float32)
    stack = np.empty((len(sigmas_px), height, width), np.float32)
    octave, factor = channels * weights, 1.0
    for i, sigma in enumerate(np.asarray(sigmas_px, float)):
        while sigma / factor > _OCTAVE_SIGMA and min(octave.shape[:2]) >= 16:
            size = (octave.shape[1] // 2, octave.shape[0] // 2)
            halved = cv2.resize(octave, size, interpolation=cv2.INTER_AREA)
            octave = halved.astype(np.float32, copy=False)
            factor *= 2.0
        # Halving is itself a box blur of two pixels, variance (factor^2 - 1) / 12 in all.
        rest = np.sqrt(sigma**2 - (factor**2 - 1.0) / 12.0) / factor
        response = log_response(octave, float(rest)) * (sigma / (factor * rest)) ** 2
        magnitude = np.sqrt((response**2).sum(axis=2))
        if magnitude.shape != (height, width):
            magnitude = cv2.resize(magnitude, (width, height), interpolation=cv2.INTER_LINEAR)
        stack[i] = magnitude
    return stack


def evidence_stack(evidence: Array32, sigmas_px: Array32) -> Array32:
    """Return R ``(n, h, w)`` of one map ``(h, w)`` for every sigma; negative answers become zero.

    What stands out positively is sought here: an object surprises more than what surrounds it.
    """
    layers = [log_response(evidence, float(sigma)) for sigma in sigmas_px]
    return np.maximum(np.stack(layers), 0.0).astype(np.float32, copy=False)


def find_blobs(stack: Array32, sigmas_px: Array32, min_response: float) -> list[Blob]:
    """Return the maxima of ``stack`` ``(n, h, w)`` in space and scale, strongest first (eq. 3).

    The first and the last scale count as maxima too when nothing beyond them was searched: an
    object larger than the largest scale still answers there. Sigma is refined by a parabola in
    log sigma where both neighbours exist.
    """
    kernel = np.ones((3, 3), np.uint8)
    in_space = np.stack([cv2.dilate(layer, kernel) for layer in stack])
    blobs: list[Blob] = []
    log_sigma = np.log(np.asarray(sigmas_px, float))
    for i, layer in enumerate(stack):
        lower, upper = max(i - 1, 0), min(i + 1, len(stack) - 1)
        neighbourhood = in_space[lower : upper + 1].max(axis=0)
        ys, xs = np.nonzero((layer >= neighbourhood) & (layer >= min_response))
        for y, x in zip(ys.tolist(), xs.tolist(), strict=True):
            shift = 0.0
            if 0 < i < len(stack) - 1:
                before, here, after = (float(stack[j, y, x]) for j in (i - 1, i, i + 1))
                curvature = before - 2.0 * here + after
                shift = 0.5 * (before - after) / curvature if curvature < 0.0 else 0.0
            step = log_sigma[1] - log_sigma[0] if len(log_sigma) > 1 else 0.0
            sigma = float(np.exp(log_sigma[i] + np.clip(shift, -0.5, 0.5) * step))
            blobs.append(Blob(float(x), float(y), sigma, float(layer[y, x])))
    return sorted(blobs, key=lambda blob: -blob.response)
