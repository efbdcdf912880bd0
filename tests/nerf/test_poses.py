"""Poses recovered from pictures of a room rendered from known poses."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.geometry.poses import fit_similarity
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_pairs import choose_pairs, view_angles
from server.nerf.poses import PosedPicture, RefinedPoses, refine_poses
from tests.nerf.pose_room import (
    CAMERA,
    Plane,
    angles_rad,
    believed,
    render,
    ring,
    textured_room,
)


@dataclass(frozen=True)
class Flight:
    """A rendered capture: true poses, and pictures with believed ones."""

    T_true: np.ndarray
    pictures: list[PosedPicture]


def _fly(folder: Path, planes: list[Plane], seed: int, drones: int, stops: int) -> Flight:
    rng = np.random.default_rng(seed)
    T_true, drone_ids = ring(drones, stops, math.radians(90.0 / stops))
    T_believed = believed(
        T_true, drone_ids, rng, offset_m=0.15, yaw_rad=0.08, noise_m=0.03, noise_rad=0.015
    )
    pictures = []
    for i, (T, drone) in enumerate(zip(T_true, drone_ids, strict=True)):
        file = folder / f"picture {i}.jpg"
        cv2.imwrite(str(file), render(planes, T, CAMERA))
        pictures.append(
            PosedPicture(file, T_believed[i], 0.1, 0.05, i % 2 == 0, drone, float(i % stops))
        )
    return Flight(T_true, pictures)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    room = textured_room(np.random.default_rng(4))
    return _fly(tmp_path_factory.mktemp("room"), room, seed=2, drones=4, stops=6)


def _refine(pictures: list[PosedPicture], folder: Path) -> RefinedPoses:
    return refine_poses(
        pictures, CAMERA, folder, PoseConfig(threads=1), lambda step, share: None, lambda: False
    )


def _errors_after_similarity(T_true: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation (rad) and position errors (m) after the similarity that fits best."""
    carried = fit_similarity(T[:, :3, 3], T_true[:, :3, 3]).poses(T)
    return angles_rad(T_true, carried), np.linalg.norm(T_true[:, :3, 3] - carried[:, :3, 3], axis=1)


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
    assert not (tmp_path / "pictures").exists()
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
    assert result.floor_z == 0.0
    seen = result.sightings
    # The floor's points lie on it although the beliefs are centimetres off.
    heights = seen.points_world[:, 2]
    assert abs(float(np.median(heights[np.abs(heights) < 0.05]))) < 0.005
    assert len(seen.points_world) > 500
    for k, (T, camera) in enumerate(zip(result.T_world_cam, result.intrinsics, strict=True)):
        rows = seen.pictures == k
        pixels, _ = camera.project(seen.points_world[seen.points[rows]], T)
        assert np.median(np.linalg.norm(pixels - seen.pixels[rows], axis=1)) < 1.0
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
    assert angles_rad(carried, flight.T_true)[lost] < math.radians(4.0)


@pytest.mark.slow
def test_one_thread_repeats_exactly(flight: Flight, tmp_path: Path) -> None:
    first, second = (_refine(flight.pictures[:6], tmp_path / name) for name in "ab")
    assert first.refined.all()
    np.testing.assert_array_equal(first.T_world_cam, second.T_world_cam)


@pytest.mark.slow
def test_pictures_may_come_from_several_cameras(flight: Flight, tmp_path: Path) -> None:
    pictures, T_true = flight.pictures[:6], flight.T_true[:6]
    # The second camera is the first one with a distortion far below a pixel.
    other = replace(CAMERA, distortion=(1e-9, 0.0, 0.0, 0.0, 0.0))
    result = refine_poses(
        pictures,
        [CAMERA, CAMERA, CAMERA, other, other, other],
        tmp_path,
        PoseConfig(threads=1),
        lambda step, share: None,
        lambda: False,
    )
    assert result.refined.all()
    turn_rad, shift_m = _errors_after_similarity(T_true, result.T_world_cam)
    assert turn_rad.max() < math.radians(0.5)
    assert shift_m.max() < 0.02


def _blank_pictures(folder: Path, count: int) -> list[PosedPicture]:
    T_world_cam, _ = ring(1, count, 0.2)
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
    assert len(result.sightings.pictures) == 0
    assert result.floor_z is None
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


@given(seed=st.integers(0, 2**31), drones=st.integers(1, 4), stops=st.integers(1, 6))
@settings(deadline=None, max_examples=25)
def test_pairs_are_neighbours_in_time_or_look_alike(seed: int, drones: int, stops: int) -> None:
    rng = np.random.default_rng(seed)
    T, drone_ids = ring(drones, stops, 0.3)
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
