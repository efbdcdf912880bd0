"""Where the object stands by what was picked: one ray, several rays, cut-off boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import CameraPose, SeedGeometry
from server.vision.config import LocalizationConfig
from server.vision.parts import drawn_part
from server.vision.picks import Pick, box_around, expected_size, picked_target, shows
from server.vision.target import TargetEstimate, prior_target

Array = NDArray[np.float64]
CAMERA = TELLO_INTRINSICS
PRIOR = prior_target(LocalizationConfig())
SURE = np.diag([0.03, 0.03, 0.02, 0.02]) ** 2


def pose_at(azimuth_rad: float, radius_m: float = 2.0, height_m: float = 1.0) -> CameraPose:
    place = np.array([radius_m * np.cos(azimuth_rad), radius_m * np.sin(azimuth_rad), height_m])
    return CameraPose("d", 0.0, camera_pose(place, azimuth_rad + np.pi, TELLO_TILT_RAD), SURE)


def pick_of(centre: Array, height_m: float, pose: CameraPose) -> Pick:
    """Return a pick that frames an upright stick of that height, seen without error."""
    ends = centre + np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * height_m
    pixels, _ = CAMERA.project(np.vstack([ends, centre]), pose.T_world_cam)
    half_px = abs(pixels[0, 1] - pixels[1, 1]) / 2.0
    middle = pixels[2]
    return Pick(np.concatenate([middle - half_px, middle + half_px]), pose, CAMERA)


def aside_m(pick: Pick, point: Array) -> float:
    """Return how far ``point`` lies off the ray of a pick, seen from above.

    Up and down a box that the picture cuts off says little.
    """
    centre = (pick.xyxy_px[:2] + pick.xyxy_px[2:]) / 2.0
    ray = pick.pose.T_world_cam[:3, :3] @ CAMERA.directions(centre[None])[0]
    offset = point - pick.pose.position_world
    return float(abs(np.cross(offset, ray)[2]) / np.hypot(*ray[:2]))


@given(
    x=st.floats(-0.5, 0.5), y=st.floats(-0.5, 0.5), z=st.floats(0.3, 0.7), turn=st.floats(0.6, 2.5)
)
@settings(max_examples=40, deadline=None)
def test_two_picks_triangulate(x: float, y: float, z: float, turn: float) -> None:
    centre = np.array([x, y, z])
    picks = [pick_of(centre, 0.5, pose_at(azimuth)) for azimuth in (0.3, 0.3 + turn)]
    # The prior's pull towards the middle fades with what the picks know.
    unsure = TargetEstimate(PRIOR.centre, 0.5, PRIOR.covariance * 100.0)
    found = picked_target(picks, unsure)
    assert np.linalg.norm(found.centre - centre) < 0.02
    assert found.height_m == pytest.approx(0.5, rel=0.1)
    assert np.linalg.eigvalsh(found.covariance).min() > 0.0


@given(x=st.floats(-0.8, 0.8), y=st.floats(-0.6, 0.6), azimuth=st.floats(0.0, 6.28))
@settings(max_examples=40, deadline=None)
def test_one_pick_moves_the_estimate_onto_its_ray(x: float, y: float, azimuth: float) -> None:
    pick = pick_of(np.array([x, y, 0.45]), 0.6, pose_at(azimuth))
    found = picked_target([pick], PRIOR)
    before, after = aside_m(pick, PRIOR.centre), aside_m(pick, found.centre)
    assert after <= max(0.45 * before, 0.05)
    # Sideways it knows more than along the ray.
    ray = pick.pose.T_world_cam[:3, 2]
    level = np.array([-ray[1], ray[0], 0.0]) / np.hypot(*ray[:2])
    spread = found.covariance[:3, :3]
    assert level @ spread @ level < ray @ spread @ ray


def test_a_third_pick_makes_it_surer() -> None:
    centre = np.array([0.4, -0.3, 0.5])
    picks = [pick_of(centre, 0.6, pose_at(azimuth)) for azimuth in (0.0, 1.6, 3.1)]
    sigmas = [picked_target(picks[:count], PRIOR).sigma_m for count in (1, 2, 3)]
    assert sigmas[0] > sigmas[1] > sigmas[2]


def test_a_pick_shows_the_object_only_where_it_is() -> None:
    pick = pick_of(np.array([0.0, 0.0, 0.5]), 0.6, pose_at(0.5))
    at = [np.array([0.0, 0.0, 0.5]), np.array([1.0, -1.0, 0.5]), np.array([8.0, 4.5, 1.0])]
    targets = [TargetEstimate(centre, 0.6, np.eye(4) * 1e-4) for centre in at]
    assert [shows(pick, target) for target in targets] == [True, False, False]


def test_a_cut_off_box_says_little_about_the_height() -> None:
    pose = pose_at(0.0, radius_m=1.2)
    whole = pick_of(np.array([0.0, 0.0, 0.6]), 0.4, pose)
    cut = Pick(whole.xyxy_px.copy(), pose, CAMERA)
    cut.xyxy_px[3] = CAMERA.height - 1.0
    sigmas = [float(picked_target([pick], PRIOR).covariance[3, 3]) for pick in (whole, cut)]
    assert sigmas[1] > 1.5 * sigmas[0]


@given(
    x=st.floats(0.0, 959.0),
    y=st.floats(0.0, 719.0),
    width=st.floats(0.1, 5000.0),
    height=st.floats(0.1, 5000.0),
)
def test_a_click_becomes_a_box_in_the_picture(
    x: float, y: float, width: float, height: float
) -> None:
    left, top, right, bottom = box_around(np.array([x, y]), np.array([width, height]), CAMERA)
    assert 0.0 <= left <= x <= right <= 959.0
    assert 0.0 <= top <= y <= bottom <= 719.0
    assert right - left >= 0.03 * 960 - 1.0


def test_a_click_has_the_size_that_is_expected() -> None:
    box = box_around(np.array([480.0, 360.0]), np.array([200.0, 100.0]), CAMERA)
    assert box == pytest.approx([380.0, 310.0, 580.0, 410.0])
    unknown = box_around(np.array([480.0, 360.0]), None, CAMERA)
    assert unknown[2] - unknown[0] == pytest.approx(0.35 * 720)


def test_the_expected_size_follows_depth_and_geometry() -> None:
    target = TargetEstimate(np.array([0.0, 0.0, 0.5]), 0.8, np.eye(4))
    far = expected_size(pose_at(0.0, 3.0), target, CAMERA, None)
    near = expected_size(pose_at(0.0, 1.5), target, CAMERA, None)
    assert far is not None
    assert near is not None
    assert near[1] > 1.7 * far[1]
    outer = Box3(np.array([-0.1, -0.4, 0.0]), np.array([0.1, 0.4, 0.5]))
    seed = SeedGeometry(outer, (outer,), 4)
    wide = expected_size(pose_at(0.0), target, CAMERA, seed)
    assert wide is not None
    assert wide[0] > 1.3 * wide[1]
    behind = TargetEstimate(np.array([5.0, 0.0, 0.5]), 0.8, np.eye(4))
    assert expected_size(pose_at(0.0), behind, CAMERA, None) is None


def test_a_drawn_part_is_what_appears_in_the_box() -> None:
    lower = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 0.5]))
    upper = Box3(np.array([-0.1, -0.1, 0.5]), np.array([0.1, 0.1, 1.0]))
    outer = Box3(lower.lower, np.array([0.3, 0.3, 1.0]))
    seed = SeedGeometry(outer, (lower, upper), 4)
    pose = pose_at(0.0, 2.5)
    pixels, _ = CAMERA.project(upper.corners, pose.T_world_cam)
    drawn = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    part = drawn_part(seed, pose.T_world_cam, CAMERA, drawn)
    assert part is not None
    assert part.grown(1e-9).contains(upper.corners).all()
    assert part.upper[2] == pytest.approx(1.0)
    # What lies lower may be grazed by the drawing, but not its foot.
    assert part.lower[2] > 0.25
    assert outer.grown(1e-9).contains(part.corners).all()
    assert drawn_part(seed, pose.T_world_cam, CAMERA, np.array([0.0, 0.0, 40.0, 40.0])) is None
