"""Pictures of ``dronerf bench nerf``: perfect ones of an object on white, true, even poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.dataset import Dataset
from server.nerf.sightings import nothing_known
from server.sim.meshes import ObjectModel
from server.sim.scenes.catalogue import load_object
from server.sim.world import World

Array = NDArray[np.float64]

TRAINING_VIEWS, HELD_OUT_VIEWS, FEW_VIEWS = 24, 20, 8
_SIDE_PX = 400


def bench_dataset(scene: str) -> Dataset:
    """Return the pictures of ``scene``: those to train on, then those to be held out."""
    model = load_object(scene)
    views = _hemisphere_views(model, TRAINING_VIEWS, 0.0)
    others = _hemisphere_views(model, HELD_OUT_VIEWS, 0.5)
    return _render_dataset(model, np.concatenate([views, others]))


def _hemisphere_views(model: ObjectModel, count: int, phase: float) -> Array:
    """Return ``count`` poses even over the upper hemisphere (Fibonacci spiral), whole in view."""
    size = np.ptp(model.vertices, axis=0)
    centre = model.vertices.min(axis=0) + size / 2.0
    radius = 1.6 * float(np.linalg.norm(size)) / 2.0 / np.tan(np.deg2rad(20.0))
    index = np.arange(count) + 0.5
    height = np.clip(index / count, 0.02, 0.97)
    azimuth = 2.0 * np.pi * (index * (np.sqrt(5.0) - 1.0) / 2.0 + phase)
    across = np.sqrt(1.0 - height**2)
    offsets = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], axis=1)
    return np.stack([look_at(centre + radius * offset, centre) for offset in offsets])


def _render_dataset(model: ObjectModel, T_world_cam: Array) -> Dataset:
    """Return the pictures of ``T_world_cam`` ``(n, 4, 4)`` on white, in memory."""
    focal = _SIDE_PX / 2.0 / np.tan(np.deg2rad(20.0))
    middle = (_SIDE_PX - 1) / 2.0
    camera = Intrinsics(_SIDE_PX, _SIDE_PX, focal, focal, middle, middle)
    world = World(model, intrinsics=camera, supersample=2)
    images, masks = [], []
    try:
        for T in T_world_cam:
            mask = world.silhouette(T)
            image = world.render(T)[:, :, ::-1].copy()
            image[~mask] = 255
            images.append(image)
            masks.append(mask)
    finally:
        world.close()
    files = tuple(Path(f"{index:04d}.png") for index in range(len(images)))
    return Dataset(
        Path("."),
        files,
        tuple(images),
        tuple(masks),
        tuple(np.where(mask, 255, 0).astype(np.uint8) for mask in masks),
        (camera,) * len(images),
        T_world_cam,
        None,
        None,
        (nothing_known(),) * len(images),
    )
