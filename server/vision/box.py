"""The upright box around a region: OpenCV's ``boundingRect``, as in the paper.

Mask pixels are cells: cell ``i`` covers the full-picture pixels ``[i * s, (i + 1) * s)``, so with
pixel-centre coordinates its edges are ``i * s - 0.5`` and ``(i + 1) * s - 0.5``.
"""

from __future__ import annotations

import cv2
import numpy as np

from server.stages import Box, Region


def box_from_region(region: Region, width_px: int, height_px: int) -> Box:
    """Return the upright bounding rectangle of ``region`` in a picture of the given size.

    Raises:
        ValueError: If the region's mask is empty.
    """
    mask = region.mask.astype(np.uint8)
    if not mask.any():
        raise ValueError("box_from_region: the region's mask is empty")
    left, top, width, height = cv2.boundingRect(mask)
    rows, columns = mask.shape
    edges = np.array([left, top, left + width, top + height], float) * region.mask_scale - 0.5
    limits = np.array([width_px, height_px, width_px, height_px], float) - 0.5
    touches = left == 0 or top == 0 or left + width >= columns or top + height >= rows
    return Box(np.clip(edges, -0.5, limits), region.confidence, bool(touches))
