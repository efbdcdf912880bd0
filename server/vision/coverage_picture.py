"""A picture of what the views of a calibration reached."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from server.vision.calibration import Calibration
from server.vision.calibration_board import BoardView


def coverage_png(calibration: Calibration, views: Sequence[BoardView]) -> bytes:
    """Return a picture of the camera's size with every corner of the kept views, as a PNG file."""
    _, png = cv2.imencode(".png", _picture(calibration, views))
    return png.tobytes()


def _picture(calibration: Calibration, views: Sequence[BoardView]) -> NDArray[np.uint8]:
    intrinsics = calibration.intrinsics
    image = np.full((intrinsics.height, intrinsics.width, 3), 255, np.uint8)
    rows, columns = calibration.coverage.shape
    for row in range(rows):
        for column in range(columns):
            if not calibration.coverage[row, column]:
                left, right = (intrinsics.width * (column + k) // columns for k in (0, 1))
                top, bottom = (intrinsics.height * (row + k) // rows for k in (0, 1))
                image[top:bottom, left:right] = (200, 200, 255)
    kept = {name for name, _ in calibration.views}
    for view in views:
        if view.name in kept:
            for x, y in view.pixels:
                cv2.circle(image, (round(x), round(y)), 3, (160, 80, 0), -1, cv2.LINE_AA)
    return image
