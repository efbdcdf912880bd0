"""The seed geometry of solids of known shape, seen from true and from wrong poses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import CameraPose, Priority, Region, SeedGeometry, View
from server.vision.box import box_from_region
from server.vision.config import SeedConfig
from server.vision.seed import (
    SeedError,
    kept_within,
    refine_seed,
    seed_from_views,
    silhouette_match,
)

# A solid of two parts: a wide foot and a thin post on it.
FOOT = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.25]))
POST = Box3(np.array([-0.05, -0.05, 0.25]), np.array([0.05, 0.05, 0.7]))
LOWER, UPPER = FOOT.lower, np.array([0.3, 0.2, 0.7])


def view_from(
    azimuth, *, radius=1.9, height=0.8, shift=(0.0, 0.0, 0.0), turn=0.0, sigma_m=0.1
) -> View:
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
    pose = CameraPose("d", 0.0, believed, np.eye(4) * sigma_m**2)
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


def inside(boxes, points):
    return np.any([box.contains(points) for box in boxes], axis=0)


def on_surface(box, number, count=400):
    """Return points ``(count, 3)`` on a box's faces."""
    rng = np.random.default_rng(number)
    points = rng.random((count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = rng.integers(0, 2, count)
    return box.lower + points * box.size


def test_the_boxes_follow_the_objects_shape():
    seed = seed_from_views(four_views(sigma_m=0.001), SeedConfig())
    assert 2 <= len(seed.boxes) <= 12
    for box in seed.boxes:
        assert (box.lower >= seed.outer.lower - 1e-9).all()
        assert (box.upper <= seed.outer.upper + 1e-9).all()
    # Towards the post's top the boxes grow thinner than the foot.
    assert seed.boxes[-1].size[0] < 0.6 * FOOT.size[0]
    # Nearly all of the surface is inside, and less than the upright box's volume is spent on it.
    surface = np.concatenate([on_surface(FOOT, 0), on_surface(POST, 1)])
    assert inside(seed.boxes, surface).mean() >= 0.95
    volume = sum(box.volume_m3 for box in seed.boxes)
    assert volume < 1.3 * Box3(LOWER, UPPER).volume_m3


def test_later_views_make_the_boxes_tighter():
    first = seed_from_views(four_views(), SeedConfig())
    later = [view_from(k * np.pi / 8.0, height=0.5 + 0.2 * (k % 3)) for k in range(16)]
    refined = refine_seed(first, [*four_views(), *later], SeedConfig())
    assert refined.views == 20
    surface = np.concatenate([on_surface(FOOT, 0), on_surface(POST, 1)])
    assert inside(refined.boxes, surface).mean() >= 0.95
    assert sum(b.volume_m3 for b in refined.boxes) < sum(b.volume_m3 for b in first.boxes)


def test_a_part_that_one_view_lost_stays_and_one_views_leak_goes():
    views = four_views()
    lost = views[1].region.mask.copy()
    rows = np.nonzero(lost.any(axis=1))[0]
    lost[: (rows[0] + rows[-1]) // 2] = False  # The post is not seen by this one.
    views[1] = with_mask(views[1], lost)
    seed = seed_from_views(views, SeedConfig())
    # Its own box is centred lower, too, which turns the view: most of the post stays, not all.
    assert inside(seed.boxes, on_surface(POST, 1)).mean() >= 0.7
    strict = seed_from_views(views, SeedConfig(least_agreement=0.94, unsure_views=1e-6))
    assert inside(strict.boxes, on_surface(POST, 1)).mean() < 0.6
    leaky = four_views()
    grown = leaky[1].region.mask.copy()
    columns = np.nonzero(grown.any(axis=0))[0]
    grown[rows[-1] - 12 : rows[-1], columns[-1] : columns[-1] + 40] = True  # A shadow comes along.
    leaky[1] = with_mask(leaky[1], grown)
    volume = sum(box.volume_m3 for box in seed_from_views(leaky, SeedConfig()).boxes)
    clean = sum(box.volume_m3 for box in seed_from_views(four_views(), SeedConfig()).boxes)
    assert volume < 1.25 * clean


def without_post(view) -> View:
    """Return the view of a search that lost the upper half of what it should show."""
    mask = view.region.mask.copy()
    rows = np.nonzero(mask.any(axis=1))[0]
    mask[: (rows[0] + rows[-1]) // 2] = False
    return with_mask(view, mask)


@pytest.mark.parametrize("lost", [(0, 2), (1, 3), (0, 1)])
def test_a_top_that_two_views_of_four_lost_stays_and_is_not_spread(lost):
    views = four_views(sigma_m=0.001)
    some = [without_post(view) if k in lost else view for k, view in enumerate(views)]
    boxes = seed_from_views(some, SeedConfig()).boxes
    assert inside(boxes, on_surface(POST, 1)).mean() >= 0.95
    clean = sum(box.volume_m3 for box in seed_from_views(views, SeedConfig()).boxes)
    assert sum(box.volume_m3 for box in boxes) < 1.3 * clean


def test_a_top_that_one_view_alone_shows_goes():
    views = [without_post(view) if k else view for k, view in enumerate(four_views(sigma_m=0.001))]
    boxes = seed_from_views(views, SeedConfig()).boxes
    assert inside(boxes, on_surface(POST, 1)).mean() < 0.6


def test_many_views_that_show_nothing_above_are_believed():
    views = [view_from(k * np.pi / 8.0, sigma_m=0.001) for k in range(16)]
    some = [view if k % 8 == 0 else without_post(view) for k, view in enumerate(views)]
    boxes = seed_from_views(some, SeedConfig()).boxes
    assert inside(boxes, on_surface(POST, 1)).mean() < 0.6


def test_a_view_of_known_pose_is_not_turned_to_where_its_box_has_its_centre():
    views = four_views(sigma_m=1e-4)
    views[1] = without_post(views[1])

    def foot_inside(config):
        return inside(seed_from_views(views, config).boxes, on_surface(FOOT, 0)).mean()

    assert foot_inside(SeedConfig()) >= 0.97
    # Turned all the way, it would lift the foot off the floor.
    assert foot_inside(SeedConfig(centroid_share=1e-9)) < 0.85


def with_mask(view, mask) -> View:
    region = Region(np.zeros(2), 1.0, 1.0, mask, 4.0, 1.0)
    return View(view.pose, view.intrinsics, box_from_region(region, 960, 720), region)


def test_confidence_is_one_number_per_box_and_highest_where_all_views_agree():
    seed = seed_from_views(four_views(), SeedConfig())
    assert len(seed.confidences) == len(seed.boxes)
    assert all(0.0 < value <= 1.0 for value in seed.confidences)
    wrong = [*four_views()[:3], view_from(1.5 * np.pi, turn=0.12, shift=(0.0, 0.3, 0.2))]
    unsure = seed_from_views(wrong, SeedConfig())
    assert np.mean(unsure.confidences) < np.mean(seed.confidences)


def test_boxes_match_the_views_when_they_are_neither_too_small_nor_too_large():
    views = four_views()
    assert silhouette_match(views, [FOOT, POST]) > 0.95
    assert silhouette_match(views, [FOOT]) < 0.9
    assert silhouette_match(views, [Box3(LOWER, UPPER)]) < 0.8


def test_one_bad_view_has_no_say_in_how_well_boxes_match():
    views = four_views()
    views[2] = with_mask(views[2], np.ones_like(views[2].region.mask))
    assert silhouette_match(views, [FOOT, POST]) > 0.95


def test_what_each_view_took_along_elsewhere_does_not_make_the_boxes_grow():
    clean = [view_from(k * np.pi / 8.0, sigma_m=0.001) for k in range(16)]
    views = []
    for k, view in enumerate(clean):
        # Each time something else beside or above the object, as furniture behind it is.
        mask = view.region.mask.copy()
        rows, columns = np.nonzero(mask)
        left = columns.min() - 45 if k % 2 else columns.max()
        middle = (rows.min() + rows.max()) // 2
        mask[rows.min() - 14 * (k % 3) : middle, left : left + 45] = True
        views.append(with_mask(view, mask))
    config = SeedConfig()
    grown = sum(box.volume_m3 for box in seed_from_views(views, config).boxes)
    assert grown < 1.4 * sum(box.volume_m3 for box in seed_from_views(clean, config).boxes)


def covered_share(views, boxes):
    """Return how much of the views' boxes, in the median, the boxes' extent accounts for."""
    corners = np.concatenate([box.corners for box in boxes])
    shares = []
    for view in views:
        pixels, _ = view.intrinsics.project(corners, view.pose.T_world_cam)
        low = np.maximum(pixels.min(axis=0), view.box.xyxy_px[:2])
        high = np.minimum(pixels.max(axis=0), view.box.xyxy_px[2:])
        shares.append((np.maximum(high - low, 0.0) / view.box.size_px).min())
    return np.median(shares)


@pytest.mark.slow
@given(number=st.integers(0, 10_000))
@settings(max_examples=12, deadline=None)
def test_many_views_from_wrong_poses_still_make_boxes_that_hold_the_object(number):
    rng = np.random.default_rng(number)
    views = [
        view_from(
            k * np.pi / 6.0,
            shift=np.clip(rng.normal(0.0, 0.25, 3), -0.4, 0.4) * [1, 1, 0.3],
            turn=float(np.clip(rng.normal(0.0, 0.05), -0.09, 0.09)),
        )
        for k in range(12)
    ]
    seed = seed_from_views(views, SeedConfig(voxels=32))
    lower = np.min([box.lower for box in seed.boxes], axis=0)
    upper = np.max([box.upper for box in seed.boxes], axis=0)
    assert np.abs((lower + upper) / 2.0 - (LOWER + UPPER) / 2.0).max() < 0.4
    # The sizes hold roughly, though every camera stands up to 0.4 m from where it believes.
    assert ((upper - lower) > 0.6 * (UPPER - LOWER)).all()
    assert ((upper - lower) < 2.0 * (UPPER - LOWER)).all()
    assert covered_share(views, seed.boxes) > 0.6


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
    wanted = (Priority(POST, 3.0),)
    refined = refine_seed(replace(seed, priorities=wanted), four_views(), SeedConfig(voxels=24))
    assert refined.priorities == wanted
    assert (
        refine_seed(seed, [view_from(k * 0.8) for k in range(8)], SeedConfig(voxels=24)).views == 8
    )


@pytest.mark.parametrize("weight", [0.0, -1.0, np.inf, np.nan])
def test_a_priority_has_a_weight(weight):
    with pytest.raises(ValueError, match="weight"):
        Priority(POST, weight)


def test_boxes_are_kept_within_the_outer_box():
    known = SeedGeometry(Box3(LOWER, UPPER), (FOOT, POST), 4, (0.9, 0.8))
    tight = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.2]))
    kept = kept_within(known, tight)
    assert kept.outer is tight
    assert len(kept.boxes) == len(kept.confidences) == 1
    np.testing.assert_allclose(kept.boxes[0].upper, tight.upper)
    elsewhere = Box3(np.array([5.0, 5.0, 0.0]), np.array([6.0, 6.0, 1.0]))
    assert kept_within(known, elsewhere).boxes == (elsewhere,)
