"""A camera settles where a field looks like its picture."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at, transform_from
from server.nerf.photometric_fit import fit_pose
from server.nerf.rendering import Rendering

CAMERA = Intrinsics(240, 180, 220.0, 220.0, 119.5, 89.5)
CENTRE = np.array([0.1, -0.1, 0.0])


def painted_floor(camera: Intrinsics, T_world_cam: np.ndarray) -> Rendering:
    """Return what a camera sees of a floor painted in waves, at the height 0."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    rays = camera.directions(pixels) @ T_world_cam[:3, :3].T
    distances = -T_world_cam[2, 3] / rays[:, 2]
    x, y, _ = (T_world_cam[:3, 3] + distances[:, None] * rays).T
    waves = [np.sin(3.0 * x + 2.0 * y), np.sin(5.0 * y - x), np.cos(4.0 * x + 1.0)]
    shape = (camera.height, camera.width)
    rgb = (0.5 + 0.4 * np.stack(waves, axis=-1)).reshape(*shape, 3).astype(np.float32)
    return Rendering(rgb, distances.reshape(shape).astype(np.float32), np.ones(shape, np.float32))


@pytest.mark.parametrize("seed", range(4))
def test_a_camera_a_few_pixels_off_comes_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = look_at(np.array([1.2, -0.8, 1.6]), CENTRE)
    image = (255.0 * painted_floor(CAMERA, true).rgb).round().astype(np.uint8)
    turn = Rotation.from_rotvec(np.deg2rad(0.8) * rng.normal(size=3) / np.sqrt(3.0)).as_matrix()
    begun = transform_from(turn @ true[:3, :3], true[:3, 3] + 0.02 * rng.normal(size=3))
    settled = fit_pose(painted_floor, image, CAMERA, begun, CENTRE, steps=6)
    assert angle_deg(settled, true) < 0.1 * angle_deg(begun, true)
    assert np.linalg.norm(settled[:3, 3] - true[:3, 3]) < 0.004


def test_a_picture_that_tells_nothing_leaves_a_camera_where_it_is() -> None:
    def grey(camera: Intrinsics, _: np.ndarray) -> Rendering:
        shape = (camera.height, camera.width)
        flat = np.full((*shape, 3), 0.5, np.float32)
        return Rendering(flat, np.ones(shape, np.float32), np.ones(shape, np.float32))

    begun = look_at(np.array([1.2, -0.8, 1.6]), CENTRE)
    image = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    np.testing.assert_allclose(fit_pose(grey, image, CAMERA, begun, CENTRE), begun)


def angle_deg(one: np.ndarray, other: np.ndarray) -> float:
    turn = Rotation.from_matrix(one[:3, :3].T @ other[:3, :3])
    return float(np.rad2deg(turn.magnitude()))
