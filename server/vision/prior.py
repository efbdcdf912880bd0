"""What is known of the object's place in a picture before it is searched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.vision.ground import Ground

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RegionPrior:
    """Where the object should be in the picture.

    Attributes:
        centre_px: ``(2,)`` expected x, y of its centre, full-picture pixels; may lie outside.
        sigma_px: Standard deviation of that, full-picture pixels.
        size_px: ``(2,)`` expected width and height of its box, or None when not yet known.
        ground: Where free floor is and where the object's foot can be, None when unknown.
        outlines_px: Expected outlines of the object's parts, each ``(k, 2)`` convex, full-picture
            pixels; empty while its shape is unknown.
        highest_px: Row above which it hardly reaches, full-picture pixels; None when unknown.
    """

    centre_px: Array
    sigma_px: float
    size_px: Array | None = None
    ground: Ground | None = None
    outlines_px: tuple[Array, ...] = ()
    highest_px: float | None = None
