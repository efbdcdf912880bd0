"""The sampled surface is that of the union, and hollows are found."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planner_objects import box

from server.planner.surfaces import even_directions, sample_surface, segments_blocked


def test_two_stacked_boxes_have_the_surface_of_one() -> None:
    one = sample_surface([box(0, 0, 0, 1, 1, 2)], 600)
    two = sample_surface([box(0, 0, 0, 1, 1, 1), box(0, 0, 1, 1, 1, 2)], 600)
    assert one.areas_m2.sum() == pytest.approx(10.0)
    assert two.areas_m2.sum() == pytest.approx(10.0, rel=0.02)
    assert 400 < len(two) < 900


def test_a_box_counted_twice_has_its_surface_once() -> None:
    same = [box(0, 0, 0, 1, 1, 1)] * 2
    assert sample_surface(same, 300).areas_m2.sum() == pytest.approx(6.0)


@given(
    low=st.tuples(*[st.floats(-1, 0.9)] * 3),
    size=st.tuples(*[st.floats(0.1, 1.5)] * 3),
)
@settings(max_examples=25, deadline=None)
def test_samples_lie_on_the_union_and_look_outwards(
    low: tuple[float, float, float], size: tuple[float, float, float]
) -> None:
    first = box(0, 0, 0, 1, 1, 1)
    second = box(*low, *(np.array(low) + size))
    samples = sample_surface([first, second], 300)
    outside = samples.points + 1e-4 * samples.normals
    inside = samples.points - 1e-4 * samples.normals
    assert not (first.contains(outside) | second.contains(outside)).any()
    assert (first.contains(inside) | second.contains(inside)).all()


def test_the_inner_corner_of_an_l_is_more_concave_than_its_back() -> None:
    samples = sample_surface([box(0, 0, 0, 1, 1, 0.2), box(0, 0, 0.2, 0.2, 1, 1)], 600)
    floor = (samples.normals[:, 2] > 0.5) & (samples.points[:, 2] < 0.3)
    back = samples.normals[:, 0] < -0.5
    assert samples.concavity[floor].mean() > 0.15
    assert samples.concavity[back].max() == 0.0


def test_one_convex_box_has_no_hollow() -> None:
    assert sample_surface([box(0, 0, 0, 1, 2, 3)], 300).concavity.max() == 0.0


def test_segments_are_blocked_by_what_is_between_only() -> None:
    wall = [box(1, -1, -1, 2, 1, 1)]
    starts = np.zeros((4, 3))
    ends = np.array([[3.0, 0, 0], [0.5, 0, 0], [3.0, 3.0, 0], [-3.0, 0, 0]])
    assert segments_blocked(starts, ends, wall).tolist() == [True, False, False, False]


def test_even_directions_balance() -> None:
    directions = even_directions(100)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert np.linalg.norm(directions.mean(axis=0)) < 0.02


def test_nothing_to_sample_is_an_error() -> None:
    with pytest.raises(ValueError, match="no surface"):
        sample_surface([], 100)
