"""Where a silent drone may be: the arc of its sticks, or where it was told to hover."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.mission.whereabouts import LastHeard, coasted, turned, whereabouts

speeds = st.floats(-0.5, 0.5)
turns = st.floats(-0.8, 0.8)
silences = st.floats(0.5, 15.0)


def heard(vx: float, vy: float, turn: float) -> LastHeard:
    return LastHeard(np.array([2.0, 0.0, 1.5]), np.array([vx, vy, 0.0]), turn)


@given(speeds, speeds, turns, silences)
def test_the_arc_is_what_small_steps_add_up_to(vx, vy, turn, silent_s):
    last = heard(vx, vy, turn)
    steps = 2000
    times = (np.arange(steps) + 0.5) * silent_s / steps
    c, s = np.cos(turn * times), np.sin(turn * times)
    moved = np.array([(c * vx - s * vy).mean(), (s * vx + c * vy).mean(), 0.0]) * silent_s
    position, velocity = coasted(last, silent_s)
    np.testing.assert_allclose(position, last.position + moved, atol=1e-4)
    np.testing.assert_allclose(
        velocity, turned(last.velocity, turn * silent_s) if silent_s < 15.0 else np.zeros(3)
    )


@given(speeds, speeds, turns, st.floats(0.85, 1.15), silences)
def test_a_drone_whose_turn_is_a_little_off_is_near_one_of_its_places(vx, vy, turn, off, silent_s):
    last = heard(vx, vy, turn)
    truth, _ = coasted(last, silent_s, off)
    places = [position for position, _ in whereabouts(last, silent_s)]
    speed, angle = float(np.hypot(vx, vy)), abs(turn) * 0.15 * silent_s / 2.0
    # Between two neighbouring arcs, and one that is left out because another is as near as that.
    tolerated_m = 0.25 + speed * silent_s * angle / 2.0
    assert min(np.linalg.norm(truth - place) for place in places) <= tolerated_m + 1e-6


@given(speeds, speeds, turns, st.floats(0.5, 60.0))
def test_one_that_still_hears_hovers_where_it_was_and_then_lands(vx, vy, turn, silent_s):
    last = heard(vx, vy, turn)
    places = [position for position, _ in whereabouts(last, silent_s)]
    stays = last.position[:2] + 0.5 * np.array([vx, vy])
    beside = [place for place in places if np.linalg.norm(place[:2] - stays) < 0.26]
    assert beside
    if silent_s < 3.0:
        assert any(place[2] > 1.4 for place in beside)


@given(speeds, speeds, turns)
def test_sooner_or_later_it_is_down(vx, vy, turn):
    for position, velocity in whereabouts(heard(vx, vy, turn), 30.0):
        assert position[2] == 0.0
        assert not velocity.any()


def test_places_are_clearly_different():
    one = whereabouts(heard(0.0, 0.0, 0.3), 5.0)
    assert len(one) <= 2, "it only sinks, or does not"
    places = [position for position, _ in whereabouts(heard(0.4, 0.2, 0.2), 10.0)]
    assert len(places) == 4
    gaps = [np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]]
    assert min(gaps) > 0.25


def test_a_drone_whose_sticks_sink_flies_on_above_the_floor():
    last = LastHeard(np.array([2.0, 0.0, 1.0]), np.array([0.2, 0.0, -0.3]), 0.0)
    for silent_s in (5.0, 10.0, 14.9):
        position, _ = coasted(last, silent_s)
        np.testing.assert_allclose(position, [2.0 + 0.2 * silent_s, 0.0, 0.1])
    assert coasted(last, 20.0)[0][2] == 0.0


@given(speeds, speeds, turns, st.lists(st.tuples(speeds, speeds, turns), max_size=5), silences)
def test_any_order_after_the_last_report_may_be_the_one_it_follows(vx, vy, turn, later, silent_s):
    others = [heard(*order) for order in later]
    found = [position for position, _ in whereabouts(heard(vx, vy, turn), silent_s, others)]
    np.testing.assert_array_equal(found[0], coasted(heard(vx, vy, turn), silent_s)[0])
    for order in others:
        truth, _ = coasted(order, silent_s)
        assert min(np.linalg.norm(truth - place) for place in found) <= 0.25
