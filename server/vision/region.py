"""Finding the object in a drone's pictures: the largest region (equations 1-3) and its mask.

Key pictures are searched in full (``server.vision.search``): about one per second and drone, and
whenever the object was lost. In between its mask is followed by its own texture
(``server.vision.follow``), which costs a fortieth.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.stages import Box, Frame, Region
from server.vision.box import box_from_region
from server.vision.config import RegionConfig
from server.vision.follow import Follower, Grey
from server.vision.pointing import Pointed
from server.vision.prior import RegionPrior
from server.vision.search import Found, search
from server.vision.work import Work, work_on

__all__ = ["RegionPrior", "RegionTracker", "find_region", "full_mask", "region_of_mask"]

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

# Working pixels that a region is carried unseen between two pictures.
_FARTHEST_CARRIED = 20.0


def find_region(
    image_bgr: Image, config: RegionConfig, prior: RegionPrior | None = None
) -> Region | None:
    """Return the object's region in one picture, or None when nothing stands out.

    Args:
        image_bgr: ``(h, w, 3)`` uint8.
        config: Settings.
        prior: Where the object should be; None means around the picture's middle.
    """
    height, width = image_bgr.shape[:2]
    size = (width // config.work_scale, height // config.work_scale)
    reduced = cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    work = work_on(reduced, width, config, prior)
    found = search(work, config)
    return None if found is None else _accepted(found, work, config)


class RegionTracker:
    """Follows the object through one drone's pictures: a full search now and then, cheap between.

    The time of pictures decides when a full search is due, so what a recording shows is found
    again in the same pictures.
    """

    def __init__(self, config: RegionConfig, turn: float = 0.0) -> None:
        """Build it.

        Args:
            config: Settings.
            turn: When in each period of ``key_s`` the full search falls, 0 to 1. Several drones
                that take turns never search all in the same instant.
        """
        self._config = config
        self._turn = turn
        self._region: Region | None = None
        self._follower: Follower | None = None
        self._pointed: Pointed | None = None
        self._to_point: Array | None = None
        self._expected: RegionPrior | None = None
        self._searched_s = -np.inf

    def point_out(self, xyxy_px: Array | None) -> None:
        """Say where the object is in the next picture.

        Args:
            xyxy_px: Left, top, right, bottom ``(4,)``, full-picture pixels. The next update takes
                colours and outline from inside this box whatever the pose says, later ones follow
                it. None goes back to searching without help.

        Raises:
            ValueError: If the box is empty or not finite.
        """
        self._region = self._follower = self._pointed = self._to_point = None
        self._searched_s = -np.inf
        if xyxy_px is None:
            return
        box = np.asarray(xyxy_px, float)
        if box.shape != (4,) or not np.isfinite(box).all() or (box[2:] <= box[:2]).any():
            raise ValueError(f"xyxy_px must be left, top, right, bottom of a box, got {xyxy_px}")
        self._to_point = box

    def update(self, frame: Frame, expected: RegionPrior | None) -> tuple[Region, Box] | None:
        """Return region and box of ``frame``, or None when the object is not seen.

        Args:
            frame: The next picture of this tracker's drone.
            expected: Where the object should be by the drone's pose; None when that is unknown.
        """
        width, height = frame.size_px
        scale = self._config.work_scale
        reduced = frame.reduced_bgr(width // scale, height // scale)
        grey = cv2.cvtColor(reduced, cv2.COLOR_BGR2GRAY).astype(np.uint8, copy=False)
        region = self._followed(grey, frame.captured_s)
        if region is None and self._search_due(frame.captured_s):
            work = work_on(reduced, width, self._config, expected)
            region = self._searched(work, grey, frame.captured_s)
        elif region is None:
            region = self._carried(expected)
        self._region, self._expected = region, expected
        return None if region is None else (region, box_from_region(region, width, height))

    def _search_due(self, at_s: float) -> bool:
        """Return whether the budget allows a full search; while nothing is seen it is scarcer."""
        since_s = at_s - self._searched_s
        wait_s = self._config.retry_s if self._region is None else self._config.refollow_s
        # A clock that goes back is another recording's.
        return since_s < 0.0 or since_s >= wait_s

    def _key_due(self, at_s: float) -> bool:
        """Return whether a tracked object is to be searched anew: at this tracker's turn."""
        now, before = at_s / self._config.key_s, self._searched_s / self._config.key_s
        turns = np.floor(now - self._turn) > np.floor(before - self._turn)
        # Whoever searched out of turn, because it had lost the object, need not do so soon again.
        since = now - before
        return since < 0.0 or since >= 1.5 or bool(turns and since >= 0.5)

    def _carried(self, expected: RegionPrior | None) -> Region | None:
        """Return the last region where the pose says it moved to, for the moment until a search."""
        last = self._region
        if last is None:
            return None
        shift = np.zeros(2)
        if expected is not None and self._expected is not None:
            shift = (expected.centre_px - self._expected.centre_px) / last.mask_scale
        if np.abs(shift).max() > _FARTHEST_CARRIED:
            return None
        height, width = last.mask.shape
        move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        mask = cv2.warpAffine(last.mask.astype(np.uint8), move, (width, height)) > 0
        if not mask.any():
            return None
        # Nothing was seen of it in this picture.
        return region_of_mask(mask, last.response, 0.8 * last.confidence, last.mask_scale)

    def _followed(self, grey: Grey, at_s: float) -> Region | None:
        """Return the last region moved along; None when a full search is due or it is lost."""
        if self._follower is None or self._region is None:
            return None
        if self._key_due(at_s):
            return None
        moved = self._follower.follow(grey)
        if moved is None:
            return None
        mask, share = moved
        last = self._region
        return region_of_mask(
            mask, last.response, last.confidence * min(1.0, 0.5 + share), last.mask_scale
        )

    def _searched(self, work: Work, grey: Grey, at_s: float) -> Region | None:
        """Return the region of a key picture."""
        self._searched_s = at_s
        self._follower = None
        if self._to_point is not None:
            self._pointed = Pointed(work, self._to_point, self._config)
            self._to_point = None
            found: Found | None = self._pointed.found
        elif self._pointed is not None:
            found = self._pointed.search(work, self._config)
        else:
            found = search(work, self._config)
        region = None if found is None else _accepted(found, work, self._config)
        if region is not None:
            self._follower = Follower(grey, region.mask)
        return region


def _accepted(found: Found, work: Work, config: RegionConfig) -> Region | None:
    """Return the region of what was found, None when it is too small, too large or too unsure."""
    share = float(found.mask.mean())
    if not config.min_area_share <= share <= config.max_area_share:
        return None
    if found.confidence < config.min_confidence:
        return None
    region = region_of_mask(found.mask, found.blob.response, found.confidence, work.scale)
    maximum = (np.array([found.blob.x_px, found.blob.y_px]) + 0.5) * work.scale - 0.5
    return Region(
        maximum,
        found.blob.sigma_px * work.scale,
        region.response,
        region.mask,
        region.mask_scale,
        region.confidence,
    )


def region_of_mask(
    mask: NDArray[np.bool_], response: float, confidence: float, scale: float
) -> Region:
    """Return the region of a mask that is not empty; its maximum is taken to be its middle.

    Args:
        mask: ``(h / scale, w / scale)``, True on the object.
        response: Strength of its maximum.
        confidence: 0 to 1.
        scale: Full-picture pixels per mask pixel.
    """
    ys, xs = np.nonzero(mask)
    centre = (np.array([xs.mean(), ys.mean()]) + 0.5) * scale - 0.5
    # The sigma at which a disc of the mask's area answers most strongly.
    sigma = float(np.sqrt(len(xs) / np.pi) / np.sqrt(2.0)) * scale
    return Region(centre, sigma, response, mask, scale, confidence)


def full_mask(region: Region, width_px: int, height_px: int) -> NDArray[np.bool_]:
    """Return the mask of a region at the size of the full picture ``(height_px, width_px)``."""
    size = (width_px, height_px)
    return cv2.resize(region.mask.astype(np.float32), size, interpolation=cv2.INTER_LINEAR) >= 0.5
