"""A model in any frame is carried to where the drones believed it, wrong ones outvoted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from server.geometry.poses import fit_similarity
from server.nerf.pose_alignment import (
    Beliefs,
    ScaleUnknownError,
    align_to_beliefs,
    carry_corrections,
)
from server.nerf.pose_config import PoseConfig
from tests.nerf.pose_room import believed, ring


def _beliefs(T_world_cam: np.ndarray, drone_ids: list[str]) -> Beliefs:
    n = len(T_world_cam)
    _, drone = np.unique(np.array(drone_ids), return_inverse=True)
    return Beliefs(T_world_cam, drone, np.full(n, 0.05), np.full(n, 0.03))


def _in_another_frame(T_world_cam: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the poses in a frame of arbitrary attitude, origin and scale."""
    R = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    out = T_world_cam.copy()
    out[:, :3, :3] = R @ out[:, :3, :3]
    out[:, :3, 3] = rng.uniform(0.05, 20.0) * out[:, :3, 3] @ R.T + rng.normal(0.0, 5.0, 3)
    return out


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31), drones=st.integers(1, 4), stops=st.integers(3, 6))
def test_alignment_undoes_any_similarity(seed: int, drones: int, stops: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = ring(drones, stops, 0.25)
    T_model = _in_another_frame(T_true, rng)
    carried = align_to_beliefs(T_model, _beliefs(T_true, drone_ids), PoseConfig()).poses(T_model)
    np.testing.assert_allclose(carried, T_true, atol=1e-5)


@pytest.mark.slow
@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**31))
def test_alignment_does_not_depend_on_the_frame_of_the_model(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = ring(4, 4, 0.25)
    beliefs = _beliefs(believed(T_true, drone_ids, rng, 0.15, 0.08, 0.03, 0.01), drone_ids)
    results = []
    for _ in range(2):
        T_model = _in_another_frame(T_true, rng)
        results.append(align_to_beliefs(T_model, beliefs, PoseConfig()).poses(T_model))
    np.testing.assert_allclose(results[0], results[1], atol=2e-3)


@pytest.mark.slow
@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**31), wrong=st.integers(0, 3))
def test_one_drone_set_down_wrongly_moves_the_world_little(seed: int, wrong: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = ring(4, 5, 0.25)
    T_believed = T_true.copy()
    own = np.array([d == f"drone-{wrong + 1}" for d in drone_ids])
    direction = rng.normal(size=3)
    T_believed[own, :3, 3] += 0.6 * direction / np.linalg.norm(direction)
    T_model = _in_another_frame(T_true, rng)
    carried = align_to_beliefs(T_model, _beliefs(T_believed, drone_ids), PoseConfig()).poses(
        T_model
    )
    assert np.linalg.norm(carried[:, :3, 3] - T_true[:, :3, 3], axis=1).max() < 0.15
    plain = fit_similarity(T_model[:, :3, 3], T_believed[:, :3, 3]).poses(T_model)
    shift = np.linalg.norm(carried[:, :3, 3] - T_true[:, :3, 3], axis=1).mean()
    assert shift < np.linalg.norm(plain[:, :3, 3] - T_true[:, :3, 3], axis=1).mean()


def test_a_wrong_heading_leaves_the_world_upright() -> None:
    rng = np.random.default_rng(7)
    T_true, drone_ids = ring(1, 6, 0.2)
    T_believed = believed(T_true, drone_ids, rng, 0.1, 0.2, 0.05, 0.0)
    T_model = _in_another_frame(T_true, rng)
    carried = align_to_beliefs(T_model, _beliefs(T_believed, drone_ids), PoseConfig()).poses(
        T_model
    )
    np.testing.assert_allclose(carried[:, 2, :3], T_true[:, 2, :3], atol=math.radians(1.0))


def test_alignment_refuses_what_tells_no_scale() -> None:
    T_true, drone_ids = ring(1, 4, 0.2)
    with pytest.raises(ValueError, match="three"):
        align_to_beliefs(T_true[:2], _beliefs(T_true[:2], drone_ids[:2]), PoseConfig())
    hovering = T_true.copy()
    hovering[:, :3, 3] = [1.7, 0.0, 0.8]
    with pytest.raises(ScaleUnknownError):
        align_to_beliefs(T_true, _beliefs(hovering, drone_ids), PoseConfig())


def test_corrections_are_interpolated_within_a_drone_only() -> None:
    T = np.tile(np.eye(4), (5, 1, 1))
    T_refined = T.copy()
    T_refined[0, :3, 3], T_refined[2, :3, 3] = [0.1, 0.0, 0.0], [0.3, 0.0, 0.0]
    T_refined[2, :3, :3] = Rotation.from_euler("z", 0.2).as_matrix()
    refined = np.array([True, False, True, False, False])
    drone, at_s = np.array([0, 0, 0, 0, 1]), np.array([0.0, 1.0, 4.0, 9.0, 1.0])
    out = carry_corrections(T, T_refined, refined, drone, at_s)
    np.testing.assert_allclose(out[[0, 2]], T_refined[[0, 2]])
    np.testing.assert_allclose(out[1, :3, 3], [0.15, 0.0, 0.0])
    np.testing.assert_allclose(Rotation.from_matrix(out[1, :3, :3]).as_rotvec(), [0, 0, 0.05])
    np.testing.assert_allclose(out[3], T_refined[2])
    np.testing.assert_array_equal(out[4], T[4])
