"""Cells into few boxes: cut where a cut leaves most empty space out.

A set of cells starts as the one box around it. Again and again the box is cut, across any axis,
whose two halves, each shrunk to its cells, save the most volume; until there are as many boxes as
may be, or no cut saves enough. The boxes never overlap and hold every cell.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Cells = NDArray[np.bool_]
Counts = NDArray[np.int64]


class Block(NamedTuple):
    """Cells from ``first`` to before ``end``, both ``(3,)``."""

    first: Counts
    end: Counts

    def of(self, cells: NDArray[Any]) -> NDArray[Any]:
        """Return the part of a grid that the block covers."""
        return cells[
            self.first[0] : self.end[0], self.first[1] : self.end[1], self.first[2] : self.end[2]
        ]

    @property
    def volume(self) -> int:
        """Number of cells, full or empty."""
        return int(np.prod(self.end - self.first))


class Cut(NamedTuple):
    """Where a block is cut best: ``saved`` cells fall away when it is cut at ``place`` of it."""

    saved: int
    axis: int
    place: int


def boxes_around(cells: Cells, most: int, least_saved: float) -> list[Block]:
    """Return at most ``most`` disjoint blocks that hold all ``cells``, lowest first.

    Args:
        cells: ``(n, n, n)``.
        most: How many blocks at most.
        least_saved: A cut must save this share of the cells' own volume.
    """
    whole = _around(cells, Block(np.zeros(3, np.int64), np.array(cells.shape, np.int64)))
    if whole is None:
        return []
    least = max(1.0, least_saved * float(cells.sum()))
    done = [(whole, best_cut(whole.of(cells)))]
    while len(done) < most:
        index = max(range(len(done)), key=lambda k: done[k][1].saved)
        block, cut = done[index]
        if cut.saved < least:
            break
        end, first = block.end.copy(), block.first.copy()
        end[cut.axis] = first[cut.axis] = block.first[cut.axis] + cut.place
        halves = (_around(cells, Block(block.first, end)), _around(cells, Block(first, block.end)))
        done[index : index + 1] = [
            (half, best_cut(half.of(cells))) for half in halves if half is not None
        ]
    return sorted((block for block, _ in done), key=lambda block: tuple(block.first[::-1]))


def best_cut(cells: Cells) -> Cut:
    """Return the cut of a block without empty outer layers that saves most cells."""
    best = Cut(0, 0, 0)
    volume = int(cells.size)
    for axis in range(3):
        left = _volumes_so_far(cells, axis)
        right = _volumes_so_far(np.flip(cells, axis), axis)[::-1]
        saved = volume - left[:-1] - right[1:]
        if len(saved) and int(saved.max()) > best.saved:
            best = Cut(int(saved.max()), axis, int(saved.argmax()) + 1)
    return best


def _volumes_so_far(cells: Cells, axis: int) -> Counts:
    """Return the volume of the box around the first 1, 2, ... layers across ``axis``."""
    layers = np.moveaxis(cells, axis, 0)
    count = len(layers)
    volumes = np.ones(count, np.int64)
    for other in (1, 2):
        # ``(layers, cells along other)``: where anything is.
        filled = np.asarray(np.any(layers, axis=3 - other), bool)
        some, wide = np.asarray(np.any(filled, axis=1), bool), filled.shape[1]
        low = np.where(some, np.argmax(filled, axis=1), wide)
        high = np.where(some, wide - np.argmax(filled[:, ::-1], axis=1), 0)
        extent = np.maximum.accumulate(high) - np.minimum.accumulate(low)
        volumes *= np.maximum(extent, 0)
    full = np.asarray(np.any(layers, axis=(1, 2)), bool)
    last = np.maximum.accumulate(np.where(full, np.arange(count), -1))
    return volumes * (last - int(np.argmax(full)) + 1)


def _around(cells: Cells, block: Block) -> Block | None:
    """Return the block shrunk to its cells, None when it has none."""
    filled = np.argwhere(block.of(cells))
    if len(filled) == 0:
        return None
    return Block(block.first + filled.min(axis=0), block.first + filled.max(axis=0) + 1)
