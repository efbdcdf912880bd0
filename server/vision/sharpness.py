"""How sharp a picture is, as one number to compare it with others of the same scene."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

# So small a picture still shows what smears it, and little of its noise.
_REDUCTION = 4


def sharpness(image_bgr: NDArray[np.uint8]) -> float:
    """Return the variance of the Laplacian (Pech-Pacheco et al. 2000) of the small grey picture."""
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    size = (max(1, width // _REDUCTION), max(1, height // _REDUCTION))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(small, cv2.CV_32F).var())
