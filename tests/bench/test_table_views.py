"""The table's test views: where they stand, where they look, and what is marked in them."""

from __future__ import annotations

import numpy as np
import pytest

from server.bench.table.views import CAMERA, COUNT, draw_views, ring_radius, true_box, view_poses
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import PlannerConfig
from server.planner.ring import frame_fill, standard_ring
from server.sim.scenes.catalogue import load_object

CENTRE = np.array([0.3, -0.2, 0.5])


def test_views_stand_at_one_distance_between_5_and_60_degrees_and_look_at_the_middle() -> None:
    poses = view_poses(CENTRE, 1.7)
    offsets = poses[:, :3, 3] - CENTRE
    assert poses.shape == (COUNT, 4, 4) == (40, 4, 4)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 1.7)
    elevations = np.rad2deg(np.arcsin(offsets[:, 2] / 1.7))
    assert 5.0 < elevations.min() < 7.0
    assert 57.0 < elevations.max() < 60.0
    for pose in poses:
        pixel, depth = CAMERA.project(CENTRE[None], pose)
        np.testing.assert_allclose(pixel[0], [CAMERA.cx, CAMERA.cy], atol=1e-6)
        assert depth[0] == pytest.approx(1.7)
    assert (CAMERA.width, CAMERA.height) == (480, 360)


def test_views_are_even_over_the_sphere_between_the_two_elevations() -> None:
    offsets = (view_poses(CENTRE, 2.0)[:, :3, 3] - CENTRE) / 2.0
    # By Archimedes' theorem equal areas are equal heights.
    np.testing.assert_allclose(np.diff(offsets[:, 2]), np.diff(offsets[:, 2])[0])
    quarters = np.bincount(
        (np.arctan2(offsets[:, 1], offsets[:, 0]) // (np.pi / 2)).astype(int) + 2
    )
    assert quarters.min() >= 9
    apart = np.linalg.norm(offsets[:, None] - offsets[None], axis=2) + 9.0 * np.eye(COUNT)
    assert apart.min(axis=1).max() < 2.0 * apart.min(axis=1).min()


def test_the_radius_is_that_of_the_standard_ring_around_the_true_object() -> None:
    model = load_object("recycle_bin")
    box, config = true_box(model), PlannerConfig()
    view = standard_ring(box, 1, 1, TELLO_INTRINSICS, TELLO_TILT_RAD, config, [0.0])[0][0]
    radius = float(np.hypot(*(view.position_world - box.centre)[:2]))
    assert ring_radius(model) == pytest.approx(radius, abs=2e-3)
    fill = frame_fill(box, view, TELLO_INTRINSICS, TELLO_TILT_RAD)
    assert 0.5 < fill <= config.ring.fill + 1e-3


@pytest.mark.slow
def test_the_silhouette_is_the_object_and_the_whole_object() -> None:
    model = load_object("recycle_bin")
    views = draw_views(model, 0, count=3)
    for pose, mask, image in zip(views.T_world_cam, views.masks, views.images_rgb, strict=True):
        assert image.shape == (360, 480, 3)
        pixels, _ = views.camera.project(np.asarray(model.vertices), pose)
        rows, columns = np.nonzero(mask)
        np.testing.assert_allclose(pixels.min(axis=0), [columns.min(), rows.min()], atol=2.5)
        np.testing.assert_allclose(pixels.max(axis=0), [columns.max(), rows.max()], atol=2.5)
