"""From a blob to a mask: colour models and connected pieces.

A blob says where and how large; the mask says which pixels. Pixels are told apart by how much more
probable their colour is on the object than in its surroundings (log ratio of two smoothed Lab
histograms) and by where they lie. All coordinates are working pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Image = NDArray[np.uint8]
Array32 = NDArray[np.float32]

# A colour never seen on either side says nothing: both histograms keep this share of evenness.
_EVEN_SHARE = 0.05
_RATIO_LIMIT = 4.0


@dataclass(frozen=True, slots=True)
class Window:
    """An upright ellipse that should hold the object.

    Attributes:
        x_px: Centre.
        y_px: Centre.
        half_width_px: Half axis along x.
        half_height_px: Half axis along y.
    """

    x_px: float
    y_px: float
    half_width_px: float
    half_height_px: float

    def radius(self, shape: tuple[int, int]) -> Array32:
        """Return ``(h, w)``: 0 at the centre, 1 on the ellipse, growing linearly."""
        y, x = np.ogrid[: shape[0], : shape[1]]
        u = (x - self.x_px) / self.half_width_px
        v = (y - self.y_px) / self.half_height_px
        return np.sqrt(u * u + v * v).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class ColourModel:
    """How much a colour speaks for the object.

    Attributes:
        log_ratio: ``(b, b, b)`` log of P(colour | object) / P(colour | surroundings), limited to
            +-4, over the bins of Lab.
        separation: 0 when object and surroundings share all their colours, 1 when they share none
            (one minus the overlap of the two histograms).
    """

    log_ratio: Array32
    separation: float

    def ratio(self, bins_lab: NDArray[np.intp]) -> Array32:
        """Return the log ratio ``(h, w)`` of a picture of bin numbers."""
        return self.log_ratio.ravel()[bins_lab]


def lab_bins(image_bgr: Image, bins: int) -> NDArray[np.intp]:
    """Return every pixel's flat bin number ``(h, w)`` in a ``bins``^3 Lab histogram.

    a and b rarely leave the middle half of their range indoors, so their bins cover that half only.
    """
    lab = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2Lab)
    L = lab[..., 0].astype(np.int32) * bins // 256
    a = np.clip((lab[..., 1].astype(np.int32) - 64) * bins // 128, 0, bins - 1)
    b = np.clip((lab[..., 2].astype(np.int32) - 64) * bins // 128, 0, bins - 1)
    return ((L * bins + a) * bins + b).astype(np.intp)


def colour_histogram(bins_lab: NDArray[np.intp], weights: Array32, bins: int) -> Array32:
    """Return the smoothed, normalised Lab histogram ``(b, b, b)`` of weighted pixels."""
    counts = np.bincount(bins_lab.ravel(), weights=weights.ravel(), minlength=bins**3)
    cube = counts.reshape(bins, bins, bins).astype(np.float32)
    for axis in range(3):  # A [1 2 1] / 4 blur along each axis: neighbouring colours are alike.
        padded = np.pad(cube, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
        low, middle, high = (np.take(padded, range(k, k + bins), axis=axis) for k in (0, 1, 2))
        cube = (low + 2.0 * middle + high) / 4.0
    return cube / max(float(cube.sum()), 1e-9)


def learn_colours(
    bins_lab: NDArray[np.intp], inside: Array32, outside: Array32, bins: int
) -> ColourModel:
    """Return the colour model from weights ``(h, w)`` of object and of surroundings."""
    on, off = colour_histogram(bins_lab, inside, bins), colour_histogram(bins_lab, outside, bins)
    separation = 1.0 - float(np.minimum(on, off).sum())
    # Evenness over the colours in use, not over the cube: most of Lab never occurs.
    used = (on > 1e-6) | (off > 1e-6)
    even = _EVEN_SHARE / max(int(used.sum()), 1)
    log_ratio = np.log((on + even) / (off + even))
    return ColourModel(np.clip(log_ratio, -_RATIO_LIMIT, _RATIO_LIMIT), separation)


def surroundings(inside: Mask, width_px: float) -> Mask:
    """Return the ring of about ``width_px`` around ``inside``, with a small gap for soft edges."""
    gap = cv2.dilate(inside.astype(np.uint8), np.ones((5, 5), np.uint8))
    size = 2 * max(3, round(width_px)) + 1
    wide = cv2.boxFilter(gap, cv2.CV_32F, (size, size), normalize=False) > 0.5
    return wide & (gap == 0)


def first_guess(
    bins_lab: NDArray[np.intp], core: Window, window: Window, bins: int
) -> tuple[Mask, ColourModel]:
    """Return a mask and colours from a blob's ``core`` and the ``window`` the object may fill.

    Colours outside the window are the surroundings; what inside it does not look like them, and
    lies towards the middle, is the object.
    """
    shape = (bins_lab.shape[0], bins_lab.shape[1])
    r_core, r_window = core.radius(shape), window.radius(shape)
    inside = np.exp(-2.0 * r_core**2) + 0.15 * (r_window < 1.0)
    outside = ((r_window > 1.0) * np.exp(-0.5 * (r_window - 1.0) ** 2)).astype(np.float32)
    model = learn_colours(bins_lab, inside.astype(np.float32), outside, bins)
    evidence = cv2.blur(model.ratio(bins_lab), (3, 3))
    place = 1.2 - 2.2 * r_window**2
    mask = (evidence + place > 0.0) & (r_window < 1.0)
    if not mask.any():
        mask = r_core < 1.0
    return mask, model


def keep_object(mask: Mask, x_px: float, y_px: float, reach_px: float) -> Mask:
    """Return the component of ``mask`` nearest the expected place, with pieces close to it.

    A component counts by its area, discounted by its distance from (``x_px``, ``y_px``) in units
    of ``reach_px``. Other pieces of at least 4 % of its area within a fifth of its size stay: thin
    joints are often lost at working size. Holes smaller than 2 % of it are filled.
    """
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count < 2:
        return mask
    areas = stats[1:, cv2.CC_STAT_AREA].astype(float)
    offsets = (centroids[1:] - (x_px, y_px)) / reach_px
    main = 1 + int(np.argmax(areas * np.exp(-0.5 * (offsets**2).sum(axis=1))))
    keep = labels == main
    left, top, width, height = stats[main, :4].astype(float)
    near_x, near_y = 0.2 * width + 2.0, 0.2 * height + 2.0
    for k in range(1, count):
        l_k, t_k, w_k, h_k = stats[k, :4].astype(float)
        apart_x = max(left - (l_k + w_k), l_k - (left + width))
        apart_y = max(top - (t_k + h_k), t_k - (top + height))
        large = areas[k - 1] >= 0.04 * areas[main - 1]
        if k != main and large and apart_x < near_x and apart_y < near_y:
            keep |= labels == k
    return _fill_small_holes(keep, 0.02 * float(keep.sum()))


def _fill_small_holes(mask: Mask, limit_px: float) -> Mask:
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        (~mask).astype(np.uint8), connectivity=4
    )
    small = np.zeros(count, bool)
    small[1:] = stats[1:, cv2.CC_STAT_AREA] < limit_px
    return mask | small[np.asarray(labels, np.intp)]
