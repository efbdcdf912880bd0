"""What the search of a key picture gives."""

from __future__ import annotations

from dataclasses import dataclass

from server.vision.blob import Blob
from server.vision.masks import Mask


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a key picture showed.

    Attributes:
        mask: The object ``(h, w)``.
        blob: The maximum in space and scale, working pixels.
        confidence: Probability that the mask's box fits the object's.
    """

    mask: Mask
    blob: Blob
    confidence: float
