"""The simulated camera: what its lens, shutter and exposure do to a drawn picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from ideal_camera import IDEAL_CAMERA
from scipy.spatial.transform import Rotation

from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import inverse, look_at, transform_from, transform_points
from server.sim.camera import (
    STILL,
    CameraMotion,
    SimulatedCamera,
    canvas_intrinsics,
    true_intrinsics,
)
from server.sim.config import CameraConfig, DynamicsConfig, SimConfig, fleet_config
from server.sim.dynamics import Airframe
from server.sim.tello import Tello

STEADY = replace(CameraConfig(), gain_sigma=0.0, balance_sigma=0.0)
POSE = look_at(np.array([1.8, 0.0, 0.9]), np.array([0.0, 0.0, 0.4]))
# All at the one depth that the shutter assumes.
PLACES_CAM = np.array([[x, y, 1.8] for x in (-0.8, -0.3, 0.3, 0.8) for y in (-0.6, -0.2, 0.2, 0.6)])


def dots(points_world: np.ndarray, T_world_cam: np.ndarray, config: CameraConfig) -> np.ndarray:
    """Return the canvas of soft bright dots on black, drawn to a sixteenth of a pixel."""
    camera = canvas_intrinsics(config)
    image = np.zeros((camera.height, camera.width, 3), np.uint8)
    pixels, _ = camera.project(points_world, T_world_cam)
    for x, y in pixels:
        centre = round(x * 16), round(y * 16)
        cv2.circle(image, centre, 6 * 16, (255, 255, 255), -1, cv2.LINE_AA, 4)
    return image


def found(image: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return the centroid of the light within 20 pixels of each place."""
    out = []
    for x, y in near:
        left, top = max(int(x) - 20, 0), max(int(y) - 20, 0)
        part = image[top : top + 41, left : left + 41].sum(axis=2).astype(float)
        ys, xs = np.mgrid[top : top + part.shape[0], left : left + part.shape[1]]
        out.append([(part * xs).sum() / part.sum(), (part * ys).sum() / part.sum()])
    return np.array(out)


def test_an_ideal_camera_takes_what_is_drawn() -> None:
    config = IDEAL_CAMERA
    assert canvas_intrinsics(config) == TELLO_INTRINSICS
    assert true_intrinsics(config, 3, 1) == config.calibrated == TELLO_INTRINSICS
    image = dots(transform_points(POSE, PLACES_CAM), POSE, config)
    moving = CameraMotion(np.array([0.1, 0.5, 0.2]), np.array([0.5, 0.0, 0.3]))
    np.testing.assert_array_equal(SimulatedCamera(config, 0, 0).take(image, moving, 0.0), image)


@pytest.mark.parametrize("index", range(4))
def test_points_appear_where_the_true_lens_says(index: int) -> None:
    camera = SimulatedCamera(STEADY, 7, index)
    points = transform_points(POSE, PLACES_CAM)
    picture = camera.take(dots(points, POSE, STEADY), STILL, 0.0)
    expected, _ = camera.lens.project(points, POSE)
    np.testing.assert_allclose(found(picture, expected), expected, atol=0.15)


def test_rows_are_read_from_where_the_camera_is_then() -> None:
    """Every point of a turning and flying camera's picture fits the pose at its own row."""
    camera = SimulatedCamera(replace(STEADY, exposure_s=0.0), 7, 0)
    motion = CameraMotion(np.array([0.15, 0.6, -0.3]), np.array([0.4, -0.1, 0.2]))
    points = transform_points(POSE, PLACES_CAM)
    picture = camera.take(dots(points, POSE, STEADY), motion, 0.0)
    expected, _ = camera.lens.project(points, POSE)
    for _ in range(3):  # The row decides on the pose, the pose on the row.
        poses = [pose_at(motion, (y / 719.0 - 0.5) * 0.02) for y in expected[:, 1]]
        expected = np.concatenate(
            [camera.lens.project(p[None], T)[0] for p, T in zip(points, poses, strict=True)]
        )
    still, _ = camera.lens.project(points, POSE)
    assert np.abs(expected - still).max() > 3.0, "the test moves too little to show anything"
    np.testing.assert_allclose(found(picture, expected), expected, atol=0.3)


def pose_at(motion: CameraMotion, dt_s: float) -> np.ndarray:
    R = Rotation.from_rotvec(motion.angular_rad_s * dt_s).as_matrix()
    return POSE @ transform_from(R, motion.velocity_m_s * dt_s)


def test_motion_smears_along_itself_and_keeps_the_middle() -> None:
    steady = replace(STEADY, readout_s=0.0)
    camera = SimulatedCamera(steady, 7, 0)
    turning = CameraMotion(np.array([0.0, 1.5, 0.0]), np.zeros(3))
    image = dots(transform_points(POSE, np.array([[0.0, 0.0, 1.8]])), POSE, steady)
    sharp, smeared = (camera.take(image, motion, 0.0) for motion in (STILL, turning))
    length_px = camera.middle_flow_px_s(turning)[0] * steady.exposure_s
    assert length_px == pytest.approx(13.8, rel=0.03)
    spread = [np.sqrt(_variances(picture)) for picture in (sharp, smeared)]
    # A uniform smear of length L adds L^2 / 12 to the variance along it and nothing across.
    assert spread[1][0] ** 2 - spread[0][0] ** 2 == pytest.approx(length_px**2 / 12.0, rel=0.3)
    assert spread[1][1] == pytest.approx(spread[0][1], abs=0.1)
    middle = found(sharp, np.array([[480.0, 360.0]]))
    np.testing.assert_allclose(found(smeared, middle), middle, atol=0.6)


def _variances(picture: np.ndarray) -> np.ndarray:
    weight = picture.sum(axis=2).astype(float)
    ys, xs = np.mgrid[: weight.shape[0], : weight.shape[1]]
    total = weight.sum()
    means = (weight * xs).sum() / total, (weight * ys).sum() / total
    return np.array(
        [(weight * (xs - means[0]) ** 2).sum(), (weight * (ys - means[1]) ** 2).sum()]
    ) / np.array([total, total])


def test_exposure_and_white_balance_wander_slowly_and_repeat() -> None:
    config = replace(IDEAL_CAMERA, gain_sigma=0.1, balance_sigma=0.03)
    grey = np.full((720, 960, 3), 120, np.uint8)
    cameras = [SimulatedCamera(config, 5, 2) for _ in range(2)]
    series = [
        [camera.take(grey, STILL, 0.1 * k)[0, 0].astype(int) for k in range(600)]
        for camera in cameras
    ]
    np.testing.assert_array_equal(series[0], series[1])
    values = np.array(series[0])
    assert values[:, 1].std() > 2.0
    assert np.abs(np.diff(values[:, 1])).max() <= 8, "exposure jumps"
    assert (values[:, 2] - values[:, 1]).std() > 0.5


def test_lenses_differ_from_drone_to_drone_and_from_what_is_known() -> None:
    sim = SimConfig(seed=3)
    known = [drone.intrinsics for drone in fleet_config(sim).drones]
    true = [Tello(sim, index).lens for index in range(sim.drones)]
    assert all(lens == sim.camera.calibrated for lens in known)
    assert len({lens.fx for lens in true}) == sim.drones
    many = np.array([true_intrinsics(sim.camera, seed, 0).fx for seed in range(400)])
    share = many / sim.camera.calibrated.fx - 1.0
    assert share.std() == pytest.approx(0.01, rel=0.2)
    assert abs(share).max() < 0.0201


@pytest.mark.parametrize("yaw_rad", [0.0, 2.0])
def test_the_airframe_knows_how_its_camera_moves(yaw_rad: float) -> None:
    """Against the difference of its poses a step apart."""
    body = Airframe(np.zeros(3), yaw_rad, DynamicsConfig(), np.random.default_rng(4))
    body.take_off()
    for _ in range(400):
        body.step(0.02)
    body.sticks = (30.0, 40.0, 10.0, 60.0)
    for _ in range(30):
        body.step(0.02)
        before = body.T_world_cam()
        body.step(0.02)
        after, motion = body.T_world_cam(), body.camera_motion()
        turned, _ = cv2.Rodrigues(before[:3, :3].T @ after[:3, :3])
        np.testing.assert_allclose(motion.angular_rad_s, turned[:, 0] / 0.02, atol=0.01)
        moved = inverse(after)[:3, :3] @ (after[:3, 3] - before[:3, 3])
        # The camera sits ahead of the centre that the velocity is of.
        np.testing.assert_allclose(motion.velocity_m_s, moved / 0.02, atol=0.06)


@pytest.mark.parametrize(
    "change",
    [
        {"focal_sigma": -0.1},
        {"readout_s": 1.0},
        {"exposure_s": -1.0},
        {"depth_m": 0.0},
        {"gain_tau_s": 0.0},
        {"distortion": (0.0, 0.0)},
    ],
)
def test_senseless_cameras_are_refused_by_name(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        CameraConfig(**change)  # pyright: ignore[reportArgumentType]
