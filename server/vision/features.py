"""Corners of the scene followed from picture to picture: what tells how a camera has moved.

Corners come from all over the picture, object and room; each keeps its number as long as it is
seen (Shi and Tomasi's corners, followed by Lucas and Kanade's pyramid, forth and back). A few
pictures a second are enough, and working size is.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.stages import Frame
from server.vision.config import FeatureConfig

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Grey = NDArray[np.uint8]

_QUALITY = 0.01
_WINDOW = (13, 13)
_LEVELS = 3
_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.03)
# Who does not come back to where it began, working pixels, was not found again.
_RETURN_PX = 0.4
# Corners this near to the edge, working pixels, leave the picture next.
_EDGE_PX = 3.0
_NONE = np.zeros((0, 2), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Where known corners are in one picture.

    Attributes:
        at_s: When the picture was taken.
        numbers: ``(n,)``, the same for a corner as long as it is followed, never used again.
        px: ``(n, 2)`` full-picture pixels.
    """

    at_s: float
    numbers: NDArray[np.int64]
    px: Array


class FeatureTracker:
    """Follows corners through the pictures of one camera."""

    def __init__(self, config: FeatureConfig) -> None:
        """Build it."""
        self._config = config
        self._grey: Grey | None = None
        self._px = _NONE
        self._numbers = np.zeros(0, np.int64)
        self._next = 0
        self._looked_s = -np.inf
        self._newest: Features | None = None

    def update(self, frame: Frame) -> Features | None:
        """Return the corners in ``frame``, or in an earlier picture when it comes too soon.

        Args:
            frame: The next picture, not damaged.
        """
        config = self._config
        if 0.0 <= frame.captured_s - self._looked_s < config.every_s:
            return self._newest
        self._looked_s = frame.captured_s
        width, height = frame.size_px
        size = (width // config.work_scale, height // config.work_scale)
        grey = cv2.cvtColor(frame.reduced_bgr(*size), cv2.COLOR_BGR2GRAY)
        grey = grey.astype(np.uint8, copy=False)
        self._follow(grey)
        if len(self._numbers) < config.fewest:
            self._find_more(grey)
        self._grey = grey
        scale = np.array([width, height]) / size
        px = (self._px.astype(float) + 0.5) * scale - 0.5
        self._newest = Features(frame.captured_s, self._numbers.copy(), px)
        return self._newest

    def _follow(self, grey: Grey) -> None:
        if self._grey is None or not len(self._numbers):
            return
        moved, found, _ = _flow(self._grey, grey, self._px)
        back, returned, _ = _flow(grey, self._grey, moved)
        size = np.array([grey.shape[1], grey.shape[0]])
        kept = (found & returned)[:, 0] > 0
        kept &= np.abs(back - self._px).max(axis=1) < _RETURN_PX
        kept &= ((moved > _EDGE_PX) & (moved < size - 1.0 - _EDGE_PX)).all(axis=1)
        self._px, self._numbers = moved[kept], self._numbers[kept]

    def _find_more(self, grey: Grey) -> None:
        """Choose new corners where none are followed."""
        config = self._config
        free = np.full(grey.shape, 255, np.uint8)
        for x, y in np.rint(self._px).astype(int).tolist():
            cv2.circle(free, (x, y), config.apart_px, 0, -1)
        wanted = config.most - len(self._numbers)
        corners = cv2.goodFeaturesToTrack(grey, wanted, _QUALITY, config.apart_px, mask=free)
        if corners is None:
            return
        new = corners.reshape(-1, 2).astype(np.float32)
        self._px = np.concatenate([self._px, new])
        self._numbers = np.append(self._numbers, np.arange(self._next, self._next + len(new)))
        self._next += len(new)


def _flow(first: Grey, second: Grey, px: Array32) -> tuple[Array32, NDArray[np.uint8], object]:
    moved, found, error = cv2.calcOpticalFlowPyrLK(
        first, second, px, np.empty_like(px), winSize=_WINDOW, maxLevel=_LEVELS, criteria=_STOP
    )
    return moved.astype(np.float32, copy=False), found.astype(np.uint8, copy=False), error
