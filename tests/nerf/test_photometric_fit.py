"""A camera settles where a field looks like its picture, and stays where it is right."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at, transform_from
from server.nerf.photometric_fit import fit_pose

CAMERA = Intrinsics(240, 180, 220.0, 220.0, 119.5, 89.5)
CENTRE = np.array([0.1, -0.1, 0.0])
TRUE = look_at(np.array([1.2, -0.8, 1.6]), CENTRE)


def painted_floor(camera: Intrinsics, T_world_cam: np.ndarray) -> NDArray[np.float32]:
    """Return what a camera sees of a floor painted in waves, at the height 0."""
    x, y = floor_places(camera, T_world_cam)
    waves = [np.sin(3.0 * x + 2.0 * y), np.sin(5.0 * y - x), np.cos(4.0 * x + 1.0)]
    rgb = 0.5 + 0.4 * np.stack(waves, axis=-1)
    return rgb.reshape(camera.height, camera.width, 3).astype(np.float32)


def badly_learnt(camera: Intrinsics, T_world_cam: np.ndarray) -> NDArray[np.float32]:
    """Return the same of a field that has learnt it with stains."""
    x, y = floor_places(camera, T_world_cam)
    stains = 0.1 * np.sin(9.0 * x + 1.0) * np.sin(8.0 * y)
    return painted_floor(camera, T_world_cam) + stains.reshape(
        camera.height, camera.width, 1
    ).astype(np.float32)


def floor_places(camera: Intrinsics, T_world_cam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the x and y of the floor that each pixel shows."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    rays = camera.directions(pixels) @ T_world_cam[:3, :3].T
    distances = -T_world_cam[2, 3] / rays[:, 2]
    places = T_world_cam[:3, 3] + distances[:, None] * rays
    return places[:, 0], places[:, 1]


def picture() -> NDArray[np.uint8]:
    return (255.0 * painted_floor(CAMERA, TRUE)).round().astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_a_camera_a_few_pixels_off_comes_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(np.deg2rad(0.8) * rng.normal(size=3) / np.sqrt(3.0)).as_matrix()
    begun = transform_from(turn @ TRUE[:3, :3], TRUE[:3, 3] + 0.02 * rng.normal(size=3))
    settled = fit_pose(painted_floor, picture(), CAMERA, begun, CENTRE, steps=6)
    assert angle_deg(settled, TRUE) < 0.1 * angle_deg(begun, TRUE)
    assert np.linalg.norm(settled[:3, 3] - TRUE[:3, 3]) < 0.004


def test_a_camera_that_is_right_stays_though_the_field_has_stains() -> None:
    settled = fit_pose(badly_learnt, picture(), CAMERA, TRUE, CENTRE, steps=6, least_gain=1e-2)
    assert angle_deg(settled, TRUE) < 0.3
    assert np.linalg.norm(settled[:3, 3] - TRUE[:3, 3]) < 0.01


def test_a_picture_that_tells_nothing_leaves_a_camera_where_it_is() -> None:
    def grey(camera: Intrinsics, _: np.ndarray) -> NDArray[np.float32]:
        return np.full((camera.height, camera.width, 3), 0.5, np.float32)

    image = np.full((CAMERA.height, CAMERA.width, 3), 90, np.uint8)
    np.testing.assert_allclose(fit_pose(grey, image, CAMERA, TRUE, CENTRE), TRUE)


def angle_deg(one: np.ndarray, other: np.ndarray) -> float:
    turn = Rotation.from_matrix(one[:3, :3].T @ other[:3, :3])
    return float(np.rad2deg(turn.magnitude()))
