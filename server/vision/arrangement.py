"""Whether four drones stand around the object in the order that was assumed, by its outlines.

A drone that looks at the object sees it straight ahead wherever on the circle it stands, so places
that were mixed up contradict no bearing. They contradict the outlines: of all orders only the true
one lets one body fill every outline. Each order is tried: the cells of a cube that all outlines
hold make the largest such body, and an order counts by the share of the outlines it fills. What
looks alike from all sides tells nothing, and then nothing is said.

Turning all drones about the object by the same angle changes nothing but the world's zero of
azimuth: one drone keeps its place.

Symbols: ``u``, ``v`` metres right and down of the object's centre in a picture, at its depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from server.stages import View
from server.vision.config import ArrangementConfig

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Arrangement:
    """One order of the drones around the object.

    Attributes:
        places: Per view, the view at whose believed azimuth it stands.
        filled: Share of the outlines that one body can fill, 0 to 1.
    """

    places: tuple[int, ...]
    filled: float

    @property
    def is_believed(self) -> bool:
        """True when every drone stands where it was assumed to stand."""
        return self.places == tuple(range(len(self.places)))


def better_arrangements(
    tried: Sequence[Arrangement], config: ArrangementConfig
) -> list[Arrangement]:
    """Return the orders that the outlines speak for, best first; none while nothing speaks for any.

    An object that is narrow from two sides tells who stands opposite whom, but hardly the order
    from its mirror image: then both are returned.

    Args:
        tried: All of ``arrangements``.
        config: Settings.
    """
    ranked = sorted(tried, key=lambda each: -each.filled)
    believed = next((each for each in ranked if each.is_believed), None)
    if believed is None or ranked[0].filled - believed.filled < config.least_gain:
        return []
    return [each for each in ranked if each.filled >= ranked[0].filled - config.tie]


def arrangements(
    views: Sequence[View], centre: Array, config: ArrangementConfig
) -> list[Arrangement]:
    """Return every order that keeps the first drone's place; none without four whole views."""
    if len(views) != 4 or any(view.box.touches_edge for view in views):
        return []
    outlines = [_Outline(view, centre, config) for view in views]
    turns = np.sort([outline.azimuth_rad for outline in outlines])
    if np.diff(turns, append=turns[0] + 2.0 * np.pi).min() < config.spread_rad:
        return []
    size_m = max(outline.size_m for outline in outlines)
    steps = (np.arange(config.cells) + 0.5) / config.cells - 0.5
    cells = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    cells *= config.cube * size_m
    azimuths = [outline.azimuth_rad for outline in outlines]
    # Where the cells lie in each outline does not depend on where the other drones stand.
    places = [[outline.cells_at(cells, azimuth) for azimuth in azimuths] for outline in outlines]
    found: list[Arrangement] = []
    for others in permutations(range(1, len(views))):
        order = (0, *others)
        inside = np.ones(len(cells), bool)
        for k, place in enumerate(order):
            inside &= outlines[k].holds(places[k][place])
        filled = [outlines[k].filled_by(places[k][p][inside]) for k, p in enumerate(order)]
        found.append(Arrangement(order, float(np.mean(filled))))
    return found


class _Outline:
    """One view's outline in metres about the object's centre.

    Attributes:
        azimuth_rad: Believed azimuth of its camera about the centre.
        size_m: Larger side of its box.
    """

    def __init__(self, view: View, centre: Array, config: ArrangementConfig) -> None:
        offset = view.pose.position_world - centre
        self.azimuth_rad = float(np.arctan2(offset[1], offset[0]))
        self._reach_m = float(np.linalg.norm(offset))
        self._level = float(np.hypot(*offset[:2])) / self._reach_m
        self._sink = float(offset[2]) / self._reach_m
        self._metres_per_px = self._reach_m / view.intrinsics.fx
        self.size_m = float(view.box.size_px.max()) * self._metres_per_px
        mask, scale = view.region.mask, view.region.mask_scale
        left, top, right, bottom = view.box.xyxy_px / scale
        x = left + (np.arange(config.grid) + 0.5) / config.grid * (right - left)
        y = top + (np.arange(config.grid) + 0.5) / config.grid * (bottom - top)
        rows = np.clip(y.astype(int), 0, mask.shape[0] - 1)
        columns = np.clip(x.astype(int), 0, mask.shape[1] - 1)
        self._outline = mask[np.ix_(rows, columns)]
        self._half_m = view.box.size_px / 2.0 * self._metres_per_px
        self._grid = config.grid

    def cells_at(self, cells: Array, azimuth_rad: float) -> NDArray[np.int64]:
        """Return (row, column) ``(n, 2)`` at which ``cells`` ``(n, 3)`` appear from an azimuth."""
        c, s = np.cos(azimuth_rad), np.sin(azimuth_rad)
        towards = c * cells[:, 0] + s * cells[:, 1]
        right = c * cells[:, 1] - s * cells[:, 0]
        down = self._sink * towards - self._level * cells[:, 2]
        ahead = self._level * towards + self._sink * cells[:, 2]
        nearer = self._reach_m / np.maximum(self._reach_m - ahead, 0.1 * self._reach_m)
        places = np.stack([down, right], axis=1) * nearer[:, None] / self._half_m[::-1]
        return np.floor((places + 1.0) / 2.0 * self._grid).astype(np.int64)

    def holds(self, places: NDArray[np.int64]) -> Mask:
        """Return which places ``(n, 2)`` lie in the outline."""
        within = ((places >= 0) & (places < self._grid)).all(axis=1)
        rows, columns = np.clip(places, 0, self._grid - 1).T
        return within & self._outline[rows, columns]

    def filled_by(self, places: NDArray[np.int64]) -> float:
        """Return the share of the outline that places ``(n, 2)`` fall into."""
        filled = np.zeros_like(self._outline)
        filled[places[:, 0], places[:, 1]] = True
        return float((filled & self._outline).sum()) / max(1, int(self._outline.sum()))
