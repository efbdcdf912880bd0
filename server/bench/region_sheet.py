"""A contact sheet of the pictures in which the search did worst."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from server.bench.region_course import Shot

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_COLUMNS, _ROWS = 4, 4
_TILE = (320, 240)


def worst_sheet(judged: Sequence[tuple[float, Shot, Array | None]]) -> Image:
    """Return the worst pictures, true box green, found box red.

    Args:
        judged: IoU, shot and found box ``(4,)``, full-picture pixels.
    """
    worst = sorted(judged, key=lambda row: row[0])[: _COLUMNS * _ROWS]
    sheet = np.zeros((_ROWS * _TILE[1], _COLUMNS * _TILE[0], 3), np.uint8)
    for k, (iou, shot, box) in enumerate(worst):
        tile = shot.image_bgr.copy()
        for each, colour in ((shot.truth_px, (0, 255, 0)), (box, (0, 0, 255))):
            if each is not None:
                left, top, right, bottom = (round(float(v)) for v in each)
                cv2.rectangle(tile, (left, top), (right, bottom), colour, 4)
        text = f"{iou:.2f} {shot.kind}"
        cv2.putText(tile, text, (20, 60), cv2.FONT_HERSHEY_SIMPLEX, 1.6, (255, 255, 255), 3)
        y, x = divmod(k, _COLUMNS)
        small = cv2.resize(tile, _TILE, interpolation=cv2.INTER_AREA)
        sheet[y * _TILE[1] : (y + 1) * _TILE[1], x * _TILE[0] : (x + 1) * _TILE[0]] = small
    return sheet
