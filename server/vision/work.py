"""A picture at working size with what every step of the search needs."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.config import RegionConfig
from server.vision.ground import Ground
from server.vision.masks import Mask, Window
from server.vision.prior import RegionPrior

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

# Shares of the picture's height for a camera of which nothing is known but that it looks at
# something on the floor: below the middle there is floor.
_FREE_SHARE, _FAR_SHARE, _NEAR_SHARE = 0.5, 0.52, 1.3
# Standard deviations by which the expected place may miss.
_FARTHEST = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """A picture at working size.

    Attributes:
        image_bgr: The picture ``(h, w, 3)``.
        lab: The same as 8-bit Lab.
        scale: Full-picture pixels per working pixel.
        prior: Where the object should be; full-picture pixels.
        surely_there: Whether ``prior`` says something of this picture.
    """

    image_bgr: Image
    lab: Image
    scale: float
    prior: RegionPrior
    surely_there: bool

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.image_bgr.shape[0], self.image_bgr.shape[1]

    @property
    def ground(self) -> Ground:
        """Rows of free floor and foot, full-picture pixels; a guess where nothing is known."""
        if self.prior.ground is not None:
            return self.prior.ground
        height = self.shape[0] * self.scale
        return Ground(_FREE_SHARE * height, _FAR_SHARE * height, _NEAR_SHARE * height)

    @property
    def centre(self) -> Array:
        """Expected centre ``(2,)``, working pixels."""
        return (self.prior.centre_px + 0.5) / self.scale - 0.5

    @property
    def sigma(self) -> float:
        """Standard deviation of it, working pixels."""
        return self.prior.sigma_px / self.scale

    def highest_row(self) -> int:
        """Return the row above which the object hardly reaches."""
        if self.prior.highest_px is None:
            return 0
        return int(np.clip(self.prior.highest_px / self.scale, 0, self.shape[0] - 1))

    def may_show_it(self) -> bool:
        """Return whether the object may be in the picture at all."""
        if not self.surely_there:
            return True
        half = np.zeros(2) if self.prior.size_px is None else 0.5 * self.prior.size_px / self.scale
        reach = _FARTHEST * self.sigma + half
        size = np.array([self.shape[1], self.shape[0]])
        return bool((self.centre > -reach).all() and (self.centre < size + reach).all())

    def known_window(self) -> Window | None:
        """Return the ellipse the object lies in, None while its size is unknown."""
        size = self.prior.size_px
        if size is None:
            return None
        # Corners of the box lie 1.41 half axes out; what is not known of the place comes on top.
        half = 0.75 * size / self.scale + self.sigma + 3.0
        return Window(float(self.centre[0]), float(self.centre[1]), float(half[0]), float(half[1]))

    def expected_mask(self) -> Mask | None:
        """Return the expected outline filled ``(h, w)``, None while the shape is unknown."""
        if not self.prior.outlines_px:
            return None
        mask = np.zeros(self.shape, np.uint8)
        for outline in self.prior.outlines_px:
            points = np.rint((outline + 0.5) / self.scale - 0.5).astype(np.int32)
            cv2.fillConvexPoly(mask, np.clip(points, -2000, 2000), 1)
        return mask > 0


def work_on(
    reduced_bgr: Image, width_px: int, config: RegionConfig, prior: RegionPrior | None
) -> Work:
    """Return the work on a reduced picture of one that is ``width_px`` wide."""
    scale = width_px / reduced_bgr.shape[1]
    lab = cv2.cvtColor(reduced_bgr, cv2.COLOR_BGR2Lab).astype(np.uint8, copy=False)
    if prior is not None:
        return Work(reduced_bgr, lab, scale, prior, True)
    size = np.array([reduced_bgr.shape[1], reduced_bgr.shape[0]], float) * scale
    nothing_known = RegionPrior((size - 1.0) / 2.0, config.prior_sigma_px * width_px)
    return Work(reduced_bgr, lab, scale, nothing_known, False)
