"""Corners of a virtual room, as ``server.vision.features`` would follow them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.vision.config import FeatureConfig
from server.vision.features import Features

Array = NDArray[np.float64]

_CORNERS = 1500
# Of a room's four walls and its floor.
_HALF_M, _HEIGHT_M = 5.0, 3.0
# What following one adds to its error from picture to picture, what each picture adds to that,
# pixels, and which share is lost from picture to picture.
_WALK_PX, _NOISE_PX, _LOST = 0.1, 1.0, 0.01
_EDGE_PX = 12.0


class VirtualCorners:
    """Corners of an empty room, and those of them that one camera follows."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        points = rng.uniform(-1.0, 1.0, (_CORNERS, 3)) * [_HALF_M, _HALF_M, _HEIGHT_M / 2.0]
        points[:, 2] += _HEIGHT_M / 2.0
        surface = rng.integers(0, 5, _CORNERS)
        for wall in range(4):
            points[surface == wall, wall // 2] = _HALF_M * (1.0 - 2.0 * (wall % 2))
        points[surface == 4, 2] = 0.0
        self._points = points
        self._followed = np.zeros(0, np.int64)
        self._numbers = np.zeros(0, np.int64)
        self._off_px = np.zeros((0, 2))
        self._next = 0
        self._config = FeatureConfig()

    def seen(self, T_world_cam: Array, lens: Intrinsics, at_s: float) -> Features:
        """Return the corners in a picture: followed ones, and new ones when these get few."""
        rng, config = self._rng, self._config
        pixels, _ = lens.project(self._points, T_world_cam)
        visible = lens.contains(pixels, _EDGE_PX)
        kept = visible[self._followed] & (rng.random(len(self._followed)) > _LOST)
        self._followed, self._numbers = self._followed[kept], self._numbers[kept]
        walked = _WALK_PX * rng.standard_normal((int(kept.sum()), 2))
        self._off_px = self._off_px[kept] + walked
        if len(self._followed) < config.fewest:
            free = np.setdiff1d(np.flatnonzero(visible), self._followed)
            new = rng.permutation(free)[: config.most - len(self._followed)]
            self._followed = np.append(self._followed, new)
            self._numbers = np.append(self._numbers, np.arange(len(new)) + self._next)
            self._off_px = np.concatenate([self._off_px, np.zeros((len(new), 2))])
            self._next += len(new)
        off = self._off_px + _NOISE_PX * rng.standard_normal(self._off_px.shape)
        return Features(at_s, self._numbers.copy(), pixels[self._followed] + off)
