"""A maximum in space and scale, and where between the samples it lies."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array32 = NDArray[np.float32]


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


def parabola_peak(before: float, here: float, after: float) -> float:
    """Return where three equidistant samples of a bell peak, from the middle one, -0.5 to 0.5.

    The logarithm of a bell is nearly a parabola, the bell itself is not.
    """
    low, middle, high = (math.log(max(v, 1e-6)) for v in (before, here, after))
    curvature = low - 2.0 * middle + high
    if curvature >= 0.0:
        return 0.0
    return max(-0.5, min(0.5, 0.5 * (low - high) / curvature))


def interpolated(stack: Array32, k: int, y: int, x: int) -> tuple[float, float, float]:
    """Return offsets of the maximum at a sample in x, y (samples) and scale (steps)."""
    layer = stack[k]
    here = float(layer[y, x])
    dx = dy = ds = 0.0
    if 0 < x < layer.shape[1] - 1:
        dx = parabola_peak(float(layer[y, x - 1]), here, float(layer[y, x + 1]))
    if 0 < y < layer.shape[0] - 1:
        dy = parabola_peak(float(layer[y - 1, x]), here, float(layer[y + 1, x]))
    if 0 < k < len(stack) - 1:
        ds = parabola_peak(float(stack[k - 1, y, x]), here, float(stack[k + 1, y, x]))
    return dx, dy, ds
