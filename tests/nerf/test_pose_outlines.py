"""Poses fitted to the outlines of an object that has no texture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import camera_pose
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_outlines import OutlinedPoses, fit_to_outlines
from server.nerf.poses import PosedPicture, refine_poses
from tests.nerf.pose_room import believed

CAMERA = TELLO_INTRINSICS
SIGMA_M, SIGMA_RAD = 0.12, math.radians(2.5)
# Three blocks that look different from every side: corner and size, metres.
BLOCKS = (
    ((-0.35, -0.15, 0.0), (0.7, 0.3, 0.2)),
    ((-0.35, -0.15, 0.2), (0.2, 0.3, 0.6)),
    ((0.15, -0.15, 0.2), (0.12, 0.12, 0.25)),
)

Masks = list[NDArray[np.bool_] | None]


@dataclass(frozen=True)
class Flight:
    """True and believed poses, and true silhouettes."""

    T_true: NDArray[np.float64]
    T_believed: NDArray[np.float64]
    drone_ids: list[str]
    masks: Masks


def _corners(lower: tuple[float, ...], size: tuple[float, ...]) -> NDArray[np.float64]:
    unit = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1]), axis=-1).reshape(-1, 3)
    return np.array(lower) + unit * np.array(size)


def _silhouette(T_world_cam: NDArray[np.float64]) -> NDArray[np.bool_]:
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    for lower, size in BLOCKS:
        pixels, _ = CAMERA.project(_corners(lower, size), T_world_cam)
        cv2.fillConvexPoly(mask, cv2.convexHull(np.round(pixels).astype(np.int32)), 1)
    return mask > 0


def _flight(seed: int) -> Flight:
    poses, drone_ids = [], []
    for drone in range(4):
        for stop in range(5):
            azimuth = drone * math.pi / 2 + stop * 0.3
            radius, height = 2.6 + 0.25 * math.sin(3 * stop + drone), 0.9 + 0.15 * (stop % 3)
            place = np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), height])
            poses.append(camera_pose(place, azimuth + math.pi, math.radians(12.0)))
            drone_ids.append(f"drone-{drone + 1}")
    T_true = np.stack(poses)
    wrong = believed(
        T_true,
        drone_ids,
        np.random.default_rng(seed),
        offset_m=0.08,
        yaw_rad=math.radians(2.0),
        noise_m=0.03,
        noise_rad=math.radians(0.6),
    )
    return Flight(T_true, wrong, drone_ids, [_silhouette(T) for T in T_true])


@pytest.fixture(scope="module")
def flight() -> Flight:
    return _flight(3)


def _fit(flight: Flight, masks: Masks, known: NDArray[np.bool_] | None = None) -> OutlinedPoses:
    n = len(flight.T_true)
    poses = flight.T_believed
    if known is None:
        known = np.zeros(n, bool)
    else:
        poses = np.where(known[:, None, None], flight.T_true, poses)
    return fit_to_outlines(
        poses,
        [CAMERA] * n,
        masks,
        np.full(n, SIGMA_M),
        np.full(n, SIGMA_RAD),
        known,
        PoseConfig(),
        lambda share: None,
    )


def _disagreement_px(T_world_cam: NDArray[np.float64], T_true: NDArray[np.float64]) -> float:
    """Return how badly pictures of the same points meet in space: mean distance in pixels.

    Whatever frame the poses are in, a field can only be learnt from pictures that meet.
    """
    points = np.concatenate([_corners(*block) for block in BLOCKS])
    pixels = np.stack([CAMERA.project(points, T)[0] for T in T_true])
    M = CAMERA.K @ np.linalg.inv(T_world_cam)[:, :3]
    misses = []
    for k in range(len(points)):
        u, v = pixels[:, k].T
        A = np.concatenate([M[:, 2] * u[:, None] - M[:, 0], M[:, 2] * v[:, None] - M[:, 1]])
        weights, met = np.ones(len(A)), np.zeros(3)
        for _ in range(4):
            met = np.linalg.lstsq(A[:, :3] * weights[:, None], -A[:, 3] * weights, rcond=None)[0]
            weights = np.tile(1.0 / (M[:, 2, :3] @ met + M[:, 2, 3]), 2)
        seen = M @ np.append(met, 1.0)
        misses.append(np.linalg.norm(seen[:, :2] / seen[:, 2:] - pixels[:, k], axis=1))
    return float(np.mean(misses))


def test_outlines_bring_wrong_poses_to_agree(flight: Flight) -> None:
    found = _fit(flight, flight.masks)
    assert found.fitted.all()
    before = _disagreement_px(flight.T_believed, flight.T_true)
    assert before > 20.0
    assert _disagreement_px(found.T_world_cam, flight.T_true) < before / 5.0
    assert np.nanmin(found.match) > 0.8


@pytest.mark.parametrize("seed", range(3))
def test_what_is_said_of_the_poses_is_honest(seed: int) -> None:
    flight = _flight(10 + seed)
    found = _fit(flight, flight.masks)
    wrong_m = np.linalg.norm(found.T_world_cam[:, :3, 3] - flight.T_true[:, :3, 3], axis=1)
    ratio = wrong_m / np.sqrt(3.0) / found.sigma_m
    # Only the place across the view is learnt: nobody is sure of centimetres.
    assert 0.3 < float(np.sqrt((ratio**2).mean())) < 1.5
    assert (found.sigma_m <= SIGMA_M).all()


def test_known_poses_stay_and_draw_the_others_to_them(flight: Flight) -> None:
    known = np.arange(len(flight.T_true)) % 2 == 0
    found = _fit(flight, flight.masks, known)
    np.testing.assert_array_equal(found.T_world_cam[known], flight.T_true[known])
    np.testing.assert_array_equal(found.fitted, ~known)
    before = np.where(known[:, None, None], flight.T_true, flight.T_believed)
    after_px = _disagreement_px(found.T_world_cam, flight.T_true)
    assert after_px < _disagreement_px(before, flight.T_true) / 4.0


def test_a_mask_of_something_else_moves_nothing(flight: Flight) -> None:
    masks = list(flight.masks)
    elsewhere = np.zeros_like(masks[4])
    elsewhere[60:200, 100:300] = True
    masks[4], masks[9], masks[12] = elsewhere, None, np.ones_like(elsewhere)
    found = _fit(flight, masks)
    left = [4, 9, 12]
    assert not found.fitted[left].any()
    np.testing.assert_array_equal(found.T_world_cam[left], flight.T_believed[left])
    assert found.sigma_m[left].tolist() == [SIGMA_M] * 3
    rest = np.setdiff1d(np.arange(len(masks)), left)
    assert found.fitted[rest].all()
    before = _disagreement_px(flight.T_believed[rest], flight.T_true[rest])
    assert _disagreement_px(found.T_world_cam[rest], flight.T_true[rest]) < before / 4.0


def test_a_camera_that_faces_away_moves_nothing(flight: Flight) -> None:
    turned = flight.T_believed.copy()
    about = np.diag([-1.0, 1.0, -1.0])
    turned[6, :3, :3] = turned[6, :3, :3] @ about
    turned[7, :3, 3] = np.array([0.05, 0.02, 0.3])  # Amid the object.
    found = _fit(replace(flight, T_believed=turned), flight.masks)
    assert not found.fitted[6]
    assert found.fitted.sum() >= 15
    rest = np.flatnonzero(found.fitted)
    before = _disagreement_px(flight.T_believed[rest], flight.T_true[rest])
    assert _disagreement_px(found.T_world_cam[rest], flight.T_true[rest]) < before / 2.0


def test_three_outlines_or_none_in_common_change_nothing(flight: Flight) -> None:
    few: Masks = [mask if i < 3 else None for i, mask in enumerate(flight.masks)]
    empty: Masks = [np.zeros((CAMERA.height, CAMERA.width), bool)] * len(flight.masks)
    for masks in (few, empty):
        found = _fit(flight, masks)
        assert not found.fitted.any()
        np.testing.assert_array_equal(found.T_world_cam, flight.T_believed)


def test_the_order_of_the_pictures_changes_nothing(flight: Flight) -> None:
    order = np.random.default_rng(0).permutation(len(flight.masks))
    mixed = replace(
        flight,
        T_true=flight.T_true[order],
        T_believed=flight.T_believed[order],
        masks=[flight.masks[i] for i in order],
    )
    found, again = _fit(flight, flight.masks), _fit(mixed, mixed.masks)
    np.testing.assert_allclose(again.T_world_cam, found.T_world_cam[order], atol=1e-6)


def test_pictures_without_texture_are_refined_by_their_outlines(
    flight: Flight, tmp_path: Path
) -> None:
    pictures = []
    for i, mask in enumerate(flight.masks):
        assert mask is not None
        file, mask_file = tmp_path / f"{i}.png", tmp_path / f"{i} mask.png"
        cv2.imwrite(str(file), np.where(mask, 60, 150).astype(np.uint8))
        cv2.imwrite(str(mask_file), mask.astype(np.uint8) * 255)
        pictures.append(
            PosedPicture(
                file,
                flight.T_believed[i],
                SIGMA_M,
                SIGMA_RAD,
                True,
                flight.drone_ids[i],
                float(i),
                mask_file,
            )
        )
    told: list[str] = []

    def refined(*, stop: bool) -> tuple[NDArray[np.float64], str]:
        result = refine_poses(
            pictures,
            CAMERA,
            tmp_path / "work",
            PoseConfig(threads=1, thorough_features=0),
            lambda step, share: told.append(step),
            lambda: stop and "outlines" in told,
        )
        assert not result.refined.any()
        return result.T_world_cam, result.message

    T_found, message = refined(stop=False)
    assert "20 of 20 were fitted to the object's outline, known to about" in message
    before = _disagreement_px(flight.T_believed, flight.T_true)
    assert _disagreement_px(T_found, flight.T_true) < before / 4.0
    T_kept, message = refined(stop=True)
    assert "the flight's poses are kept" in message
    np.testing.assert_array_equal(T_kept, flight.T_believed)
