"""Rays of pictures in scene units: every pixel of a camera, or random training pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.nerf.dataset import Dataset
from server.nerf.hull import grown_mask
from server.nerf.space import SceneSpace

Array = NDArray[np.float64]
FloatArray = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class RayBatch:
    """Rays with the pixels they shall show.

    Attributes:
        pictures: Picture ``(rays,)`` each ray belongs to.
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        targets: ``(rays, 3)`` RGB in [0, 1]; laid on white where alpha is below 1.
        alphas: ``(rays,)`` opacity of each pixel, 1 in pictures of a room.
        distances: ``(rays,)`` distance of a surface that is known, scene units; 0 for none.
    """

    pictures: NDArray[np.int64]
    origins: FloatArray
    directions: FloatArray
    targets: FloatArray
    alphas: FloatArray
    distances: FloatArray


def directions_in_camera(camera: Intrinsics) -> FloatArray:
    """Return unit directions ``(h w, 3)`` of all pixels, row by row, in the camera frame."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    return camera.directions(pixels).astype(np.float32)


def camera_rays(
    camera: Intrinsics, T_world_cam: Array, space: SceneSpace
) -> tuple[FloatArray, FloatArray]:
    """Return origins and unit directions ``(h w, 3)`` in scene units of all pixels of a camera."""
    directions = directions_in_camera(camera) @ T_world_cam[:3, :3].T.astype(np.float32)
    origin = space.to_scene(T_world_cam[:3, 3]).astype(np.float32)
    return np.ascontiguousarray(np.broadcast_to(origin, directions.shape)), directions


class PixelSource:
    """Draws random pixels of the training pictures.

    Of pictures that show the object alone only the pixels that may show it are drawn: the others
    see nothing that the visual hull (``server.nerf.hull``) left.

    Args:
        dataset: Pictures.
        indices: Which of them are for training.
        space: Scene space.
        object_share: Share of the pixels drawn inside object masks, where there are masks.
        surface_share: Share of the pixels drawn where a surface is known, where there are such.
        hull_cells: Cells per axis of the visual hull.

    Raises:
        ValueError: If ``indices`` is empty.
    """

    def __init__(
        self,
        dataset: Dataset,
        indices: Sequence[int],
        space: SceneSpace,
        *,
        object_share: float,
        surface_share: float,
        hull_cells: int,
    ) -> None:
        if not indices:
            raise ValueError("no picture is left for training")
        self._indices = np.array(indices, np.int64)
        self._images = [dataset.images[i].reshape(-1, 3) for i in indices]
        self._alphas = [None if (a := dataset.alphas[i]) is None else a.ravel() for i in indices]
        self._pools = [
            _usable_pixels(dataset, i, space, hull_cells) if dataset.cut_out else None
            for i in indices
        ]
        tables: dict[Intrinsics, FloatArray] = {}
        for camera in (dataset.intrinsics[i] for i in indices):
            if camera not in tables:
                tables[camera] = directions_in_camera(camera)
        self._directions = [tables[dataset.intrinsics[i]] for i in indices]
        poses = dataset.T_world_cam[self._indices]
        self._R_world_cam = poses[:, :3, :3].astype(np.float32)
        self._origins = space.to_scene(poses[:, :3, 3]).astype(np.float32)
        self._objects = [
            None if (mask := dataset.masks[i]) is None else np.flatnonzero(mask) for i in indices
        ]
        self._object_share = object_share
        self._surface_share = surface_share
        self._known = [dataset.known[i] for i in indices]
        self._units_per_m = np.float32(1.0 / space.half_size)

    def draw(self, rays: int, rng: np.random.Generator) -> RayBatch:
        """Return ``rays`` random training pixels, spread evenly over the pictures."""
        which = np.sort(rng.integers(0, len(self._images), rays))
        # One lot for both: a pixel is drawn for the object or for what is known of its distance.
        spot, lot = rng.random(rays), rng.random(rays)
        lure = lot < self._object_share
        surface = lot >= 1.0 - self._surface_share
        directions = np.empty((rays, 3), np.float32)
        targets = np.empty((rays, 3), np.float32)
        alphas, distances = np.ones(rays, np.float32), np.zeros(rays, np.float32)
        bounds = np.searchsorted(which, np.arange(len(self._images) + 1))
        for k, (image, table) in enumerate(zip(self._images, self._directions, strict=True)):
            rows = slice(bounds[k], bounds[k + 1])
            pool = self._pools[k]
            if pool is None:
                pixels = (spot[rows] * len(image)).astype(np.int64)
            else:
                pixels = pool[(spot[rows] * len(pool)).astype(np.int64)]
            inside = self._objects[k]
            if inside is not None and len(inside):
                on_object = inside[(spot[rows] * len(inside)).astype(np.int64)]
                pixels = np.where(lure[rows], on_object, pixels)
            known = self._known[k]
            if len(known.pixels):
                chosen = (spot[rows] * len(known.pixels)).astype(np.int64)
                pixels = np.where(surface[rows], known.pixels[chosen], pixels)
                metres = np.where(surface[rows], known.distances_m[chosen], np.float32(0.0))
                distances[rows] = metres * self._units_per_m
            directions[rows] = table[pixels] @ self._R_world_cam[k].T
            targets[rows] = image[pixels]
            if (alpha := self._alphas[k]) is not None:
                alphas[rows] = alpha[pixels] * np.float32(1.0 / 255.0)
        targets *= np.float32(1.0 / 255.0)
        return RayBatch(
            self._indices[which], self._origins[which], directions, targets, alphas, distances
        )

    @property
    def mean_colour(self) -> FloatArray:
        """Mean RGB ``(3,)`` of the training pictures in [0, 1]."""
        return np.mean([image[::97].mean(axis=0) for image in self._images], axis=0).astype(
            np.float32
        ) / np.float32(255.0)


def _usable_pixels(
    dataset: Dataset, index: int, space: SceneSpace, cells: int
) -> NDArray[np.int64]:
    """Return the flat places of pixels that may see something of the visual hull."""
    near = np.flatnonzero(grown_mask(dataset, index, space, cells, times=2))
    return near if len(near) else np.arange(dataset.images[index][:, :, 0].size)
