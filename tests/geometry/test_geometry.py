"""Poses, cameras and boxes: known answers, and what goes there comes back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.axes import opencv_from_opengl, opengl_from_opencv, wrap_angle
from server.geometry.boxes import Box3, union
from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.geometry.poses import (
    camera_pose,
    fit_similarity,
    inverse,
    look_at,
    transform_points,
    wxyz_from_rotation,
    yaw_of_camera,
)

# Whole micrometres: squares of far smaller numbers vanish, and no drone is that small.
coordinate = st.floats(-5, 5).map(lambda metres: round(metres, 6))
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)
angle = st.floats(-np.pi, np.pi)
lens = Intrinsics(960, 720, 921.0, 915.0, 470.0, 352.0, (-0.03, 0.1, 0.001, -0.006, 0.0))


def test_a_level_camera_sees_left_and_up_where_they_are():
    T = camera_pose(np.array([1.0, 2.0, 3.0]), 0.0, 0.0)
    ahead, left, up = np.eye(3) + np.array([1.0, 2.0, 3.0])
    seen = transform_points(inverse(T), np.stack([ahead, left, up]))
    np.testing.assert_allclose(seen, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)


def test_a_positive_tilt_looks_down():
    T = camera_pose(np.zeros(3), 0.3, np.deg2rad(12.0))
    assert T[2, 2] == pytest.approx(-np.sin(np.deg2rad(12.0)))
    assert yaw_of_camera(T) == pytest.approx(0.3)


@given(position=point, yaw=angle, tilt=st.floats(-0.5, 1.0))
def test_poses_are_rigid_and_can_be_undone(position, yaw, tilt):
    T = camera_pose(position, yaw, tilt)
    np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert wrap_angle(yaw_of_camera(T) - yaw) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(opencv_from_opengl(opengl_from_opencv(T)), T)
    assert np.linalg.norm(wxyz_from_rotation(T[:3, :3])) == pytest.approx(1.0)


def test_opengl_looks_along_minus_z():
    T = opengl_from_opencv(camera_pose(np.zeros(3), 0.0, 0.0))
    np.testing.assert_allclose(-T[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)


@given(pixel=st.tuples(st.floats(0, 959), st.floats(0, 719)), depth=st.floats(0.3, 9.0))
def test_what_a_pixel_sees_is_projected_back_onto_it(pixel, depth):
    T = look_at(np.array([1.0, -2.0, 1.5]), np.array([0.2, 0.1, 0.4]))
    ray = lens.directions(np.array([pixel]))[0]
    seen = transform_points(T, (ray * depth)[None])
    pixels, depths = lens.project(seen, T)
    np.testing.assert_allclose(pixels[0], pixel, atol=1e-3)
    assert depths[0] == pytest.approx(ray[2] * depth)


def test_points_behind_the_camera_have_no_pixel():
    pixels, depths = TELLO_INTRINSICS.project(
        np.array([[-1.0, 0.0, 0.0]]), camera_pose(np.zeros(3), 0, 0)
    )
    assert np.isnan(pixels).all()
    assert depths[0] < 0
    assert not TELLO_INTRINSICS.contains(pixels)[0]


def test_resizing_keeps_rays():
    half = TELLO_INTRINSICS.scaled(0.5)
    np.testing.assert_allclose(
        half.directions(np.array([[100.0, 50.0]])),
        TELLO_INTRINSICS.directions(np.array([[200.5, 100.5]])),
    )


@given(seed=st.integers(0, 10_000), scale=st.floats(0.1, 5.0), yaw=angle)
def test_a_similarity_is_found_again(seed, scale, yaw):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(6, 3))
    R = camera_pose(np.zeros(3), yaw, 0.4)[:3, :3]
    target = scale * source @ R.T + [1.0, -2.0, 0.5]
    found = fit_similarity(source, target)
    assert found.scale == pytest.approx(scale)
    np.testing.assert_allclose(found.points(source), target, atol=1e-8)
    np.testing.assert_allclose(found.R, R, atol=1e-6)


def test_too_few_or_coinciding_points_are_refused():
    with pytest.raises(ValueError, match="three"):
        fit_similarity(np.eye(3)[:2], np.eye(3)[:2])
    with pytest.raises(ValueError, match="coincide"):
        fit_similarity(np.ones((4, 3)), np.eye(4)[:, :3])


@given(a=point, b=point, p=point)
def test_boxes_measure_distance_and_hold_their_corners(a, b, p):
    box = Box3(np.minimum(a, b), np.maximum(a, b))
    assert box.contains(box.corners).all()
    inside = bool(box.contains(p[None])[0])
    assert (box.distance(p) == 0.0) == inside
    assert union((box, box.grown(0.1))).contains(box.grown(0.1).corners).all()


def test_bad_boxes_and_views_are_refused():
    with pytest.raises(ValueError, match="inside out"):
        Box3(np.ones(3), np.zeros(3))
    with pytest.raises(ValueError, match="finite"):
        Box3(np.zeros(3), np.array([1.0, np.nan, 1.0]))
    with pytest.raises(ValueError, match="coincide"):
        look_at(np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="straight"):
        look_at(np.zeros(3), np.array([0.0, 0.0, -1.0]))
