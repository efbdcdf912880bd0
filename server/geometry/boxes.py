"""Upright boxes in the world.

Symbols: ``lower`` and ``upper`` are opposite corners ``(3,)``, world metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Which coordinates of each of the eight corners are the upper ones.
_UPPER = np.array([[(i >> axis) & 1 for axis in range(3)] for i in range(8)], bool)


@dataclass(frozen=True, slots=True, eq=False)
class Box3:
    """An axis-aligned box.

    Attributes:
        lower: Smallest corner ``(3,)``, world metres.
        upper: Largest corner ``(3,)``, world metres.

    Raises:
        ValueError: If a corner is not finite or ``lower`` exceeds ``upper`` on any axis.
    """

    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        if not (np.isfinite(self.lower).all() and np.isfinite(self.upper).all()):
            raise ValueError("box corners must be finite")
        if (self.lower > self.upper).any():
            raise ValueError(f"box is inside out: lower {self.lower} exceeds upper {self.upper}")

    @property
    def centre(self) -> Array:
        """Centre ``(3,)``, world metres."""
        return (self.lower + self.upper) / 2.0

    @property
    def size(self) -> Array:
        """Edge lengths ``(3,)``, metres."""
        return self.upper - self.lower

    @property
    def volume_m3(self) -> float:
        """Volume in cubic metres."""
        return float(np.prod(self.size))

    @property
    def corners(self) -> Array:
        """The eight corners ``(8, 3)``."""
        return np.where(_UPPER, self.upper, self.lower)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Return which ``points`` ``(n, 3)`` lie inside or on the surface."""
        inside = (points >= self.lower) & (points <= self.upper)
        return np.asarray(inside.all(axis=1), bool)

    def grown(self, margin_m: float) -> Box3:
        """Return the box with every face moved outwards by ``margin_m``."""
        return Box3(self.lower - margin_m, self.upper + margin_m)

    def distance(self, point: Array) -> float:
        """Return the distance in metres from ``point`` ``(3,)`` to the box, zero inside."""
        return float(
            np.linalg.norm(np.maximum(0.0, np.maximum(self.lower - point, point - self.upper)))
        )


def union(boxes: tuple[Box3, ...]) -> Box3:
    """Return the smallest box around all ``boxes``; at least one is needed."""
    return Box3(
        np.min([b.lower for b in boxes], axis=0),
        np.max([b.upper for b in boxes], axis=0),
    )
