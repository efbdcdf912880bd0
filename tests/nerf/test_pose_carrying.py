"""What counts as refined when the pictures fall into several reconstructions."""

from __future__ import annotations

import numpy as np
import pytest

from server.geometry.poses import Similarity
from server.nerf.pose_alignment import Beliefs
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_mapping import Model
from server.nerf.poses import _Carried, _Task
from tests.nerf.pose_room import CAMERA, believed, ring

LARGE, SMALL = np.arange(11), np.arange(11, 16)


def reconstruction(
    T_true: np.ndarray, indices: np.ndarray, other: Similarity, rng: np.random.Generator
) -> Model:
    """Return an exact model of some pictures but for half a pixel of noise."""
    points = rng.uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 2.0], (300, 3))
    rows = []
    for position, index in enumerate(indices):
        pixels, depths = CAMERA.project(points, T_true[index])
        seen = np.flatnonzero((depths > 0.3) & CAMERA.contains(np.nan_to_num(pixels, nan=-1.0)))
        places = pixels[seen] + rng.normal(0.0, 0.5, (len(seen), 2))
        rows.append(np.column_stack([np.full(len(seen), position), seen, places]))
    return Model(indices, other.poses(T_true[indices]), other.points(points), np.concatenate(rows))


@pytest.fixture
def task() -> tuple[_Task, np.ndarray]:
    T_true, drone_ids = ring(2, 8, 0.35)
    rng = np.random.default_rng(4)
    T_believed = believed(
        T_true, drone_ids, rng, offset_m=0.1, yaw_rad=0.05, noise_m=0.03, noise_rad=0.01
    )
    n = len(T_true)
    drone = np.array([int(name[-1]) - 1 for name in drone_ids])
    beliefs = Beliefs(T_believed, drone, np.full(n, 0.15), np.full(n, 0.05))
    at_s = np.tile(np.arange(8.0), 2)
    return _Task(beliefs, drone_ids, at_s, np.ones(n, bool), [CAMERA] * n), T_true


def test_only_the_largest_reconstruction_counts_and_the_operator_is_told(
    task: tuple[_Task, np.ndarray],
) -> None:
    known, T_true = task
    rng = np.random.default_rng(5)
    one = Similarity(0.4, np.eye(3), np.array([1.0, 0.0, 0.0]))
    two = Similarity(3.0, np.eye(3), np.array([0.0, -1.0, 0.0]))
    models = [
        reconstruction(T_true, LARGE, one, rng),
        reconstruction(T_true, SMALL, two, rng),
    ]
    carried = _Carried(known.beliefs, known.cameras)
    carried.take(models, known, PoseConfig())
    result = carried.result(known)
    assert result.refined[LARGE].all()
    assert not result.refined[SMALL].any()
    assert (result.sigma_m[LARGE] < 0.05).all()
    np.testing.assert_allclose(result.sigma_m[SMALL], 0.15)
    assert "11 of 16 poses refined" in result.message
    assert "the others are corrected flight poses, known to about 15 cm" in result.message


def test_poses_that_are_known_too_vaguely_are_not_called_refined(
    task: tuple[_Task, np.ndarray],
) -> None:
    known, T_true = task
    model = reconstruction(
        T_true, np.arange(16), Similarity(1.0, np.eye(3), np.zeros(3)), np.random.default_rng(6)
    )
    carried = _Carried(known.beliefs, known.cameras)
    carried.take([model], known, PoseConfig(max_sigma_m=1e-4))
    assert not carried.refined.any()
    assert "kept, known to about" in carried.result(known).message
