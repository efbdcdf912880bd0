from __future__ import annotations

import cv2
import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.poses import camera_pose
from server.scene.config import SceneConfig
from server.scene.shapes import (
    box_edges,
    circle,
    dimmed,
    node_name,
    path_segments,
    picture_from_jpeg,
    placed,
    rgb_from_hex,
)


def test_colours() -> None:
    assert rgb_from_hex("#1f77b4") == (0x1F, 0x77, 0xB4)
    for wrong in ("", "#12", "red", "#12345g", "1f77b4f"):
        assert rgb_from_hex(wrong) == (150, 150, 150)
    assert dimmed((0, 0, 0)) == (161, 161, 161)


def test_a_box_has_twelve_edges_along_its_axes() -> None:
    box = Box3(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]))
    edges = box_edges((box, box))
    assert edges.shape == (24, 2, 3)
    lengths = edges[:12, 1] - edges[:12, 0]
    assert (np.count_nonzero(lengths, axis=1) == 1).all()
    np.testing.assert_allclose(np.sort(lengths.sum(axis=1)), [1] * 4 + [2] * 4 + [3] * 4)
    assert len({tuple(sorted(map(tuple, edge.tolist()))) for edge in edges[:12]}) == 12


def test_the_circle_is_closed_level_and_round() -> None:
    segments = circle(2.0, 0.1)
    np.testing.assert_allclose(np.linalg.norm(segments[..., :2], axis=-1), 2.0, rtol=1e-6)
    np.testing.assert_allclose(segments[..., 2], 0.1, rtol=1e-6)
    np.testing.assert_allclose(segments[-1, 1], segments[0, 0], atol=1e-6)
    np.testing.assert_array_equal(segments[1:, 0], segments[:-1, 1])


def test_a_path_of_n_points_has_n_minus_one_segments() -> None:
    points = np.arange(12.0).reshape(4, 3)
    segments = path_segments(points)
    np.testing.assert_array_equal(segments[:, 0], points[:-1])
    np.testing.assert_array_equal(segments[:, 1], points[1:])


def test_pictures_become_rgb() -> None:
    image_bgr = np.zeros((480, 640, 3), np.uint8)
    image_bgr[..., 2] = 200
    jpeg = cv2.imencode(".jpg", image_bgr)[1].tobytes()
    small = picture_from_jpeg(jpeg, small=True)
    assert small.shape == (120, 160, 3)
    assert small[..., 0].mean() > 190
    assert small[..., 2].mean() < 10
    assert picture_from_jpeg(jpeg).shape == (480, 640, 3)
    for wrong in (b"", b"no picture"):
        with pytest.raises(ValueError, match="JPEG"):
            picture_from_jpeg(wrong)


def test_a_level_camera_looks_along_x() -> None:
    """The viewer turns +z (forward) by the quaternion; that must give the drone's heading."""
    wxyz, position = placed(camera_pose(np.array([1.0, 2.0, 3.0]), 0.0, 0.0))
    w, x, y, z = wxyz
    forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    np.testing.assert_allclose(forward, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(position, [1.0, 2.0, 3.0])


def test_names_stay_one_level_deep() -> None:
    assert node_name("lab/drone-1") == "lab_drone-1"


@pytest.mark.parametrize(
    ("name", "value"),
    [("start_radius_m", 0.0), ("thumbnail_hz", float("nan")), ("trail_points", 1)],
)
def test_config_names_what_is_wrong(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        SceneConfig(**{name: value})  # type: ignore[arg-type]
