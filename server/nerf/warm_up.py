"""Loads the training's compiled code ahead of its first pictures.

Reading it from numba's cache takes seconds, compiling it anew half a minute: better before there
are drones in the air, or while they fly to their first places, than between their first pictures
and the first preview.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import Dataset
from server.nerf.preview import render_preview
from server.nerf.sightings import nothing_known
from server.nerf.training import Trainer

_CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
_AROUND = 4
_STEPS = 2


def warm_up(threads: int) -> None:
    """Train a moment on grey pictures of nothing and render what came of it."""
    turns = np.arange(_AROUND) * 2.0 * np.pi / _AROUND
    centre = np.array([0.0, 0.0, 0.4])
    places = np.stack([2.0 * np.cos(turns), 2.0 * np.sin(turns), np.ones(_AROUND)], axis=1)
    shape = (_CAMERA.height, _CAMERA.width)
    dataset = Dataset(
        folder=Path(),
        files=(Path(),) * _AROUND,
        images=(np.full((*shape, 3), 128, np.uint8),) * _AROUND,
        masks=(np.ones(shape, np.bool_),) * _AROUND,
        alphas=(None,) * _AROUND,
        intrinsics=(_CAMERA,) * _AROUND,
        T_world_cam=np.stack([look_at(place, centre) for place in places]),
        object_box=Box3(centre - 0.3, centre + 0.3),
        floor_z=None,
        known=(nothing_known(),) * _AROUND,
    )
    trainer = Trainer(dataset, FieldConfig(), TrainConfig(), held_out=[], threads=threads)
    trainer.run(steps=_STEPS)
    render_preview(trainer, 0.0)
