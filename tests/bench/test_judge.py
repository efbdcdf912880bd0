"""The judge counts what happened, once each, and looks everywhere that somebody could be hurt."""

from __future__ import annotations

import numpy as np

from server.bench.missions.judge import Body, Judge, Judgement
from server.swarm.config import SafetyConfig

SURFACE = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0]])


def judged(*moments: dict[str, tuple[tuple[float, float, float], bool]]) -> Judgement:
    judge = Judge(SURFACE, SafetyConfig())
    for moment in moments:
        bodies = {name: Body(np.array(place), flying) for name, (place, flying) in moment.items()}
        judge.observe(bodies)
    return judge.judgement


def test_drones_apart_are_well() -> None:
    apart = {"a": ((2.0, 0.0, 1.0), True), "b": ((-2.0, 0.0, 1.0), True)}
    result = judged(apart, apart)
    assert result.collisions == 0
    assert result.fence_violations == 0
    assert result.min_separation_m == 4.0


def test_a_touch_counts_once_however_long_it_lasts() -> None:
    near = {"a": ((2.0, 0.0, 1.0), True), "b": ((2.1, 0.0, 1.0), True)}
    apart = {"a": ((2.0, 0.0, 1.0), True), "b": ((3.0, 0.0, 1.0), True)}
    assert judged(near, near, near).collisions == 1
    assert judged(near, apart, near).collisions == 2


def test_landing_on_a_drone_that_stands_is_a_collision() -> None:
    assert judged({"a": ((2.0, 0.0, 0.15), True), "b": ((2.0, 0.0, 0.0), False)}).collisions == 1
    assert judged({"a": ((2.0, 0.0, 0.0), False), "b": ((2.0, 0.0, 0.15), True)}).collisions == 1


def test_flying_over_a_drone_that_just_spins_up_is_a_collision() -> None:
    below = {"a": ((2.0, 0.0, 0.2), True), "b": ((2.0, 0.0, 0.05), True)}
    assert judged(below).collisions == 1
    assert judged({"b": below["a"], "a": below["b"]}).collisions == 1


def test_drones_that_stand_side_by_side_hurt_nobody() -> None:
    assert judged({"a": ((2.0, 0.0, 0.0), False), "b": ((2.1, 0.0, 0.0), False)}).collisions == 0


def test_the_object_is_touched_by_flying_into_it() -> None:
    assert judged({"a": ((0.05, 0.0, 1.0), True)}).collisions == 1


def test_each_exit_through_fence_or_ceiling_counts() -> None:
    inside, outside = {"a": ((2.0, 0.0, 1.0), True)}, {"a": ((4.8, 0.0, 1.0), True)}
    high = {"a": ((2.0, 0.0, 3.2), True)}
    result = judged(inside, outside, outside, inside, high)
    assert result.fence_violations == 2
    assert abs(result.worst_excess_m - 0.3) < 1e-9
