"""What poses are worth: on a tiny scene, true poses beat disturbed ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.bench.poses_fields import psnr_with
from server.nerf.dataset import load_dataset
from tests.nerf.tiny_scene import write_tiny_scene


@pytest.mark.slow
def test_true_poses_give_better_fields_than_disturbed_ones(tmp_path: Path) -> None:
    run = write_tiny_scene(tmp_path / "run", 24)
    T_true = load_dataset(run).T_world_cam
    rng = np.random.default_rng(0)
    T_wrong = T_true.copy()
    turns = Rotation.from_rotvec(rng.normal(0.0, 0.05, (len(T_true), 3))).as_matrix()
    T_wrong[:, :3, :3] = turns @ T_true[:, :3, :3]
    T_wrong[:, :3, 3] += rng.normal(0.0, 0.05, (len(T_true), 3))
    with_true, with_wrong = (psnr_with(run, T, None, T_true, 60, 0, 1) for T in (T_true, T_wrong))
    assert 8.0 < with_wrong < with_true - 0.5
