"""The planner's room lies inside the safety limits, and says so when it cannot."""

from __future__ import annotations

from dataclasses import replace

import pytest

from server.planner.config import FlightSpace, PlannerConfig
from server.planner.margins import margin_fault, space_within

SPACE = FlightSpace()
LIMITS = {
    "fence_radius_m": 4.5,
    "floor_m": 0.25,
    "ceiling_m": 3.0,
    "standoff_m": 0.5,
    "separation_m": 0.6,
    "max_speed_m_s": 0.5,
}


def test_the_defaults_fit_together() -> None:
    assert margin_fault(PlannerConfig(), **LIMITS) is None


@pytest.mark.parametrize(
    ("limit", "value", "word"),
    [
        ("fence_radius_m", 4.05, "space.fence_radius_m is 4 m, must be at most 3.95 m"),
        ("floor_m", 0.4, "space.floor_m is 0.45 m, must be at least 0.5 m"),
        ("ceiling_m", 1.9, "space.ceiling_m is 2 m, must be at most 1.8 m"),
        ("standoff_m", 0.85, "space.standoff_m is 0.9 m, must be at least 0.95 m"),
        ("separation_m", 0.75, "twice avoidance.radius_m is 0.8 m, must be at least 0.85 m"),
        ("max_speed_m_s", 0.4, "avoidance.speed_max_m_s is 0.5 m/s"),
    ],
)
def test_a_limit_that_the_planner_would_touch_is_told(limit: str, value: float, word: str) -> None:
    fault = margin_fault(PlannerConfig(), **(LIMITS | {limit: value}))
    assert fault is not None
    assert word in fault
    assert "\n" not in fault


def test_a_fitted_room_has_no_fault() -> None:
    narrow = {"fence_radius_m": 3.0, "floor_m": 0.5, "ceiling_m": 2.0, "standoff_m": 0.8}
    config = replace(PlannerConfig(), space=space_within(SPACE, **narrow))
    assert margin_fault(config, **(LIMITS | narrow)) is None


def test_the_room_follows_narrower_safety_limits() -> None:
    narrow = space_within(SPACE, fence_radius_m=3.0, floor_m=0.5, ceiling_m=2.0, standoff_m=0.8)
    assert narrow.fence_radius_m == pytest.approx(2.5)
    assert narrow.floor_m == pytest.approx(0.7)
    assert narrow.ceiling_m == pytest.approx(1.5)
    assert narrow.standoff_m == pytest.approx(1.1)


def test_the_room_does_not_grow_with_wider_ones() -> None:
    assert (
        space_within(SPACE, fence_radius_m=20.0, floor_m=0.1, ceiling_m=9.0, standoff_m=0.2)
        == SPACE
    )


def test_no_room_left_is_told() -> None:
    with pytest.raises(ValueError, match="fence_radius_m"):
        space_within(SPACE, fence_radius_m=0.4, floor_m=0.25, ceiling_m=3.0, standoff_m=0.5)
