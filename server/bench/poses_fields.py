"""What the poses are worth: fields trained on the same pictures with different poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.bench.poses_figures import into_frame_of
from server.geometry.cameras import Intrinsics
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import Dataset, load_dataset
from server.nerf.photometric_fit import fit_pose
from server.nerf.training import Trainer

Array = NDArray[np.float64]

TEST_EVERY = 8
_DOWNSCALE = 2


def psnr_with(
    run: Path,
    T_world_cam: Array,
    intrinsics: tuple[Intrinsics, ...] | None,
    T_true: Array,
    steps: int,
    seed: int,
    threads: int,
) -> float:
    """Return the held-out PSNR in dB of a field trained with some poses.

    Pictures 0, 8, 16 are held out. Their true poses are carried into the frame of the poses by the
    similarity that fits best and then settle on the field (``server.nerf.photometric_fit``).

    Args:
        run: Run folder with all pictures.
        T_world_cam: Poses ``(n, 4, 4)`` of the stills to train with.
        intrinsics: Cameras of the stills at full size, None for those of the run.
        T_true: True poses ``(n, 4, 4)``.
        steps: Training steps.
        seed: Of the training.
        threads: Cores to use.
    """
    dataset = replace(load_dataset(run, downscale=_DOWNSCALE), T_world_cam=T_world_cam)
    if intrinsics is not None:
        scaled = tuple(camera.scaled(1.0 / _DOWNSCALE) for camera in intrinsics)
        dataset = replace(dataset, intrinsics=scaled)
    held_out = list(range(0, len(dataset), TEST_EVERY))
    trainer = Trainer(
        dataset, FieldConfig(), TrainConfig(), held_out=held_out, seed=seed, threads=threads
    )
    trainer.run(steps=steps)
    carried = into_frame_of(T_world_cam, T_true, T_true[held_out])
    settled = {
        index: _settled(trainer, dataset, index, pose)
        for index, pose in zip(held_out, carried, strict=True)
    }
    return trainer.evaluate(held_out, settled).metrics.psnr_db


def _settled(trainer: Trainer, dataset: Dataset, index: int, T_world_cam: Array) -> Array:
    return fit_pose(
        lambda camera, pose: trainer.render(camera, pose).rgb,
        dataset.images[index],
        dataset.intrinsics[index],
        T_world_cam,
        trainer.space.centre,
    )
