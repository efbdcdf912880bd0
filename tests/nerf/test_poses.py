"""Poses recovered from pictures of a room rendered here from known poses, and their alignment."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.geometry.poses import camera_pose, fit_similarity
from server.nerf.pose_alignment import (
    Beliefs,
    ScaleUnknownError,
    align_to_beliefs,
    carry_corrections,
)
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_pairs import choose_pairs, view_angles
from server.nerf.poses import PosedPicture, RefinedPoses, refine_poses

CAMERA = TELLO_INTRINSICS.scaled(0.5)
TILT_RAD = math.radians(12.0)
OBJECT_WORLD = np.array([0.0, 0.0, 0.5])


@dataclass(frozen=True)
class Plane:
    """A rectangle from ``corner`` along ``u`` and ``v`` (world metres) with a grey ``texture``."""

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    texture: np.ndarray


def _texture(rng: np.random.Generator, side_px: int) -> np.ndarray:
    """Return noise of several scales ``(side_px, side_px)``, grey levels."""
    sum_of_noise = np.zeros((side_px, side_px), np.float32)
    for sigma in (2.0, 4.0, 10.0):
        noise = rng.standard_normal((side_px, side_px)).astype(np.float32)
        blurred = cv2.GaussianBlur(noise, (0, 0), sigma)
        sum_of_noise += blurred / blurred.std()
    return np.clip(128.0 + 32.0 * sum_of_noise, 0, 255).astype(np.uint8)


def _room(rng: np.random.Generator) -> list[Plane]:
    """Return floor and walls of a room of 7 m and a box of half a metre in its middle."""
    x, y, z = np.eye(3)

    def box(centre: np.ndarray, half: np.ndarray, side_px: int) -> list[Plane]:
        low, size = centre - half, 2.0 * half
        sx, sy, sz = size[0] * x, size[1] * y, size[2] * z
        faces = [(low, sx, sy), (low, sx, sz), (low, sy, sz)]
        faces += [(low + sz, sx, sy), (low + sy, sx, sz), (low + sx, sy, sz)]
        return [Plane(c, u, v, _texture(rng, side_px)) for c, u, v in faces]

    walls = box(np.array([0.0, 0.0, 1.5]), np.array([3.5, 3.5, 1.5]), 700)
    return walls + box(OBJECT_WORLD, np.array([0.25, 0.25, 0.25]), 200)


def _render(planes: list[Plane], T_world_cam: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Cast one ray per pixel at every plane and keep the nearest hit."""
    xs, ys = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([xs.ravel(), ys.ravel()], axis=1).astype(float)
    rays = camera.directions(pixels) @ T_world_cam[:3, :3].T
    origin = T_world_cam[:3, 3]
    nearest = np.full(len(rays), np.inf)
    image = np.full(len(rays), 128, np.uint8)
    for plane in planes:
        normal = np.cross(plane.u, plane.v)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((plane.corner - origin) @ normal) / (rays @ normal)
            at = origin + depth[:, None] * rays - plane.corner
            a, b = at @ plane.u / (plane.u @ plane.u), at @ plane.v / (plane.v @ plane.v)
        hit = (depth > 1e-3) & (depth < nearest) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        side = len(plane.texture)
        columns = np.where(hit, a * (side - 1), 0).astype(np.float32).reshape(xs.shape)
        rows = np.where(hit, b * (side - 1), 0).astype(np.float32).reshape(xs.shape)
        shade = cv2.remap(plane.texture, columns, rows, cv2.INTER_LINEAR).ravel()
        image[hit], nearest[hit] = shade[hit], depth[hit]
    return image.reshape(xs.shape)


def _ring(drones: int, stops: int, step_rad: float) -> tuple[np.ndarray, list[str]]:
    """Return true poses on a ring around the object, each drone on an arc of its own."""
    poses, drone_ids = [], []
    for d in range(drones):
        for s in range(stops):
            azimuth = d * 2.0 * math.pi / drones + s * step_rad
            radius = 1.7 + 0.15 * math.sin(1.3 * s + d)
            height = 0.8 + 0.12 * math.cos(2.1 * s + d)
            centre = np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), height])
            yaw = azimuth + math.pi + 0.05 * math.sin(3.0 * s)
            poses.append(camera_pose(centre, yaw, TILT_RAD))
            drone_ids.append(f"drone-{d + 1}")
    return np.stack(poses), drone_ids


def _believed(
    poses: np.ndarray,
    drone_ids: list[str],
    rng: np.random.Generator,
    offset_m: float,
    yaw_rad: float,
    noise_m: float,
    noise_rad: float,
) -> np.ndarray:
    """Return ``poses`` as drones with a shifted, turned start and noise would believe them."""
    out = poses.copy()
    for drone in sorted(set(drone_ids)):
        own = np.array([d == drone for d in drone_ids])
        R = Rotation.from_euler("z", rng.normal(0.0, yaw_rad)).as_matrix()
        pivot = poses[own][0, :3, 3]
        out[own, :3, 3] = (poses[own, :3, 3] - pivot) @ R.T + pivot
        out[own, :3, 3] += rng.normal(0.0, offset_m, 3)
        out[own, :3, :3] = R @ poses[own, :3, :3]
    out[:, :3, 3] += rng.normal(0.0, noise_m, (len(out), 3))
    turns = Rotation.from_rotvec(rng.normal(0.0, noise_rad, (len(out), 3)))
    out[:, :3, :3] = turns.as_matrix() @ out[:, :3, :3]
    return out


def _angles_rad(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    relative = np.swapaxes(T_a[:, :3, :3], 1, 2) @ T_b[:, :3, :3]
    return Rotation.from_matrix(relative).magnitude()


@dataclass(frozen=True)
class Flight:
    """A rendered capture: true poses, and pictures with believed ones."""

    T_true: np.ndarray
    pictures: list[PosedPicture]


def _fly(folder: Path, planes: list[Plane], seed: int, drones: int, stops: int) -> Flight:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = _ring(drones, stops, math.radians(90.0 / stops))
    T_believed = _believed(
        T_true, drone_ids, rng, offset_m=0.15, yaw_rad=0.08, noise_m=0.03, noise_rad=0.015
    )
    pictures = []
    for i, (T, drone) in enumerate(zip(T_true, drone_ids, strict=True)):
        file = folder / f"picture {i}.jpg"
        cv2.imwrite(str(file), _render(planes, T, CAMERA))
        pictures.append(
            PosedPicture(file, T_believed[i], 0.1, 0.05, i % 2 == 0, drone, float(i % stops))
        )
    return Flight(T_true, pictures)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    room = _room(np.random.default_rng(4))
    return _fly(tmp_path_factory.mktemp("room"), room, seed=2, drones=4, stops=6)


def _refine(pictures: list[PosedPicture], folder: Path) -> RefinedPoses:
    return refine_poses(
        pictures, CAMERA, folder, PoseConfig(threads=1), lambda step, share: None, lambda: False
    )


def _errors_after_similarity(T_true: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation (rad) and position errors (m) after the similarity that fits best."""
    carried = fit_similarity(T[:, :3, 3], T_true[:, :3, 3]).poses(T)
    return _angles_rad(T_true, carried), np.linalg.norm(
        T_true[:, :3, 3] - carried[:, :3, 3], axis=1
    )


@pytest.mark.slow
def test_poses_of_a_textured_room_are_recovered(flight: Flight, tmp_path: Path) -> None:
    T_flight = np.stack([p.T_world_cam for p in flight.pictures])
    progress: list[tuple[str, float]] = []
    result = refine_poses(
        flight.pictures,
        CAMERA,
        tmp_path,
        PoseConfig(threads=1),
        lambda step, share: progress.append((step, share)),
        lambda: False,
    )
    assert result.refined.all()
    turn_rad, shift_m = _errors_after_similarity(flight.T_true, result.T_world_cam)
    assert turn_rad.max() < math.radians(0.5)
    assert shift_m.max() < 0.02
    # The world frame is known no better than the beliefs, but never worse than a single one.
    before = np.linalg.norm(T_flight[:, :3, 3] - flight.T_true[:, :3, 3], axis=1)
    after = np.linalg.norm(result.T_world_cam[:, :3, 3] - flight.T_true[:, :3, 3], axis=1)
    assert after.mean() < before.mean()
    up = result.T_world_cam[:, 2, 1] - flight.T_true[:, 2, 1]
    assert np.abs(up).max() < 0.02
    assert result.reprojection_rms_px < 1.0
    assert len(result.points_world) > 500
    assert "12 of 12" in result.message
    assert [step for step, share in progress if share == 1.0][:2] == ["features", "matches"]
    assert all(0.0 <= share <= 1.0 for _, share in progress)


@pytest.mark.slow
def test_a_picture_that_shows_nothing_is_moved_with_its_neighbours(
    flight: Flight, tmp_path: Path
) -> None:
    blank = tmp_path / "blank.png"
    cv2.imwrite(str(blank), np.full((CAMERA.height, CAMERA.width), 90, np.uint8))
    lost = 8
    pictures = [replace(p, file=blank) if i == lost else p for i, p in enumerate(flight.pictures)]
    result = _refine(pictures, tmp_path / "work")
    assert not result.refined[lost]
    assert result.refined.sum() == len(pictures) - 1
    assert "11 of 12" in result.message
    # Only its own noise is left, not what was wrong with its drone.
    carried = fit_similarity(
        result.T_world_cam[result.refined, :3, 3], flight.T_true[result.refined, :3, 3]
    ).poses(result.T_world_cam)
    assert np.linalg.norm(carried[lost, :3, 3] - flight.T_true[lost, :3, 3]) < 0.12
    assert _angles_rad(carried, flight.T_true)[lost] < math.radians(4.0)


@pytest.mark.slow
def test_one_thread_repeats_exactly(flight: Flight, tmp_path: Path) -> None:
    first, second = (_refine(flight.pictures[:6], tmp_path / name) for name in "ab")
    assert first.refined.all()
    np.testing.assert_array_equal(first.T_world_cam, second.T_world_cam)


def _blank_pictures(folder: Path, count: int) -> list[PosedPicture]:
    T_world_cam, _ = _ring(1, count, 0.2)
    pictures = []
    for i in range(count):
        file = folder / f"{i}.png"
        cv2.imwrite(str(file), np.full((CAMERA.height, CAMERA.width), 100, np.uint8))
        pictures.append(PosedPicture(file, T_world_cam[i], 0.1, 0.05, True, "a", float(i)))
    return pictures


def test_pictures_without_texture_keep_their_flight_poses(tmp_path: Path) -> None:
    pictures = _blank_pictures(tmp_path, 4)
    result = _refine(pictures, tmp_path / "work")
    assert not result.refined.any()
    np.testing.assert_array_equal(result.T_world_cam, np.stack([p.T_world_cam for p in pictures]))
    assert math.isnan(result.reprojection_rms_px)
    assert result.points_world.shape == (0, 3)
    assert "texture" in result.message


def test_a_stop_keeps_the_flight_poses(tmp_path: Path) -> None:
    pictures = _blank_pictures(tmp_path, 3)
    result = refine_poses(
        pictures, CAMERA, tmp_path / "work", PoseConfig(), lambda step, share: None, lambda: True
    )
    assert not result.refined.any()
    assert "Stopped" in result.message


def test_bad_input_is_named(tmp_path: Path) -> None:
    good = _blank_pictures(tmp_path, 3)
    text = tmp_path / "no.jpg"
    text.write_text("no picture")
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((10, 10), np.uint8))
    cases = [
        (good[:1], "at least two"),
        ([good[0], replace(good[1], file=text)], "no.jpg"),
        ([good[0], replace(good[1], file=tmp_path / "absent.jpg")], "absent.jpg"),
        ([good[0], replace(good[1], file=small)], "small.png is 10x10"),
        ([good[0], good[0]], "twice"),
        ([good[0], replace(good[1], T_world_cam=np.full((4, 4), np.nan))], "finite"),
        ([good[0], replace(good[1], sigma_m=0.0)], "sigmas"),
    ]
    for pictures, what in cases:
        with pytest.raises(ValueError, match=what):
            _refine(pictures, tmp_path / "work")
    with pytest.raises(ValueError, match="2 intrinsics for 3"):
        refine_poses(
            good, [CAMERA] * 2, tmp_path, PoseConfig(), lambda step, share: None, lambda: False
        )


def test_config_names_the_field_that_is_wrong() -> None:
    for field, value in [("threads", 0), ("tilt_sigma_rad", 0.0), ("max_match_ratio", 1.5)]:
        with pytest.raises(ValueError, match=field):
            PoseConfig(**{field: value})


def _beliefs(T_world_cam: np.ndarray, drone_ids: list[str]) -> Beliefs:
    n = len(T_world_cam)
    _, drone = np.unique(np.array(drone_ids), return_inverse=True)
    return Beliefs(T_world_cam, drone, np.full(n, 0.05), np.full(n, 0.03))


def _in_another_frame(T_world_cam: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the poses in a frame of arbitrary attitude, origin and scale."""
    R = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    out = T_world_cam.copy()
    out[:, :3, :3] = R @ out[:, :3, :3]
    out[:, :3, 3] = rng.uniform(0.05, 20.0) * out[:, :3, 3] @ R.T + rng.normal(0.0, 5.0, 3)
    return out


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31), drones=st.integers(1, 4), stops=st.integers(3, 6))
def test_alignment_undoes_any_similarity(seed: int, drones: int, stops: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = _ring(drones, stops, 0.25)
    T_model = _in_another_frame(T_true, rng)
    carried = align_to_beliefs(T_model, _beliefs(T_true, drone_ids), PoseConfig()).poses(T_model)
    np.testing.assert_allclose(carried, T_true, atol=1e-5)


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**31))
def test_alignment_does_not_depend_on_the_frame_of_the_model(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = _ring(4, 4, 0.25)
    beliefs = _beliefs(_believed(T_true, drone_ids, rng, 0.15, 0.08, 0.03, 0.01), drone_ids)
    results = []
    for _ in range(2):
        T_model = _in_another_frame(T_true, rng)
        results.append(align_to_beliefs(T_model, beliefs, PoseConfig()).poses(T_model))
    np.testing.assert_allclose(results[0], results[1], atol=2e-3)


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**31), wrong=st.integers(0, 3))
def test_one_drone_set_down_wrongly_moves_the_world_little(seed: int, wrong: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = _ring(4, 5, 0.25)
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
    T_true, drone_ids = _ring(1, 6, 0.2)
    T_believed = _believed(T_true, drone_ids, rng, 0.1, 0.2, 0.05, 0.0)
    T_model = _in_another_frame(T_true, rng)
    carried = align_to_beliefs(T_model, _beliefs(T_believed, drone_ids), PoseConfig()).poses(
        T_model
    )
    np.testing.assert_allclose(carried[:, 2, :3], T_true[:, 2, :3], atol=math.radians(1.0))


def test_alignment_refuses_what_tells_no_scale() -> None:
    T_true, drone_ids = _ring(1, 4, 0.2)
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


@given(seed=st.integers(0, 2**31), drones=st.integers(1, 4), stops=st.integers(1, 6))
@settings(deadline=None, max_examples=25)
def test_pairs_are_neighbours_in_time_or_look_alike(seed: int, drones: int, stops: int) -> None:
    rng = np.random.default_rng(seed)
    T, drone_ids = _ring(drones, stops, 0.3)
    n = len(T)
    at_s, still = rng.uniform(0.0, 60.0, n), rng.uniform(size=n) < 0.5
    config = PoseConfig()
    pairs = choose_pairs(T, drone_ids, at_s, still, config)
    assert pairs == sorted(set(pairs))
    angles = view_angles(T)
    for i, j in pairs:
        assert i < j
        between = [
            k
            for k in range(n)
            if drone_ids[k] == drone_ids[i]
            and min(at_s[i], at_s[j]) < at_s[k] < max(at_s[i], at_s[j])
        ]
        near_in_time = drone_ids[i] == drone_ids[j] and len(between) < config.time_neighbours
        assert near_in_time or angles[i, j] <= config.max_view_angle_rad
    alike = {
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if still[i] and still[j] and angles[i, j] <= config.max_view_angle_rad
    }
    assert alike <= set(pairs)
