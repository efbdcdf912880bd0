"""How the bench judges poses, on made-up ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from server.bench.poses import _disturbed, _summary
from server.bench.poses_figures import into_frame_of, percentiles, pose_errors
from server.bench.poses_photographs import disturbed, photograph_figures
from server.geometry.poses import Similarity, look_at


def ring(count: int = 12) -> np.ndarray:
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    heights = 0.8 + 0.3 * np.cos(3.0 * angles)
    centres = np.stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), heights], axis=1)
    return np.stack([look_at(centre, np.array([0.0, 0.0, 0.4])) for centre in centres])


@given(seed=st.integers(0, 2**31), scale=st.floats(0.5, 2.0))
@settings(deadline=None, max_examples=20)
def test_a_moved_turned_and_scaled_world_has_no_error(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    other = Similarity(scale, R, rng.normal(size=3))
    T_true = ring()
    errors = pose_errors(other.poses(T_true), T_true)
    assert errors.rotation_deg.max() < 1e-4
    assert errors.translation_m.max() < 1e-9
    assert errors.scale_error == pytest.approx(abs(scale - 1.0), abs=1e-6)
    np.testing.assert_allclose(
        into_frame_of(other.poses(T_true), T_true, T_true), other.poses(T_true)
    )


def test_a_camera_that_is_turned_has_that_error_and_the_others_none() -> None:
    T_true = ring()
    T = T_true.copy()
    T[4, :3, :3] = Rotation.from_euler("z", 3.0, degrees=True).as_matrix() @ T[4, :3, :3]
    errors = pose_errors(T, T_true)
    assert errors.rotation_deg[4] == pytest.approx(3.0)
    assert np.delete(errors.rotation_deg, 4).max() < 1e-4


def test_noise_has_the_size_the_bench_tells() -> None:
    rng = np.random.default_rng(0)
    T = ring(1)[0]
    noisy = _disturbed(T, rng)
    turn = Rotation.from_matrix(noisy[:3, :3] @ T[:3, :3].T).magnitude()
    assert np.rad2deg(turn) == pytest.approx(8.0)
    assert np.linalg.norm(noisy[:3, 3] - T[:3, 3]) == pytest.approx(0.15)
    moved = disturbed(ring(), 4.0, rng)[:, :3, 3] - ring()[:, :3, 3]
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 0.32)


def test_percentiles_of_nothing_are_none() -> None:
    assert percentiles("error", [], 3, 50, 95) == {"error_p50": None, "error_p95": None}
    assert percentiles("error", [1.0, 2.0, 3.0], 3, 50) == {"error_p50": 2.0}


def test_samples_are_pooled_over_flights() -> None:
    sample = {
        "flight_rotation_deg": [1.0, 3.0],
        "flight_translation_m": [0.1],
        "rotation_deg": [0.1],
        "translation_m": [0.01],
        "peer_rotation_deg": [],
        "peer_translation_m": [],
        "stills": 24,
        "refined": 20,
        "peer_registered": 0,
        "scale_error": 0.01,
        "sigma_ratio_translation": 1.0,
        "sigma_ratio_rotation": 0.5,
        "seconds": 10.0,
    }
    figures = _summary([sample, {**sample, "flight_rotation_deg": [5.0, 7.0], "scale_error": 0.03}])
    assert figures["flight_rotation_deg_p50"] == 4.0
    assert figures["scale_error"] == pytest.approx(0.02)
    assert figures["refined"] == 40
    assert figures["peer_rotation_deg_p50"] is None
    assert figures["seconds"] == 10.0
    assert figures["sigma_ratio_worst"] == 1.0
    # Only first flights train fields, and a flight without pictures is counted and left out.
    figures = _summary([{"failed": "wall"}, sample, {**sample, "psnr_db_refined": 20.0}])
    assert figures["psnr_db_refined"] == 20.0
    assert (figures["flights"], figures["failed_flights"], figures["stills"]) == (3, 1, 48)


def test_without_the_test_data_there_are_no_photographs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("DRONERF_TEST_DATA", str(tmp_path))
    assert photograph_figures(0, 1) is None
