"""The planner bench's picture: every plan's measures as bars, one column per measure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

_PLANS = (
    "random",
    "ring",
    "best_ring",
    "farthest",
    "greedy",
    "annealed",
    "annealed_from_boxes",
    "mission_plan",
    "everything",
)
_MEASURES = ("visibility", "detail_visibility", "visibility_two_views")
_ROW_PX, _COLUMN_PX, _LABEL_PX, _TOP_PX = 24, 300, 190, 50
_INK, _PALE, _STRONG = (30, 30, 30), (190, 170, 150), (60, 130, 220)


def save_picture(path: Path, title: str, figures: dict[str, Any]) -> None:
    """Write the bars of one scene: a block per K, a bar per plan; the mission's stands out."""
    block = _TOP_PX + _ROW_PX * len(_PLANS)
    width = _LABEL_PX + _COLUMN_PX * len(_MEASURES)
    picture = np.full((block * len(figures) + 20, width, 3), 255, np.uint8)
    for number, (key, part) in enumerate(figures.items()):
        _block(picture, number * block, f"{Path(title).name} {key}", part)
    cv2.imwrite(str(path), picture)


def _block(picture: NDArray[np.uint8], top: int, title: str, part: dict[str, Any]) -> None:
    _text(picture, title, 8, top + 20)
    for row, plan in enumerate(_PLANS):
        _text(picture, plan, 8, top + _TOP_PX + _ROW_PX * row + 14)
    for column, measure in enumerate(_MEASURES):
        left = _LABEL_PX + column * _COLUMN_PX
        _text(picture, measure, left, top + 20)
        values = part[measure]
        longest = max(v for v in values.values() if v is not None)
        for row, plan in enumerate(_PLANS):
            value = values[plan]
            if value is None:
                continue
            y = top + _TOP_PX + _ROW_PX * row
            length = round(value / max(longest, 1e-9) * (_COLUMN_PX - 80))
            colour = _STRONG if plan == "mission_plan" else _PALE
            cv2.rectangle(picture, (left, y), (left + length, y + 16), colour, -1)
            _text(picture, f"{value:.3f}", left + length + 4, y + 14)


def _text(picture: NDArray[np.uint8], text: str, x: int, y: int) -> None:
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
