"""The region search on drawn pictures, and on the simulated room against true silhouettes."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.sim.scenes.catalogue import load_object
from server.sim.world import World
from server.stages import CameraPose, Frame
from server.vision.box import box_from_region
from server.vision.config import RegionConfig
from server.vision.expectation import expected_region
from server.vision.localization import TargetEstimate
from server.vision.region import RegionPrior, RegionTracker, find_region

SCENES = ["human", "guitar", "robot_dog", "recycle_bin"]
TARGET = TargetEstimate(np.array([0.0, 0.0, 0.45]), 0.8, np.diag([0.1, 0.1, 0.2, 0.7]) ** 2)


def drawn_room(centre=(480, 400), seed=0) -> tuple[np.ndarray, np.ndarray]:
    """Return a noisy two-tone room with a blue ellipse, and the ellipse's mask."""
    rng = np.random.default_rng(seed)
    image = np.full((720, 960, 3), (140, 150, 150), np.uint8)
    image[250:] = (80, 110, 140)
    mask = np.zeros((720, 960), np.uint8)
    cv2.ellipse(mask, centre, (80, 130), 0, 0, 360, 1, -1)
    image[mask > 0] = (170, 80, 40)
    noise = cv2.GaussianBlur(rng.normal(0, 40, image.shape), (0, 0), 3)
    return np.clip(image + noise, 0, 255).astype(np.uint8), mask > 0


def full_size(mask: np.ndarray) -> np.ndarray:
    return cv2.resize(mask.astype(np.uint8), (960, 720), interpolation=cv2.INTER_NEAREST) > 0


def iou_of_masks(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def iou_of_boxes(a: np.ndarray, b: np.ndarray) -> float:
    both = float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0)))
    return both / (float(np.prod(a[2:] - a[:2])) + float(np.prod(b[2:] - b[:2])) - both)


def box_of(mask: np.ndarray) -> np.ndarray:
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return np.array([left, top, left + width, top + height], float) - 0.5


@pytest.mark.parametrize("centre", [(480, 400), (300, 450), (640, 360)])
def test_an_object_of_its_own_colour_is_found_where_expected(centre):
    image, truth = drawn_room(centre)
    expected = np.array([centre[0] + 40.0, centre[1] - 30.0])
    prior = RegionPrior(expected, 100.0, np.array([160.0, 260.0]))
    region = find_region(image, RegionConfig(), prior)
    assert region is not None
    assert iou_of_masks(full_size(region.mask), truth) > 0.85
    assert region.confidence > 0.5


def test_an_even_picture_holds_nothing():
    even = np.full((720, 960, 3), 120, np.uint8)
    assert find_region(even, RegionConfig()) is None


def test_a_wall_is_no_object():
    image = np.full((720, 960, 3), (140, 150, 150), np.uint8)
    image[250:] = (80, 110, 140)
    assert find_region(image, RegionConfig()) is None


def test_the_same_picture_gives_the_same_region():
    image, _ = drawn_room()
    first, second = (find_region(image, RegionConfig()) for _ in range(2))
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.mask, second.mask)


def test_the_tracker_follows_a_moving_object_and_reports_its_loss():
    tracker = RegionTracker(RegionConfig(refine_every=4))
    for k in range(10):
        centre = (400 + 12 * k, 400)
        image, truth = drawn_room(centre, seed=k)
        expected = RegionPrior(np.array(centre, float), 60.0, np.array([160.0, 260.0]))
        found = tracker.update(Frame("d", k, 0.1 * k, image, False), expected)
        assert found is not None
        region, box = found
        assert iou_of_masks(full_size(region.mask), truth) > 0.75
        assert iou_of_boxes(box.xyxy_px, box_of(truth)) > 0.7
    even = np.full((720, 960, 3), 120, np.uint8)
    assert tracker.update(Frame("d", 10, 1.0, even, False), None) is None


def judged(name: str, rng: np.random.Generator, views: int = 6) -> list[tuple[float, float]]:
    """Return (box IoU, mask IoU) of an object seen from believed poses that are a little wrong."""
    model = load_object(name)
    tall = float(np.ptp(np.asarray(model.vertices), axis=0).max())
    world = World(model)
    scores = []
    for k in range(views):
        azimuth = 2 * np.pi * k / views
        radius, height = max(1.8, 1.9 * tall), float(rng.uniform(0.7, 1.1))
        position = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
        T = camera_pose(position, azimuth + np.pi + rng.normal(0, 0.05), TELLO_TILT_RAD)
        believed = camera_pose(position + rng.normal(0, 0.05, 3), azimuth + np.pi, TELLO_TILT_RAD)
        pose = CameraPose("d", 0.0, believed, np.diag([0.1, 0.1, 0.02, 0.06]) ** 2)
        prior = expected_region(pose, TARGET, TELLO_INTRINSICS)
        region = find_region(world.render(T), RegionConfig(), prior)
        truth = world.silhouette(T)
        if region is None:
            scores.append((0.0, 0.0))
            continue
        box = box_from_region(region, 960, 720)
        mask_score = iou_of_masks(full_size(region.mask), truth)
        scores.append((iou_of_boxes(box.xyxy_px, box_of(truth)), mask_score))
    world.close()
    return scores


@pytest.mark.slow
def test_the_four_scenes_are_found_in_the_room():
    rng = np.random.default_rng(3)
    scores = np.array([judged(name, rng) for name in SCENES])
    assert (scores[..., 0] > 0.0).mean() >= 0.95
    assert scores[..., 0].mean() >= 0.7
    assert scores[..., 1].mean() >= 0.65


@pytest.mark.slow
@pytest.mark.skipif("DRONERF_TEST_DATA" not in os.environ, reason="DRONERF_TEST_DATA is not set")
@pytest.mark.parametrize("name", ["fire_hydrant", "flight_helmet", "office_chair"])
def test_scanned_objects_are_found_in_the_room(name):
    path = Path(os.environ["DRONERF_TEST_DATA"]) / "meshes" / f"{name}.glb"
    scores = np.array(judged(str(path), np.random.default_rng(4)))
    assert (scores[:, 0] > 0.0).mean() >= 0.8
    assert scores[:, 0].mean() >= 0.5
