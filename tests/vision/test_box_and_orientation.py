"""Boxes from masks, and equation 4 with the side it turns to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.axes import wrap_angle
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import Box, Region
from server.vision.box import box_from_region
from server.vision.orientation import orientation, yaw_error


def region_of(mask: np.ndarray) -> Region:
    return Region(np.zeros(2), 1.0, 1.0, mask, 4.0, 0.8)


def test_the_box_covers_the_masks_cells():
    mask = np.zeros((180, 240), bool)
    mask[10:20, 30:50] = True
    box = box_from_region(region_of(mask), 960, 720)
    np.testing.assert_allclose(box.xyxy_px, [119.5, 39.5, 199.5, 79.5])
    assert not box.touches_edge
    assert box.confidence == 0.8


@pytest.mark.parametrize("cell", [(0, 100), (179, 100), (90, 0), (90, 239)])
def test_a_mask_at_the_edge_says_so(cell):
    mask = np.zeros((180, 240), bool)
    mask[90, 100] = mask[cell] = True
    assert box_from_region(region_of(mask), 960, 720).touches_edge


def test_an_empty_mask_has_no_box():
    with pytest.raises(ValueError, match="empty"):
        box_from_region(region_of(np.zeros((180, 240), bool)), 960, 720)


def test_equation_four_is_the_cosine_between_the_two():
    camera, centroid = np.array([2.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0])
    assert orientation(camera, centroid, np.array([3.0, 0.0, 0.0])) == pytest.approx(1.0)
    assert orientation(camera, centroid, np.array([1.0, 1.0, 0.0])) == pytest.approx(np.sqrt(0.5))
    with pytest.raises(ValueError, match="distinct"):
        orientation(camera, camera, centroid)


@given(
    azimuth=st.floats(-np.pi, np.pi),
    error=st.floats(-0.4, 0.4),
    height=st.floats(0.3, 1.2),
)
def test_turning_by_the_yaw_error_faces_the_object(azimuth, error, height):
    position = np.array([2 * np.cos(azimuth), 2 * np.sin(azimuth), height])
    yaw = wrap_angle(azimuth + np.pi + error)
    target = np.array([[0.0, 0.0, 0.4]])
    pixel, _ = TELLO_INTRINSICS.project(target, camera_pose(position, yaw, TELLO_TILT_RAD))
    box = Box(np.concatenate([pixel[0] - 20, pixel[0] + 20]), 1.0, False)
    assert yaw_error(box, TELLO_INTRINSICS, TELLO_TILT_RAD) == pytest.approx(-error, abs=1e-6)
