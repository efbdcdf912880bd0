"""The last adjustment: lenses found, outliers without force, and errors as large as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.geometry.poses import fit_similarity
from server.nerf.pose_bundle import adjust
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_mapping import Model
from tests.nerf.pose_room import CAMERA, angles_rad, ring

BENT = replace(CAMERA, distortion=(-0.03, 0.1, 0.001, -0.006, 0.0))
STOPS = 8


def reconstruction(
    rng: np.random.Generator, *, noise_px: float, outliers: float = 0.0
) -> tuple[Model, np.ndarray, np.ndarray]:
    """Return a model that is somewhat wrong, its true poses, and the drone of each picture.

    The two drones' true focal lengths are 1 % longer and shorter than calibrated, their principal
    points 2 px to the right and to the left.
    """
    T_true, drone_ids = ring(2, STOPS, 0.35)
    drone = np.array([int(name[-1]) - 1 for name in drone_ids])
    points = rng.uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 2.0], (500, 3))
    rows = []
    for i, T in enumerate(T_true):
        sign = 1.0 if drone[i] == 0 else -1.0
        lens = replace(
            BENT,
            fx=BENT.fx * (1.0 + 0.01 * sign),
            fy=BENT.fy * (1.0 + 0.01 * sign),
            cx=BENT.cx + 2.0 * sign,
        )
        pixels, depths = lens.project(points, T)
        seen = np.flatnonzero((depths > 0.3) & lens.contains(np.nan_to_num(pixels, nan=-1.0)))
        places = pixels[seen] + rng.normal(0.0, noise_px, (len(seen), 2))
        wild = rng.random(len(seen)) < outliers
        places[wild] += rng.uniform(-40.0, 40.0, (int(wild.sum()), 2))
        rows.append(np.column_stack([np.full(len(seen), i), seen, places]))
    T_model = T_true.copy()
    turns = Rotation.from_rotvec(rng.normal(0.0, 0.004, (len(T_true), 3))).as_matrix()
    T_model[:, :3, :3] = turns @ T_model[:, :3, :3]
    T_model[:, :3, 3] += rng.normal(0.0, 0.015, (len(T_true), 3))
    wrong = points + rng.normal(0.0, 0.02, points.shape)
    return Model(np.arange(len(T_true)), T_model, wrong, np.concatenate(rows)), T_true, drone


def errors(T_model: np.ndarray, T_true: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    carried = fit_similarity(T_model[:, :3, 3], T_true[:, :3, 3]).poses(T_model)
    return angles_rad(T_true, carried), np.linalg.norm(carried[:, :3, 3] - T_true[:, :3, 3], axis=1)


def test_lenses_and_poses_are_found_together() -> None:
    model, T_true, drone = reconstruction(np.random.default_rng(2), noise_px=0.3)
    done = adjust(model, [BENT] * len(drone), drone, PoseConfig(min_focal_pictures=4))
    for camera, own in zip(done.intrinsics, drone, strict=True):
        sign = 1.0 if own == 0 else -1.0
        assert camera.fx == pytest.approx(BENT.fx * (1.0 + 0.01 * sign), rel=1e-3)
        assert camera.fy == pytest.approx(camera.fx)
        assert camera.cx == pytest.approx(BENT.cx + 2.0 * sign, abs=0.3)
    turn_rad, shift_m = errors(done.model.T_model_cam, T_true)
    assert np.rad2deg(turn_rad).max() < 0.08
    assert shift_m.max() < 0.004


def test_a_lens_with_few_pictures_stays_as_calibrated() -> None:
    model, _, drone = reconstruction(np.random.default_rng(2), noise_px=0.3)
    done = adjust(model, [BENT] * len(drone), drone, PoseConfig(min_focal_pictures=STOPS + 1))
    assert all(camera.fx == pytest.approx(BENT.fx, rel=1e-6) for camera in done.intrinsics)


def test_observations_of_moving_things_have_no_force() -> None:
    model, T_true, drone = reconstruction(np.random.default_rng(3), noise_px=0.3, outliers=0.12)
    done = adjust(model, [BENT] * len(drone), drone, PoseConfig(min_focal_pictures=4))
    turn_rad, shift_m = errors(done.model.T_model_cam, T_true)
    assert np.rad2deg(turn_rad).max() < 0.12
    assert shift_m.max() < 0.006
    assert len(done.model.observations) < 0.93 * len(model.observations)


@pytest.mark.slow
def test_errors_are_as_large_as_it_says() -> None:
    squares = []
    for seed in range(4):
        model, T_true, drone = reconstruction(np.random.default_rng(seed), noise_px=0.5)
        done = adjust(model, [BENT] * len(drone), drone, PoseConfig(min_focal_pictures=4))
        turn_rad, shift_m = errors(done.model.T_model_cam, T_true)
        scale = fit_similarity(done.model.T_model_cam[:, :3, 3], T_true[:, :3, 3]).scale
        squares.append(
            [
                np.mean((turn_rad / done.sigma_turn) ** 2) / 3.0,
                np.mean((shift_m / (scale * done.sigma_shift)) ** 2) / 3.0,
            ]
        )
    turn, shift = np.mean(squares, axis=0)
    assert 0.4 < turn < 2.5
    assert 0.4 < shift < 2.5
