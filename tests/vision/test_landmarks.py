"""What a camera should see of landmarks, and how that changes: against numbers."""

import numpy as np
import pytest

from server.geometry.axes import rotation_about
from server.geometry.poses import look_at
from server.vision.landmarks import LandmarkMap

BEGIN = 4


def map_of(rng: np.random.Generator) -> tuple[LandmarkMap, np.ndarray, np.ndarray]:
    """Return a map of two anchors, its state, and the landmarks' true places."""
    places = rng.uniform([-3.0, 2.0, 0.0], [3.0, 5.0, 2.5], (9, 3))
    landmarks, x = LandmarkMap(BEGIN), [rng.standard_normal(BEGIN)]
    for numbers in (np.arange(5), np.arange(5, 9)):
        centre = rng.normal([0.0, -1.0, 1.0], 0.3)
        T = look_at(centre, np.array([0.0, 3.0, 1.0]))
        ways = places[numbers] - centre
        far = np.linalg.norm(ways, axis=1)
        landmarks.add(T[:3, :3], numbers, (ways / far[:, None]) @ T[:3, :3])
        x += [centre, np.zeros(3), 1.0 / far]
    return landmarks, np.concatenate(x), places


def seen_of(landmarks: LandmarkMap, x: np.ndarray, position: np.ndarray, R: np.ndarray):
    """Return the tangents, attitude errors of the anchors in ``x`` taken in."""
    turned = LandmarkMap(BEGIN)
    for anchor in landmarks.anchors:
        turned.add(anchor.R_world_cam, anchor.numbers, anchor.bearings)
    x = x.copy()
    turned.fold(x)
    return turned.expected(x, np.arange(9), position, R).tangents


def test_what_is_expected_is_where_the_landmarks_are() -> None:
    landmarks, x, places = map_of(np.random.default_rng(1))
    T = look_at(np.array([0.5, -1.5, 1.2]), np.array([0.2, 3.0, 1.1]))
    expected = landmarks.expected(x, np.array([1, 2, 6, 40]), T[:3, 3], T[:3, :3])
    np.testing.assert_array_equal(expected.numbers, [1, 2, 6])
    in_camera = (places[[1, 2, 6]] - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(expected.tangents, in_camera[:, :2] / in_camera[:, 2:], atol=1e-12)


def test_derivatives_are_those_of_small_changes() -> None:
    rng = np.random.default_rng(2)
    landmarks, x, _ = map_of(rng)
    T = look_at(np.array([0.5, -1.5, 1.2]), np.array([0.2, 3.0, 1.1]))
    position, R = T[:3, 3], T[:3, :3]
    expected = landmarks.expected(x, np.arange(9), position, R)
    step = 1e-6
    for axis in range(3):
        change = step * np.eye(3)[axis]
        moved = seen_of(landmarks, x, position + change, R) - expected.tangents
        np.testing.assert_allclose(moved / step, expected.by_position[:, :, axis], atol=1e-4)
        moved = seen_of(landmarks, x, position, rotation_about(change) @ R) - expected.tangents
        np.testing.assert_allclose(moved / step, expected.by_attitude[:, :, axis], atol=1e-4)
    for row in range(len(x)):
        moved = seen_of(landmarks, x + step * (np.arange(len(x)) == row), position, R)
        slope = (moved - expected.tangents) / step
        np.testing.assert_allclose(slope, expected.by_map[:, :, row], atol=1e-4)


def test_what_is_behind_the_camera_is_not_expected() -> None:
    landmarks, x, _ = map_of(np.random.default_rng(3))
    T = look_at(np.array([0.0, 0.0, 1.0]), np.array([0.0, -3.0, 1.0]))
    assert not len(landmarks.expected(x, np.arange(9), T[:3, 3], T[:3, :3]).numbers)


def test_landmarks_that_are_lost_leave_the_state() -> None:
    landmarks, x, places = map_of(np.random.default_rng(4))
    rows = landmarks.keep(np.array([6, 8]))
    assert len(rows) == BEGIN + 6 + 2
    x = x[rows]
    T = look_at(np.array([0.5, -1.5, 1.2]), np.array([0.2, 3.0, 1.1]))
    expected = landmarks.expected(x, np.arange(9), T[:3, 3], T[:3, :3])
    np.testing.assert_array_equal(expected.numbers, [6, 8])
    in_camera = (places[[6, 8]] - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(expected.tangents, in_camera[:, :2] / in_camera[:, 2:], atol=1e-12)
    assert len(landmarks.keep(np.zeros(0, int))) == BEGIN
    assert landmarks.anchors == []


@pytest.mark.parametrize("turn", [np.zeros(3), np.array([0.1, -0.4, 2.0])])
def test_a_rotation_about_a_vector_leaves_it_where_it_is(turn: np.ndarray) -> None:
    R = rotation_about(turn)
    np.testing.assert_allclose(R @ turn, turn, atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.trace(R) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(turn)))
