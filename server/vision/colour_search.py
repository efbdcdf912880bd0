"""The search where no floor is known to lie around the object: equations 1-3 on the colours alone.

The largest region of |R| over the Lab channels, weighed with nearness to the expected place, is the
object; colours that differ from the surroundings' make its mask.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.blob import Blob
from server.vision.config import RegionConfig
from server.vision.masks import Mask, Window, first_guess, keep_object, lab_bins
from server.vision.pyramid import fast_blobs
from server.vision.work import Work

# How far an object's extent exceeds its blob's radius.
_WIDER, _TALLER = 2.0, 2.3
# A disc of radius r answers most strongly at r / sqrt(2); log sizes differ by about this much.
_LOG_SIZE_SIGMA = 0.6


def largest_colour_region(
    work: Work, config: RegionConfig
) -> tuple[Mask, Blob, NDArray[np.float32]] | None:
    """Return the largest region's mask, its maximum and the evidence ``(h, w)`` of its colours."""
    weights = np.array([100.0 / 255.0, config.chroma_weight, config.chroma_weight], np.float32)
    channels = work.lab.astype(np.float32) * weights
    blobs = fast_blobs(channels, config, config.min_response)[: config.candidates]
    if not blobs:
        return None
    blob = max(blobs, key=lambda each: _score(each, work, config))
    radius = float(np.sqrt(2.0) * blob.sigma_px)
    core = Window(blob.x_px, blob.y_px, radius, radius)
    window = work.known_window()
    if window is None:
        window = Window(blob.x_px, blob.y_px, _WIDER * radius, _TALLER * radius)
    bins = lab_bins(work.image_bgr, config.histogram_bins)
    mask, model = first_guess(bins, core, window, config.histogram_bins)
    mask = keep_object(mask, core.x_px, core.y_px, 0.7 * window.half_width_px)
    evidence = cv2.blur(model.ratio(bins), (3, 3)).astype(np.float32, copy=False)
    return (mask, blob, evidence) if mask.any() else None


def _score(blob: Blob, work: Work, config: RegionConfig) -> float:
    off = (np.array([blob.x_px, blob.y_px]) - work.centre) / work.sigma
    # A blob can sit on a part of the object, so the place is never held to better than its size.
    spread = 1.0 + (blob.sigma_px / work.sigma) ** 2
    score = blob.response * blob.sigma_px**config.size_exponent
    score *= float(np.exp(-0.5 * (off @ off) / spread))
    if work.prior.size_px is not None:
        expected = float(np.sqrt(np.prod(work.prior.size_px))) / work.scale / np.sqrt(8.0)
        score *= float(np.exp(-0.5 * (np.log(blob.sigma_px / expected) / _LOG_SIZE_SIGMA) ** 2))
    return score
