"""A reconstruction is set upright on the floor among its points."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.geometry.poses import Similarity
from server.nerf.pose_floor import on_the_floor

SAME = Similarity(1.0, np.eye(3), np.zeros(3))


def room(rng, floor=400, table=0):
    """Points on a floor, on walls, on an object and, some, on a table's top."""
    on_floor = np.column_stack([rng.uniform(-3, 3, (floor, 2)), rng.normal(0, 0.003, floor)])
    walls = np.column_stack([rng.uniform(-3, 3, 300), np.full(300, 3.0), rng.uniform(0, 2.5, 300)])
    thing = rng.uniform([-0.3, -0.2, 0.0], [0.3, 0.2, 0.5], (300, 3))
    top = np.column_stack([rng.uniform(-0.5, 0.5, (table, 2)), np.full(table, 0.15)])
    return np.concatenate([on_floor, walls, thing, top])


def tilted(degrees, height_m, heading=0.3):
    """A world that stands askew by so much and too high."""
    R = Rotation.from_euler("zxy", [heading, np.deg2rad(degrees), 0.3 * np.deg2rad(degrees)])
    return Similarity(1.7, R.as_matrix(), np.array([0.4, -0.2, height_m]))


@pytest.mark.parametrize(("degrees", "height_m"), [(0.0, 0.05), (1.5, -0.1), (-2.0, 0.12)])
def test_the_floor_is_level_and_at_zero(degrees, height_m):
    rng = np.random.default_rng(1)
    points = room(rng)
    askew = tilted(degrees, height_m)
    points_model = points / 1.7
    found = on_the_floor(askew, points_model)
    assert found is not None
    floor = found.points(points_model)[:400]
    assert abs(floor[:, 2].mean()) < 2e-3
    assert np.abs(floor[:, 2]).max() < 0.02
    assert found.scale == askew.scale
    # It is turned and lifted, not carried away.
    moved = found.points(points_model) - askew.points(points_model)
    assert np.abs(moved[:400, :2]).max() < 0.02


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((100, 3)),
        np.random.default_rng(0).uniform(-0.3, 0.3, (500, 3)),
        np.random.default_rng(0).normal(0, [2.0, 2.0, 0.005], (30, 3)),
        np.random.default_rng(0).normal([0, 0, 1.0], [2.0, 2.0, 0.005], (500, 3)),
    ],
    ids=["none", "one place", "a cloud", "too few", "a table"],
)
def test_what_shows_no_floor_is_said_to_show_none(points):
    assert on_the_floor(SAME, points) is None


def test_a_table_top_with_floor_below_it_is_no_floor():
    points = room(np.random.default_rng(2), floor=150, table=900)
    assert on_the_floor(SAME, points) is None


def test_points_that_are_wrong_here_and_there_do_not_make_a_floor_a_table():
    rng = np.random.default_rng(3)
    wrong = np.column_stack([rng.uniform(-3, 3, (80, 2)), rng.uniform(-0.25, -0.03, 80)])
    assert on_the_floor(SAME, np.concatenate([room(rng), wrong])) is not None
