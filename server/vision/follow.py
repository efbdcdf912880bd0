"""Following a mask from a key picture through the next ones by its own texture: cheap.

Corners inside the mask are tracked from the key picture itself, not from picture to picture, so
errors do not add up; a similarity (shift, turn, scale) through them carries the mask along.
All coordinates are working pixels.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.masks import Mask

Array32 = NDArray[np.float32]
Grey = NDArray[np.uint8]

_CORNERS, _LEAST_CORNERS = 40, 6
_FLOW_WINDOW = (13, 13)
_INLIER_PX = 1.5
_LEAST_SCALE, _MOST_SCALE = 0.7, 1.4


class Follower:
    """Carries one key picture's mask along."""

    def __init__(self, grey: Grey, mask: Mask) -> None:
        """Choose the corners.

        Args:
            grey: The key picture ``(h, w)``.
            mask: The object in it.
        """
        self._grey = grey
        self._mask = mask.astype(np.uint8)
        # A plain object has its corners on its outline, so that is not left out.
        corners = cv2.goodFeaturesToTrack(grey, _CORNERS, 0.02, 4, mask=self._mask)
        none = np.zeros((0, 1, 2), np.float32)
        self._corners = none if corners is None else corners.astype(np.float32)
        self._moved = self._corners.copy()

    def follow(self, grey: Grey) -> tuple[Mask, float] | None:
        """Return the mask in a later picture and the share of corners that agree.

        None when too few corners are found again: then a new key picture is needed.
        """
        if len(self._corners) < _LEAST_CORNERS:
            return None
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            self._grey,
            grey,
            self._corners,
            self._moved.copy(),
            winSize=_FLOW_WINDOW,
            maxLevel=2,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        good = status[:, 0] > 0
        if good.sum() < max(_LEAST_CORNERS, 0.4 * len(good)):
            return None
        matrix, inliers = cv2.estimateAffinePartial2D(
            self._corners[good], moved[good], ransacReprojThreshold=_INLIER_PX, maxIters=100
        )
        if matrix is None:
            return None
        share = float(inliers.sum()) / len(self._corners)
        scale = float(np.hypot(matrix[0, 0], matrix[0, 1]))
        if share < 0.4 or not _LEAST_SCALE < scale < _MOST_SCALE:
            return None
        # Corners that were lost keep their place relative to the others.
        self._moved = cv2.transform(self._corners, matrix).astype(np.float32)
        self._moved[good] = moved[good]
        size = (grey.shape[1], grey.shape[0])
        mask = cv2.warpAffine(self._mask, matrix, size, flags=cv2.INTER_NEAREST) > 0
        return (mask, share) if mask.any() else None
