"""The multiresolution hash encoding in plain torch: the definition every kernel must equal.

Symbols (Mueller et al. 2022, section 3): L levels, T largest table, F features per entry; level l
has ``N_l = floor(N_min b^l)`` cells per axis with ``b = exp((ln N_max - ln N_min) / (L - 1))``
(equations 2 and 3) and so ``(N_l + 1)^3`` vertices. A level with at most T vertices stores each of
them; a finer one finds them by the spatial hash of equation 4. Points are ``u`` in ``[0, 1]^3``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from server.nerf.config import FieldConfig

# Factors of the spatial hash, equation 4.
HASH_Y = 2654435761
HASH_Z = 805459861


@dataclass(frozen=True, slots=True)
class GridLevel:
    """One level of the encoding.

    Attributes:
        resolution: N_l, cells per axis.
        offset: First row of this level in the common table.
        entries: Rows of this level.
        dense: True when every vertex has a row of its own.
    """

    resolution: int
    offset: int
    entries: int
    dense: bool


def grid_levels(config: FieldConfig) -> tuple[GridLevel, ...]:
    """Return the levels of ``config``, coarse to fine."""
    growth = 1.0
    if config.levels > 1:
        growth = math.exp(math.log(config.finest / config.coarsest) / (config.levels - 1))
    levels: list[GridLevel] = []
    offset = 0
    for level in range(config.levels):
        # The small addition keeps the finest level at N_max despite rounding.
        resolution = math.floor(config.coarsest * growth**level + 1e-6)
        vertices = (resolution + 1) ** 3
        dense = vertices <= 2**config.log2_table_size
        entries = vertices if dense else 2**config.log2_table_size
        levels.append(GridLevel(resolution, offset, entries, dense))
        offset += entries
    return tuple(levels)


def table_rows(config: FieldConfig) -> int:
    """Return the number of rows of the common table of all levels."""
    last = grid_levels(config)[-1]
    return last.offset + last.entries


def level_window(config: FieldConfig, open_levels: float) -> torch.Tensor:
    """Return weights ``(L,)``: 1 for open levels, 0 for closed ones, linear in between."""
    return (open_levels - torch.arange(config.levels, dtype=torch.float32)).clamp(0.0, 1.0)


def _rows(vertices: torch.Tensor, level: GridLevel) -> torch.Tensor:
    """Return the table rows ``(n,)`` of integer ``vertices`` ``(n, 3)``."""
    x, y, z = vertices.unbind(-1)
    if level.dense:
        side = level.resolution + 1
        return level.offset + x + side * (y + side * z)
    return level.offset + ((x ^ (y * HASH_Y) ^ (z * HASH_Z)) & (level.entries - 1))


def encode(
    points: torch.Tensor, table: torch.Tensor, levels: tuple[GridLevel, ...], window: torch.Tensor
) -> torch.Tensor:
    """Encode ``points``.

    Args:
        points: ``u`` ``(n, 3)`` in ``[0, 1]``.
        table: ``(rows, F)`` of all levels.
        levels: Layout of the table.
        window: Weight ``(L,)`` of every level.

    Returns:
        Features ``(n, L F)``, level by level.
    """
    features: list[torch.Tensor] = []
    for number, level in enumerate(levels):
        scaled = points * level.resolution
        cell = scaled.detach().floor().clamp(0, level.resolution - 1)
        inside = scaled - cell
        corner = cell.long()
        value = torch.zeros(len(points), table.shape[1], dtype=table.dtype)
        for bits in range(8):
            shift = torch.tensor([bits & 1, (bits >> 1) & 1, (bits >> 2) & 1])
            weight = torch.where(shift.bool(), inside, 1.0 - inside).prod(dim=1, keepdim=True)
            value = value + weight * table[_rows(corner + shift, level)]
        features.append(value * window[number])
    return torch.cat(features, dim=1)
