"""An object that the operator pointed out: its colours and outline are taken from inside a box."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.blob import Blob
from server.vision.config import RegionConfig
from server.vision.cutting import cut_within, fitted_outline
from server.vision.found import Found
from server.vision.masks import Mask, keep_object, lab_bins, learn_colours, surroundings
from server.vision.work import Work

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

# The operator may be wrong in what is inside the box, hardly in where it is.
_POINTED_CONFIDENCE = 0.9
_LEAST_COVERED = 0.3
# How far the object may have moved since it was last seen, working pixels.
_LOST_SIGMA_PX = 10.0


class Pointed:
    """The object of a pointed-out box, and how to find it again.

    Attributes:
        found: What the box held in the first picture.
    """

    def __init__(self, work: Work, xyxy_px: Array, config: RegionConfig) -> None:
        """Learn the object.

        Args:
            work: The picture the box was drawn on, or the next one.
            xyxy_px: The box ``(4,)``, full-picture pixels.
            config: Settings.
        """
        height, width = work.shape
        box = (xyxy_px + 0.5) / work.scale
        left, top = (
            int(np.clip(np.floor(v), 0, n - 2))
            for v, n in zip(box[:2], (width, height), strict=True)
        )
        right, bottom = (
            int(np.clip(np.ceil(v), low + 2, n))
            for v, low, n in zip(box[2:], (left, top), (width, height), strict=True)
        )
        inside = np.zeros(work.shape, bool)
        inside[top:bottom, left:right] = True
        self._bins = config.histogram_bins
        self._model = self._learnt(work, inside)
        evidence = self._evidence(work)
        mask = cut_within(work, inside & (evidence > -0.3), inside, evidence, config)
        mask = keep_object(mask, (left + right) / 2.0, (top + bottom) / 2.0, float(right - left))
        # A cut that leaves less than a fifth of the box has found a part, not the object.
        if mask.sum() < 0.2 * inside.sum():
            mask = inside
        self._model = self._learnt(work, mask)
        self._place = work.prior.centre_px if work.surely_there else None
        self._mask = mask
        self.found = _found(mask, evidence)

    def search(self, work: Work, config: RegionConfig) -> Found | None:
        """Return the object in a later picture, None where its colours are not to be seen."""
        evidence = self._evidence(work)
        expected = self._mask
        if self._place is not None and work.surely_there:
            shift = (work.prior.centre_px - self._place) / work.scale
            if np.abs(shift).max() > max(work.shape):
                return None
            move = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
            size = (work.shape[1], work.shape[0])
            expected = cv2.warpAffine(expected.astype(np.uint8), move, size) > 0
            if not expected.any():
                return None
        shape, covered = fitted_outline(evidence, expected, _LOST_SIGMA_PX)
        if covered < _LEAST_COVERED:
            return None
        reach = 2 * round(0.08 * float(np.sqrt(shape.sum())) + 2) + 1
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
        allowed = cv2.dilate(shape.astype(np.uint8), kernel) > 0
        mask = cut_within(work, allowed & (evidence > -0.3), allowed, evidence, config)
        if not 0.5 * shape.sum() < mask.sum() < 1.6 * shape.sum():
            mask = shape
        self._mask = mask
        self._place = work.prior.centre_px if work.surely_there else None
        return _found(mask, evidence)

    def _learnt(self, work: Work, inside: Mask) -> NDArray[np.float32]:
        bins = lab_bins(work.image_bgr, self._bins)
        ring = surroundings(inside, 0.35 * float(np.sqrt(inside.sum())))
        model = learn_colours(bins, inside.astype(np.float32), ring.astype(np.float32), self._bins)
        return model.log_ratio

    def _evidence(self, work: Work) -> Array32:
        bins = lab_bins(work.image_bgr, self._bins)
        values = cv2.blur(self._model.ravel()[bins], (3, 3))
        return values.astype(np.float32, copy=False)


def _found(mask: Mask, evidence: Array32) -> Found:
    ys, xs = np.nonzero(mask)
    sigma = float(np.sqrt(len(xs) / (2.0 * np.pi)))
    blob = Blob(float(xs.mean()), float(ys.mean()), sigma, max(float(evidence[mask].mean()), 0.0))
    return Found(mask, blob, _POINTED_CONFIDENCE)
