"""The seed geometry of solids of known shape, seen from true and from wrong poses."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import CameraPose, Region, View
from server.vision.box import box_from_region
from server.vision.config import SeedConfig
from server.vision.seed import SeedError, best_cuts, refine_seed, seed_from_views

# A solid of two parts: a wide foot and a thin post on it.
FOOT = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.25]))
POST = Box3(np.array([-0.05, -0.05, 0.25]), np.array([0.05, 0.05, 0.7]))
LOWER, UPPER = FOOT.lower, np.array([0.3, 0.2, 0.7])


def view_from(azimuth, *, radius=1.9, height=0.8, shift=(0.0, 0.0, 0.0), turn=0.0) -> View:
    """Return the view truly seen from the given place, its pose believed wrong as told."""
    position = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
    T = camera_pose(position, azimuth + np.pi, TELLO_TILT_RAD)
    mask = np.zeros((180, 240), np.uint8)
    for part in (FOOT, POST):
        pixels, _ = TELLO_INTRINSICS.project(part.corners, T)
        hull = cv2.convexHull(np.rint(pixels / 4.0).astype(np.int32))
        cv2.fillConvexPoly(mask, hull, 1)
    region = Region(np.zeros(2), 1.0, 1.0, mask > 0, 4.0, 1.0)
    believed = camera_pose(position + shift, azimuth + np.pi + turn, TELLO_TILT_RAD)
    pose = CameraPose("d", 0.0, believed, np.eye(4) * 0.01)
    return View(pose, TELLO_INTRINSICS, box_from_region(region, 960, 720), region)


def four_views(**kwargs) -> list[View]:
    return [view_from(k * np.pi / 2.0, **kwargs) for k in range(4)]


def iou(a: Box3, b: Box3) -> float:
    size = np.minimum(a.upper, b.upper) - np.maximum(a.lower, b.lower)
    both = float(np.prod(np.maximum(size, 0.0)))
    return both / (a.volume_m3 + b.volume_m3 - both)


def test_true_poses_give_a_box_around_the_object():
    seed = seed_from_views(four_views(), SeedConfig())
    assert seed.views == 4
    assert (seed.outer.lower <= LOWER + 0.03).all()
    assert (seed.outer.upper >= UPPER - 0.03).all()
    # Views of the near face bound the far one loosely (it looks smaller), and one view of four may
    # disagree: the box is never too small but up to a third too wide.
    assert (seed.outer.size <= (UPPER - LOWER) * [1.35, 1.55, 1.1]).all()
    assert iou(seed.outer, Box3(LOWER, UPPER)) > 0.45


def test_the_slices_follow_the_objects_shape():
    seed = seed_from_views(four_views(), SeedConfig())
    assert 2 <= len(seed.boxes) <= 6
    assert all(np.diff([box.lower[2] for box in seed.boxes]) > 0)
    for box in seed.boxes:
        assert (box.lower >= seed.outer.lower - 1e-9).all()
        assert (box.upper <= seed.outer.upper + 1e-9).all()
    # Where only the post is, the slice is far thinner than the foot.
    assert seed.boxes[-1].size[0] < 0.5 * seed.boxes[0].size[0]
    assert sum(box.volume_m3 for box in seed.boxes) < 0.75 * seed.outer.volume_m3


@pytest.mark.slow
@given(seed_number=st.integers(0, 10_000))
@settings(max_examples=12, deadline=None)
def test_poses_wrong_by_decimetres_and_degrees_still_make_a_box(seed_number):
    rng = np.random.default_rng(seed_number)
    views = [
        view_from(
            k * np.pi / 2.0,
            shift=np.clip(rng.normal(0.0, 0.1, 3), -0.2, 0.2) * [1, 1, 0.3],
            turn=float(np.clip(rng.normal(0.0, 0.05), -0.09, 0.09)),
        )
        for k in range(4)
    ]
    outer = seed_from_views(views, SeedConfig(voxels=32)).outer
    # At most 0.2 m of shift and 0.09 rad of turn seen from 2 m, all in one direction.
    assert np.abs(outer.centre - (LOWER + UPPER) / 2.0).max() < 0.38
    # Distances are wrong by up to a tenth and more, and so are sizes.
    ratio = outer.size / (UPPER - LOWER)
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()


def test_one_view_of_something_else_does_not_empty_the_box():
    views = [view_from(k * np.pi / 4.0) for k in range(8)]
    views[3] = view_from(3 * np.pi / 4.0, turn=0.3)
    outer = seed_from_views(views, SeedConfig(voxels=32)).outer
    assert np.abs(outer.centre - (LOWER + UPPER) / 2.0).max() < 0.15


def test_one_drones_views_flown_in_turn_are_enough():
    seed = seed_from_views([view_from(a) for a in (0.0, 0.8, 1.6, 2.4)], SeedConfig(voxels=32))
    assert np.abs(seed.outer.centre - (LOWER + UPPER) / 2.0).max() < 0.2


def test_views_from_one_side_cannot_be_combined():
    with pytest.raises(SeedError, match="azimuth"):
        seed_from_views([view_from(0.0), view_from(0.1), view_from(0.2)], SeedConfig())
    with pytest.raises(SeedError, match="at least 2"):
        seed_from_views([view_from(0.0)], SeedConfig())


def test_views_past_one_another_cannot_be_combined():
    views = [view_from(k * np.pi / 2.0, shift=(0, 0, 2.5 * (-1) ** k)) for k in range(4)]
    with pytest.raises(SeedError, match=r"past one another|in common"):
        seed_from_views(views, SeedConfig())


def test_later_views_never_lose_the_seed():
    seed = seed_from_views(four_views(), SeedConfig())
    assert refine_seed(seed, [view_from(0.0)], SeedConfig()) is seed
    assert (
        refine_seed(seed, [view_from(k * 0.8) for k in range(8)], SeedConfig(voxels=24)).views == 8
    )


def test_cuts_stand_where_the_shape_changes():
    footprints = np.array([9, 9, 9, 1, 1, 4, 4, 4], float)
    n = len(footprints)
    areas = np.zeros((n + 1, n + 1))
    for i in range(n):
        areas[i, i + 1 :] = np.maximum.accumulate(footprints[i:])
    assert best_cuts(areas, 3) == [0, 3, 5, 8]
