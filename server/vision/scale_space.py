"""The scale-normalised Laplacian of Gaussian and its maxima (equations 1-3).

Symbols: I the picture, sigma the scale in working pixels, g the one-dimensional Gaussian.
Equation 1 is minus the Laplacian of a Gaussian up to a constant factor, so bright blobs answer
positively; equation 2 multiplies by sigma^2, which makes answers of different scales comparable
(Lindeberg, "Feature detection with automatic scale selection", IJCV 1998):

    R(x, y; sigma) = -sigma^2 (g_xx + g_yy) * I

A disc of radius r answers most strongly at sigma = r / sqrt(2). Objects are brighter or darker than
what surrounds them, or differ in colour alone, so the magnitude over the Lab channels is searched:
|R| = sqrt(R_L^2 + w^2 (R_a^2 + R_b^2)), both signs at once.

This is the definition, exact and slow. Pictures are searched by ``server.vision.pyramid``, which
the tests hold to it.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.blob import Blob, interpolated
from server.vision.config import RegionConfig

Array32 = NDArray[np.float32]


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

    Nothing is approximated.
    """
    weighted = channels * np.array([1.0, chroma_weight, chroma_weight], np.float32)
    layers = [log_response(weighted, float(sigma)) for sigma in np.asarray(sigmas_px, float)]
    return np.stack([np.sqrt((layer**2).sum(axis=2)) for layer in layers])


def find_blobs(stack: Array32, sigmas_px: Array32, min_response: float) -> list[Blob]:
    """Return the maxima of ``stack`` ``(n, h, w)`` in space and scale, strongest first (eq. 3).

    The first and the last scale count as maxima too when nothing beyond them was searched: an
    object larger than the largest scale still answers there. Place and log sigma are refined by
    parabolas where both neighbours exist. The sigmas are a geometric series.
    """
    kernel = np.ones((3, 3), np.uint8)
    in_space = np.stack([cv2.dilate(layer, kernel) for layer in stack])
    step = float(sigmas_px[1] / sigmas_px[0]) if len(sigmas_px) > 1 else 1.0
    blobs: list[Blob] = []
    for k, layer in enumerate(stack):
        highest = in_space[max(k - 1, 0) : k + 2].max(axis=0)
        ys, xs = np.nonzero((layer >= highest) & (layer >= min_response))
        for y, x in zip(ys.tolist(), xs.tolist(), strict=True):
            dx, dy, ds = interpolated(stack, k, y, x)
            sigma = float(sigmas_px[k]) * step**ds
            blobs.append(Blob(x + dx, y + dy, sigma, float(layer[y, x])))
    return sorted(blobs, key=lambda blob: -blob.response)
