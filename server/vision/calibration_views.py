"""Which views of a board are worth keeping for a calibration; see ``calibration``.

Tilts are angles between the board's plane and the picture's, in degrees: first about the picture's
vertical axis, then about its horizontal one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.vision.calibration_board import BoardView

Array = NDArray[np.float64]

GRID = (8, 6)
"""Cells across and down by which coverage of the picture is counted."""

Side = Literal["left", "right", "top", "bottom"]
Hint = Literal[
    "show_board",
    "hold_still",
    "blurred",
    "left",
    "right",
    "top",
    "bottom",
    "tilt_sideways",
    "tilt_up_down",
    "nearer",
    "another",
]
"""What whoever holds the board shall do next; a side: show it at that side of the picture."""

_SIDES: dict[Side, tuple[int, slice]] = {
    "left": (0, slice(0, 2)),
    "right": (0, slice(6, 8)),
    "top": (1, slice(0, 2)),
    "bottom": (1, slice(4, 6)),
}


@dataclass(frozen=True, slots=True)
class CalibrationConfig:
    """What views must offer.

    Attributes:
        views_least: Fewer views are refused, a number.
        coverage_least: Smallest share of grid cells with a corner in any view.
        tilt_deg: From this angle between board and picture plane on a view counts as tilted,
            degrees.
        tilted_least: Smallest number of tilted views about the vertical and about the
            horizontal axis, each.
        fx_sd_most: Largest standard deviation of the focal length, as a share of it.
        rms_px_most: Largest reprojection error over all views, root mean square, pixels.
        outlier_sigmas: A view whose error exceeds the median by so many robust standard
            deviations, and half as much again, is dropped.
        outlier_share: At most this share of the views is dropped.
        still_px: A hand-held board may move so far between two pictures, pixels.
        sharp_share: A view must reach this share of the best sharpness seen so far.
        distinct: Smallest difference of two views, see ``ViewPicker``, a pure number.
    """

    views_least: int = 10
    coverage_least: float = 0.6
    tilt_deg: float = 15.0
    tilted_least: int = 2
    fx_sd_most: float = 0.01
    rms_px_most: float = 1.5
    outlier_sigmas: float = 4.0
    outlier_share: float = 0.3
    still_px: float = 3.0
    sharp_share: float = 0.6
    distinct: float = 0.15

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value <= 0:
                raise ValueError(f"{item.name} must be positive, not {value!r}")
        for name in ("coverage_least", "outlier_share", "sharp_share"):
            if getattr(self, name) > 1.0:
                raise ValueError(f"{name} must be at most 1, not {getattr(self, name)!r}")
        if self.views_least < 3:
            raise ValueError(f"views_least must be at least 3, not {self.views_least!r}")


def coverage_of(views: Iterable[BoardView]) -> NDArray[np.int64]:
    """Return how many corners fell into each cell of the picture ``(6, 8)``."""
    across, down = GRID
    counts = np.zeros((down, across), np.int64)
    for view in views:
        shares = (view.pixels + 0.5) / (view.width, view.height)
        cells = np.clip((shares * GRID).astype(int), 0, (across - 1, down - 1))
        np.add.at(counts, (cells[:, 1], cells[:, 0]), 1)
    return counts


def missing_sides(coverage: NDArray[np.int64]) -> list[Side]:
    """Return the sides of the picture, ``left`` to ``bottom``, without any corner."""
    return [
        side
        for side, (axis, part) in _SIDES.items()
        if not (coverage[:, part] if axis == 0 else coverage[part, :]).any()
    ]


def tilt_deg(rotation: Array) -> tuple[float, float]:
    """Return how far a board is turned about the picture's vertical and horizontal axis."""
    normal = cv2.Rodrigues(rotation)[0][:, 2]
    # A board has no back that could be seen: either sign of the normal is the same tilt.
    x, y, z = normal if normal[2] > 0 else -normal
    return math.degrees(math.atan2(x, z)), math.degrees(math.atan2(y, z))


@dataclass(frozen=True, slots=True, eq=False)
class Picked:
    """What became of one picture of a live stream.

    Attributes:
        view: The view, when it was kept.
        hint: What to do next, for the person who holds the drone or the board.
    """

    view: BoardView | None
    hint: Hint


@dataclass(frozen=True, slots=True, eq=False)
class PickProgress:
    """How far a collection is.

    Attributes:
        views: Kept views, a number.
        coverage: How many of their corners fell into each cell ``(6, 8)`` of the picture.
        tilted: How many of them are tilted about the vertical and about the horizontal axis.
        tilted_wanted: How many of either are wanted.
    """

    views: int
    coverage: NDArray[np.int64]
    tilted: tuple[int, int]
    tilted_wanted: int


class ViewPicker:
    """Chooses sharp and distinct views from a live stream; values in, values out.

    A view is placed by five numbers of about the same scale: the board's middle across and down
    (shares of the picture), its size (square root of its area share) and its two tilts (radians).

    Attributes:
        views: The views kept so far.
    """

    def __init__(self, config: CalibrationConfig | None = None) -> None:
        self.views: list[BoardView] = []
        self._config = config if config is not None else CalibrationConfig()
        self._places: list[Array] = []
        self._before: BoardView | None = None
        self._best_sharpness = 0.0

    def consider(self, view: BoardView | None) -> Picked:
        """Take what the next picture shows; keep it when it adds something."""
        before, self._before = self._before, view
        if view is None:
            return Picked(None, "show_board")
        if before is None or not self._still(before, view):
            return Picked(None, "hold_still")
        self._best_sharpness = max(self._best_sharpness, view.sharpness)
        if view.sharpness < self._config.sharp_share * self._best_sharpness:
            return Picked(None, "blurred")
        place = _place(view)
        if any(np.linalg.norm(place - other) < self._config.distinct for other in self._places):
            return Picked(None, self.wanted())
        view = replace(view, name=view.name or f"view {len(self.views) + 1}")
        self.views.append(view)
        self._places.append(place)
        return Picked(view, self.wanted())

    def continued(self) -> ViewPicker:
        """Return one that begins with the same views; what still goes on with this is its own."""
        picker = ViewPicker(self._config)
        # A view comes before its place, should a thread be about to add one.
        picker._places = list(self._places)
        picker.views = self.views[: len(picker._places)]
        picker._best_sharpness = self._best_sharpness
        return picker

    def progress(self) -> PickProgress:
        """Return how far the collection is."""
        tilts = np.abs([place[3:] for place in self._places]).reshape(-1, 2)
        across, down = (tilts >= math.radians(self._config.tilt_deg)).sum(axis=0)
        return PickProgress(
            len(self.views),
            coverage_of(self.views),
            (int(across), int(down)),
            2 * self._config.tilted_least,
        )

    def wanted(self) -> Hint:
        """Return what would add most now."""
        now = self.progress()
        missing = missing_sides(now.coverage)
        if missing:
            return missing[0]
        across, down = now.tilted
        if across < now.tilted_wanted:
            return "tilt_sideways"
        if down < now.tilted_wanted:
            return "tilt_up_down"
        if float((now.coverage > 0).mean()) < self._config.coverage_least:
            return "nearer"
        return "another"

    def _still(self, before: BoardView, view: BoardView) -> bool:
        _, mine, other = np.intersect1d(view.ids, before.ids, return_indices=True)
        if len(mine) < 4:
            return False
        moved = np.linalg.norm(view.pixels[mine] - before.pixels[other], axis=1)
        return float(np.median(moved)) <= self._config.still_px


def _place(view: BoardView) -> Array:
    nominal = TELLO_INTRINSICS.scaled(view.width / TELLO_INTRINSICS.width)
    _, rotation, _ = cv2.solvePnP(view.points_board, view.pixels, nominal.K, np.zeros(5))
    middle = view.pixels.mean(axis=0) / (view.width, view.height)
    hull = cv2.convexHull(view.pixels.astype(np.float32))
    size = math.sqrt(cv2.contourArea(hull) / (view.width * view.height))
    tilts = np.radians(tilt_deg(np.asarray(rotation, float).ravel()))
    return np.array([*middle, size, *tilts])
