"""Whether views are of one object: built from known poses, one made wrong at a time."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import Box, CameraPose, Region, View
from server.vision.agreement import disagreements, nearest_point
from server.vision.config import AgreementConfig

OBJECT = Box3(np.array([-0.3, -0.15, 0.0]), np.array([0.3, 0.15, 0.6]))
SHELF = Box3(np.array([0.9, 1.2, 0.0]), np.array([1.3, 1.5, 0.6]))
TALL = Box3(np.array([-0.3, -0.15, -1.0]), np.array([0.3, 0.15, 1.6]))
CONFIG = AgreementConfig()


def view(k, thing=OBJECT, *, shift=(0.0, 0.0, 0.0), turn=0.0, sigma_m=0.1, sigma_rad=0.03):
    """Return drone ``k``'s view of ``thing``, its pose believed wrong as told."""
    azimuth = k * np.pi / 2.0
    position = np.array([2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), 0.7])
    pixels, _ = TELLO_INTRINSICS.project(
        thing.corners, camera_pose(position, azimuth + np.pi, TELLO_TILT_RAD)
    )
    xyxy = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    believed = camera_pose(position + shift, azimuth + np.pi + turn, TELLO_TILT_RAD)
    covariance = np.diag([sigma_m**2] * 3 + [sigma_rad**2])
    pose = CameraPose(f"drone-{k + 1}", 0.0, believed, covariance)
    region = Region(np.zeros(2), 1.0, 1.0, np.ones((180, 240), bool), 4.0, 0.9)
    return View(pose, TELLO_INTRINSICS, Box(xyxy, 0.9, touches_edge=False), region)


def test_views_of_one_object_agree():
    assert disagreements([view(k) for k in range(4)], CONFIG) == []


@pytest.mark.parametrize("wrong", range(4))
def test_the_one_that_looks_elsewhere_is_named(wrong):
    views = [view(k, SHELF if k == wrong else OBJECT) for k in range(4)]
    found = disagreements(views, CONFIG)
    assert [(each.drone_id, each.index, each.kind) for each in found] == [
        (f"drone-{wrong + 1}", wrong, "place")
    ]
    assert found[0].measured > found[0].allowed
    assert f"{found[0].measured:.2f} m" in found[0].text


@pytest.mark.parametrize("wrong", range(4))
def test_the_one_with_a_box_of_another_size_is_named(wrong):
    views = [view(k, TALL if k == wrong else OBJECT) for k in range(4)]
    found = disagreements(views, CONFIG)
    assert [(each.index, each.kind) for each in found] == [(wrong, "size")]
    assert found[0].measured > found[0].allowed


def test_a_box_that_the_edge_cuts_off_may_be_too_low_but_not_too_high():
    def cut_off(thing):
        whole = view(0, thing)
        box = Box(whole.box.xyxy_px, 0.9, touches_edge=True)
        return [View(whole.pose, whole.intrinsics, box, whole.region), *map(view, (1, 2, 3))]

    inset = np.array([0.0, 0.0, 0.22])
    low = Box3(OBJECT.lower + inset, OBJECT.upper - inset)
    assert disagreements(cut_off(low), CONFIG) == []
    assert [each.index for each in disagreements(cut_off(TALL), CONFIG)] == [0]


def test_without_a_majority_all_are_named():
    both = disagreements([view(0), view(1, SHELF, sigma_m=0.01)], AgreementConfig(gate=0.5))
    assert [each.index for each in both] == [0, 1]
    assert disagreements([view(0)], CONFIG) == []
    assert disagreements([], CONFIG) == []


def test_what_a_pose_may_be_wrong_by_is_no_disagreement():
    shifted = view(2, shift=(0.0, 0.2, 0.5), sigma_m=0.2)
    others = [view(k) for k in (0, 1, 3)]
    assert disagreements([*others, shifted], CONFIG) == []
    surer = view(2, shift=(0.0, 0.2, 0.5), sigma_m=0.02, sigma_rad=0.005)
    sure = [view(k, sigma_m=0.02, sigma_rad=0.005) for k in (0, 1, 3)]
    assert [each.index for each in disagreements([*sure, surer], CONFIG)] == [3]


@given(number=st.integers(0, 100_000))
@settings(max_examples=60, deadline=None)
def test_errors_within_two_sigma_never_disagree(number):
    rng = np.random.default_rng(number)
    views = [
        view(
            k,
            shift=np.clip(rng.normal(0.0, 0.1, 3), -0.15, 0.15),
            turn=float(np.clip(rng.normal(0.0, 0.03), -0.045, 0.045)),
        )
        for k in range(4)
    ]
    assert disagreements(views, CONFIG) == []


@given(number=st.integers(0, 100_000), wrong=st.integers(0, 3))
@example(number=164, wrong=3)
@settings(max_examples=60, deadline=None)
def test_the_wrong_one_is_named_though_the_poses_err(number, wrong):
    rng = np.random.default_rng(number)
    views = [
        view(
            k,
            SHELF if k == wrong else OBJECT,
            shift=np.clip(rng.normal(0.0, 0.05, 3), -0.1, 0.1),
            sigma_m=0.06,
            sigma_rad=0.02,
        )
        for k in range(4)
    ]
    assert [each.index for each in disagreements(views, CONFIG)] == [wrong]


def test_the_nearest_point_of_rays_through_a_point_is_it():
    point = np.array([0.2, -0.1, 0.4])
    origins = np.array([[2.0, 0.0, 1.0], [0.0, 2.0, 0.7], [-2.0, 0.3, 0.2]])
    directions = point - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(nearest_point(origins, directions), point, atol=1e-6)
