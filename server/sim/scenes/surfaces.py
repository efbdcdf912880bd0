"""Pictures of ordinary surfaces, made of noise: wood, plaster, brick, cloth, paper.

A surface is sampled on a regular grid of a plane with coordinates in metres. Noise depends on the
place alone, not on the sampling, so that neighbouring tiles of different resolution fit together.

Symbols: ``h``, ``w`` rows and columns of a picture; fields are float32 ``(h, w)``, pictures uint8
RGB.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]
Picture = NDArray[np.uint8]

_LATTICE = 256


@dataclass(frozen=True, slots=True)
class Grid:
    """A rectangle of a surface and how finely it is sampled.

    Attributes:
        x_m: Left edge, metres.
        y_m: Top edge, metres; y grows downwards with the rows.
        width_m: Width, metres.
        height_m: Height, metres.
        columns: Samples across.
        rows: Samples down.
    """

    x_m: float
    y_m: float
    width_m: float
    height_m: float
    columns: int
    rows: int

    @property
    def x(self) -> Field:
        """Places of the columns ``(w,)``, metres."""
        steps = (np.arange(self.columns) + 0.5) / self.columns
        return (self.x_m + self.width_m * steps).astype(np.float32)

    @property
    def y(self) -> Field:
        """Places of the rows ``(h,)``, metres."""
        steps = (np.arange(self.rows) + 0.5) / self.rows
        return (self.y_m + self.height_m * steps).astype(np.float32)


class Noise:
    """Smooth random fields of a plane: the same seed and layer give the same field everywhere."""

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def field(
        self, grid: Grid, layer: int, cell_x_m: float, cell_y_m: float | None = None
    ) -> Field:
        """Return noise of about unit standard deviation with one random value per cell."""
        cell_y_m = cell_x_m if cell_y_m is None else cell_y_m
        rng = np.random.default_rng((self._seed, layer))
        lattice = rng.standard_normal((_LATTICE, _LATTICE), np.float32) * np.float32(1.5)
        # A field far smoother than the grid is sampled coarsely and enlarged: the same, but cheap.
        skip_x = _stride(cell_x_m * grid.columns / grid.width_m, grid.columns)
        skip_y = _stride(cell_y_m * grid.rows / grid.height_m, grid.rows)
        coarse = replace(grid, columns=grid.columns // skip_x, rows=grid.rows // skip_y)
        columns, weights_x = _cubic_taps(coarse.x / cell_x_m)
        rows, weights_y = _cubic_taps(coarse.y / cell_y_m)
        out = np.zeros((coarse.rows, coarse.columns), np.float32)
        used, places = np.unique(np.stack(rows), return_inverse=True)
        places = places.reshape(4, -1)
        across = np.zeros((len(used), coarse.columns), np.float32)
        for index, weight in zip(columns, weights_x, strict=True):
            across += lattice[used[:, None], index[None, :]] * weight
        for index, weight in zip(places, weights_y, strict=True):
            out += across[index] * weight[:, None]
        if skip_x == 1 and skip_y == 1:
            return out
        size = (grid.columns, grid.rows)
        return cv2.resize(out, size, interpolation=cv2.INTER_LINEAR).astype(np.float32, copy=False)

    def octaves(
        self, grid: Grid, layer: int, cell_m: float, count: int, gain: float = 0.6
    ) -> Field:
        """Return ``count`` fields summed, each finer by 2 and weaker by ``gain``."""
        total = np.zeros((grid.rows, grid.columns), np.float32)
        scale = 0.0
        for k in range(count):
            total += gain**k * self.field(grid, layer + k, cell_m / 2**k)
            scale += gain ** (2 * k)
        return total / np.float32(np.sqrt(scale))


def _stride(cell_px: float, samples: int) -> int:
    """Return how many samples may be skipped where a noise cell is ``cell_px`` wide."""
    skip = 1
    while skip < 32 and cell_px / (2 * skip) >= 8.0 and samples % (2 * skip) == 0:
        skip *= 2
    return skip


def _cubic_taps(places: Field) -> tuple[list[NDArray[np.int64]], list[Field]]:
    """Return lattice indices and B-spline weights of the four lattice points around each place."""
    base = np.floor(places)
    t = (places - base).astype(np.float32)
    weights = [
        (1 - t) ** 3 / 6,
        (3 * t**3 - 6 * t**2 + 4) / 6,
        (-3 * t**3 + 3 * t**2 + 3 * t + 1) / 6,
        t**3 / 6,
    ]
    first = base.astype(np.int64) - 1
    return [(first + k) % _LATTICE for k in range(4)], [w.astype(np.float32) for w in weights]


def toned(
    field: NDArray[np.floating], dark: tuple[int, int, int], light: tuple[int, int, int]
) -> Picture:
    """Return a picture that runs from ``dark`` at field -1 over to ``light`` at +1, RGB."""
    steps = np.clip((field + 1.5) * (255.0 / 3.0), 0, 255).astype(np.uint8)
    # The table covers -1.5 to 1.5, a little beyond the two named tones.
    t = (np.linspace(-1.5, 1.5, 256)[:, None] + 1.0) / 2.0
    table = np.asarray(dark) * (1 - t) + np.asarray(light) * t
    return np.clip(np.rint(table), 0, 255).astype(np.uint8)[steps]


def planks(grid: Grid, noise: Noise, width_m: float = 0.15, length_m: float = 1.3) -> Picture:
    """Return a floor of wooden planks that run along x."""
    y = grid.y[:, None]
    row = np.floor(y / width_m).astype(np.int64)
    rng = np.random.default_rng(17)
    table = rng.random(4096)
    shifted = grid.x[None, :] + length_m * table[row % 4096].astype(np.float32)
    column = np.floor(shifted / length_m).astype(np.int64)
    tone = (table[(row * 131 + column * 37) % 4096] - 0.5).astype(np.float32) * 1.3
    # Each plank is cut from another place of the tree: shift the grain by its row.
    grain = 0.55 * noise.field(grid, 1, 0.45, 0.011) + 0.4 * noise.field(grid, 2, 0.16, 0.0045)
    cloud = 0.25 * noise.octaves(grid, 10, 0.5, 3)
    speckle = 0.25 * noise.field(grid, 3, 0.02, 0.004) + 0.22 * noise.field(grid, 4, 0.005)
    value = tone + grain + cloud + speckle
    across = np.abs(y / width_m - np.round(y / width_m)) * width_m
    along = np.abs(shifted / length_m - np.round(shifted / length_m)) * length_m
    gap = np.minimum(across, along)
    value -= 1.6 * np.exp(-((gap / 0.0032) ** 2)).astype(np.float32)
    return toned(0.55 * value, (104, 80, 58), (184, 152, 116))


def plaster(
    grid: Grid, noise: Noise, dark: tuple[int, int, int], light: tuple[int, int, int]
) -> Picture:
    """Return painted plaster: stains, roller marks, fine grain."""
    value = 0.55 * noise.octaves(grid, 20, 1.1, 5, 0.7) + 0.35 * noise.octaves(
        grid, 30, 0.05, 3, 0.8
    )
    streak = 0.25 * noise.field(grid, 40, 0.05, 1.2)
    # Chips where the paint came off, a few per square metre.
    chips = noise.octaves(grid, 44, 0.12, 3)
    value -= 0.9 * np.clip(chips - 1.75, 0.0, 0.4) / 0.4
    return toned(0.75 * (value + streak), dark, light)


def bricks(grid: Grid, noise: Noise, width_m: float = 0.25, height_m: float = 0.08) -> Picture:
    """Return a wall of old bricks with light joints."""
    y = grid.y[:, None] + 0.004 * noise.field(grid, 60, 0.09)
    row = np.floor(y / height_m).astype(np.int64)
    x = grid.x[None, :] + (row % 2) * (width_m / 2) + 0.004 * noise.field(grid, 61, 0.09)
    column = np.floor(x / width_m).astype(np.int64)
    table = np.random.default_rng(23).random(4096).astype(np.float32)
    tone = (table[(row * 57 + column * 13) % 4096] - 0.5) * 1.7
    value = (
        tone + 0.45 * noise.octaves(grid, 62, 0.06, 4, 0.8) + 0.3 * noise.octaves(grid, 70, 1.5, 2)
    )
    picture = toned(0.7 * value, (116, 66, 52), (186, 124, 100))
    across = np.abs(y / height_m - np.round(y / height_m)) * height_m
    along = np.abs(x / width_m - np.round(x / width_m)) * width_m
    joint = np.minimum(across, along) < 0.006 + 0.002 * noise.field(grid, 72, 0.03)
    mortar = toned(0.6 * noise.octaves(grid, 74, 0.04, 3), (150, 144, 134), (196, 190, 180))
    return np.where(joint[..., None], mortar, picture)


def cloth(
    grid: Grid, noise: Noise, dark: tuple[int, int, int], light: tuple[int, int, int]
) -> Picture:
    """Return woven cloth."""
    weave = np.sin(grid.x[None, :] * (2 * np.pi / 0.012)) * np.sin(
        grid.y[:, None] * (2 * np.pi / 0.012)
    )
    value = 0.5 * noise.octaves(grid, 80, 0.25, 5, 0.75) + 0.4 * weave.astype(np.float32)
    return toned(0.8 * value, dark, light)


def rug(grid: Grid, noise: Noise) -> Picture:
    """Return a patterned rug that fills the grid: borders, medallions, woven threads."""
    u = (grid.x - grid.x_m - grid.width_m / 2)[None, :]
    v = (grid.y - grid.y_m - grid.height_m / 2)[:, None]
    inside = np.minimum(grid.width_m / 2 - np.abs(u), grid.height_m / 2 - np.abs(v))
    wobble = 0.012 * noise.octaves(grid, 90, 0.1, 3)
    radius = np.hypot(u / 1.5, v) + wobble
    petals = np.cos(8 * np.arctan2(v, u / 1.5)) * 0.05
    index = (np.floor((radius + petals) / 0.085) % 4).astype(np.int64)
    motif = (np.sin(u * 34) * np.sin(v * 34) + 0.35 * noise.field(grid, 95, 0.05)) > 0.62
    index = np.where(motif, 3 - index, index)
    border = (inside < 0.2) & (np.abs(np.sin((u + v) * 26)) > 0.35)
    index = np.where(inside < 0.2, np.where(border, 1, 4), index)
    index = np.where((inside < 0.04) | (np.abs(inside - 0.2) < 0.012), 5, index)
    palette = np.array(
        [[122, 46, 44], [58, 66, 92], [168, 138, 98], [146, 84, 56], [92, 50, 48], [44, 40, 46]]
    )
    threads = 1.0 + 0.13 * noise.field(grid, 96, 0.006) + 0.12 * noise.octaves(grid, 97, 0.3, 3)
    return np.clip(palette[index] * threads[..., None], 0, 255).astype(np.uint8)
