"""What the field was found to be like, cell by cell: where samples are worth most.

The grid lies over ``u`` in ``[0, 1]^3`` (``server.nerf.space``). It only proposes samples: colours,
and where a ray ends, always come from the field itself, because a grid remembers the past and rays
cut by it would never correct it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from server.nerf.config import TrainConfig
from server.nerf.dataset import Dataset
from server.nerf.hull import visual_hull
from server.nerf.space import SceneSpace, expand

Densities = Callable[[NDArray[np.float32]], NDArray[np.float32]]

# Cells evaluated at once in a full sweep, to bound memory.
_BLOCK = 1 << 17
# Share of a cell's remembered density that survives a look at it.
_DECAY = 0.5
# A refresh looks at one in this many of the seen cells.
_REFRESH_SHARE = 12
# A cell that takes less than this share of the light on its way through does not show.
_SHOWS = 0.03
# Cells nearer to a camera than this share of the usual distance need a second camera.
_NEAR_SHARE = 0.5


class DensityMemory:
    """Cells that cameras see, and how dense the field was found there.

    Attributes:
        densities: float32 ``(cells, cells, cells)`` per path unit; even before the first sweep.
        seen: bool ``(cells, cells, cells)``; other cells hold nothing to learn.
        ready: False until the first sweep.
        far: Largest coordinate at which anything is looked for, scene units.

    Args:
        config: Grid size.
        dataset: Cameras.
        indices: Training pictures.
        space: Scene space.
    """

    def __init__(
        self, config: TrainConfig, dataset: Dataset, indices: Sequence[int], space: SceneSpace
    ) -> None:
        self._cells = config.memory_cells
        if dataset.cut_out:
            self.far = 1.0
            self.seen = visual_hull(dataset, indices, space, self._cells)
        else:
            # The folded cube's last layer of cells is left out: it lies beyond any room.
            self.far = self._cells / 4.0
            self.seen = _doubled(
                _seen_cells(max(self._cells // 2, 8), dataset, indices, space), self._cells
            )
        self.densities = np.zeros(self.seen.shape, np.float32)
        self.ready = False
        self._seen_ids = np.flatnonzero(self.seen)

    def refresh(self, densities: Densities, rng: np.random.Generator) -> None:
        """Look at the field: at every seen cell the first time, then at some of them."""
        if self.ready:
            cells = rng.choice(self._seen_ids, max(len(self._seen_ids) // _REFRESH_SHARE, 1))
        else:
            cells = self._seen_ids
        remembered = self.densities.reshape(-1)
        decay = np.float32(_DECAY if self.ready else 0.0)
        for start in range(0, len(cells), _BLOCK):
            part = cells[start : start + _BLOCK]
            found = densities(self._points_in(part, rng))
            remembered[part] = decay * remembered[part] + (np.float32(1.0) - decay) * found
        self.ready = True

    def _points_in(self, cells: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.float32]:
        """Return one random point ``u`` ``(n, 3)`` in each of ``cells``."""
        corner = np.stack(np.unravel_index(cells, (self._cells,) * 3), axis=1)
        return ((corner + rng.random(corner.shape)) / self._cells).astype(np.float32)

    def occupied(self) -> NDArray[np.bool_]:
        """Return ``(cells, cells, cells)``: what holds anything that shows, and its neighbours."""
        shows = 1.0 - np.exp(-self.densities * np.float32(4.0 / self._cells)) > _SHOWS
        return np.asarray(binary_dilation(shows, np.ones((3, 3, 3), bool)), bool)

    def restore(self, densities: NDArray[np.float32]) -> None:
        """Take over the densities of a checkpoint."""
        self.densities = np.ascontiguousarray(densities, np.float32)
        self.ready = True


def _doubled(coarse: NDArray[np.bool_], cells: int) -> NDArray[np.bool_]:
    """Return ``coarse`` with ``cells`` per axis."""
    scale = -(-cells // len(coarse))
    for axis in range(3):
        coarse = np.repeat(coarse, scale, axis=axis)
    return np.ascontiguousarray(coarse[:cells, :cells, :cells])


def _seen_cells(
    cells: int, dataset: Dataset, indices: Sequence[int], space: SceneSpace
) -> NDArray[np.bool_]:
    """Return ``(cells, cells, cells)``: may this cell hold anything?

    A cell that no camera sees holds nothing to learn. One seen by a single camera right in front
    of its lens could hold anything that explains the picture, so it is closed.
    """
    axis = (np.arange(cells) + 0.5) / cells
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    points = expand(grid).astype(np.float32)
    centres = space.to_scene(dataset.T_world_cam[list(indices), :3, 3])
    usual = float(np.median(np.linalg.norm(centres, axis=1)))
    views = np.zeros(len(points), np.int16)
    nearest = np.full(len(points), np.inf, np.float32)
    for centre, index in zip(centres, indices, strict=True):
        camera = dataset.intrinsics[index]
        R = dataset.T_world_cam[index, :3, :3].astype(np.float32)
        in_camera = (points - centre.astype(np.float32)) @ R
        depth = np.maximum(in_camera[:, 2], 1e-6)
        # One cell of slack around the picture, as only centres are tested.
        slack = 1.0 + 8.0 / cells
        inside = (
            (in_camera[:, 2] > 0.0)
            & (np.abs(in_camera[:, 0]) / depth < slack * camera.width / (2.0 * camera.fx))
            & (np.abs(in_camera[:, 1]) / depth < slack * camera.height / (2.0 * camera.fy))
        )
        views += inside
        nearest = np.where(inside, np.minimum(nearest, np.linalg.norm(in_camera, axis=1)), nearest)
    keep = (views >= 2) | ((views == 1) & (nearest > _NEAR_SHARE * usual))
    return keep.reshape(cells, cells, cells)
