"""Who stands where, by outlines: known bodies seen from mixed-up places."""

from __future__ import annotations

from itertools import permutations

import cv2
import numpy as np
import pytest

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import Box, CameraPose, Region, View
from server.vision.arrangement import arrangements, better_arrangements
from server.vision.config import ArrangementConfig

CONFIG = ArrangementConfig()
CENTRE = np.array([0.1, -0.05, 0.45])
# Boxes about the centre: middle and size. A long body with a tall neck at one of its ends.
LONG = (((0.0, 0.0, -0.1), (0.9, 0.2, 0.2)), ((0.35, 0.0, 0.15), (0.15, 0.15, 0.5)))
PILLAR = (((0.0, 0.0, 0.0), (0.4, 0.4, 0.8)),)


def seen(shape, azimuths: list[float], believed: list[float], error_m: float = 0.0) -> list[View]:
    rng = np.random.default_rng(0)
    views = []
    for k, (azimuth, assumed) in enumerate(zip(azimuths, believed, strict=True)):
        mask = np.zeros((180, 240), np.uint8)
        for middle, size in shape:
            signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
            corners = CENTRE + np.array(middle) + signs * np.array(size)
            pixels, _ = TELLO_INTRINSICS.project(corners, pose_at(azimuth))
            outline = cv2.convexHull((pixels / 4.0).round().astype(np.int32).reshape(-1, 1, 2))
            cv2.fillConvexPoly(mask, outline, 1)
        ys, xs = np.nonzero(mask)
        xyxy_px = 4.0 * np.array([xs.min(), ys.min(), xs.max() + 1, ys.max() + 1])
        T = pose_at(assumed)
        T[:2, 3] += error_m * rng.standard_normal(2)
        pose = CameraPose(f"drone-{k + 1}", 0.0, T, np.eye(4) * 0.01)
        region = Region((xyxy_px[:2] + xyxy_px[2:]) / 2, 60.0, 50.0, mask > 0, 4.0, 0.9)
        views.append(View(pose, TELLO_INTRINSICS, Box(xyxy_px, 0.9, touches_edge=False), region))
    return views


def pose_at(azimuth: float) -> np.ndarray:
    offset = 2.2 * np.array([np.cos(azimuth), np.sin(azimuth), np.tan(TELLO_TILT_RAD)])
    return camera_pose(CENTRE + offset, azimuth + np.pi, TELLO_TILT_RAD)


PLACES = [0.05, 1.6, 3.1, 4.75]


def orders_said(order: tuple[int, ...], shape=LONG, error_m: float = 0.1) -> list[tuple[int, ...]]:
    views = seen(shape, [PLACES[k] for k in order], PLACES, error_m)
    tried = arrangements(views, CENTRE, CONFIG)
    assert len(tried) == 6
    return [each.places for each in better_arrangements(tried, CONFIG)]


def test_nothing_is_said_of_drones_that_stand_right() -> None:
    assert orders_said((0, 1, 2, 3)) == []


@pytest.mark.parametrize("order", [(0, 2, 1, 3), (0, 1, 3, 2), (0, 3, 1, 2), (0, 2, 3, 1)])
def test_neighbours_that_changed_places_are_found(order: tuple[int, ...]) -> None:
    assert order in orders_said(order)


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_turning_everybody_is_no_error(quarter: int) -> None:
    """The world's zero of azimuth is where the first drone stands, wherever that is."""
    assert orders_said(tuple((k + quarter) % 4 for k in range(4))) == []


@pytest.mark.parametrize("order", list(permutations(range(4)))[1::5])
def test_nothing_is_said_of_what_looks_alike_from_all_sides(order: tuple[int, ...]) -> None:
    assert orders_said(order, PILLAR) == []


def test_three_drones_or_neighbours_side_by_side_are_not_judged() -> None:
    views = seen(LONG, PLACES, PLACES)
    assert arrangements(views[:3], CENTRE, CONFIG) == []
    assert arrangements(seen(LONG, PLACES, [0.0, 0.3, 3.1, 4.7]), CENTRE, CONFIG) == []
