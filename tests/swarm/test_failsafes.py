"""The failsafe table: what fires when, and which tables are refused."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.swarm.failsafes import FALLING, RANK, FailsafeTable, Readings, judge

TABLE = FailsafeTable()
EVENTS = [item.name for item in fields(FailsafeTable)]
WELL = Readings(
    fence_m=-1.0,
    ceiling_m=-1.0,
    standoff_m=2.0,
    separation_m=2.0,
    pose_sigma_m=0.1,
    object_age_s=0.5,
    velocity_age_s=0.0,
    state_age_s=0.1,
    video_age_s=0.1,
    battery_pct=80.0,
    temperature_c=70.0,
    lean_deg=5.0,
    operator_silence_s=1.0,
    mission_silence_s=0.1,
)


def strongest(readings: Readings) -> str:
    fired = judge(readings, TABLE.rows())
    return fired[0].failsafe.action if fired else "none"


def test_the_table_watches_every_reading() -> None:
    assert set(EVENTS) == {item.name for item in fields(Readings)}


def test_nothing_fires_for_a_drone_that_is_well() -> None:
    assert judge(WELL, TABLE.rows()) == ()
    assert judge(Readings(), TABLE.rows()) == ()


@pytest.mark.parametrize(
    ("event", "value", "action"),
    [
        ("state_age_s", 0.99, "none"),
        ("state_age_s", 1.0, "hold"),
        ("state_age_s", 3.0, "land"),
        ("battery_pct", 16.0, "none"),
        ("battery_pct", 15.0, "land"),
        ("temperature_c", 100.0, "land"),
        ("lean_deg", 64.0, "none"),
        ("lean_deg", 80.0, "cut"),
        ("separation_m", 0.61, "none"),
        ("separation_m", 0.59, "hold"),
        ("fence_m", 0.5, "hold"),
        ("fence_m", 1.0, "land"),
        ("operator_silence_s", 30.0, "hold"),
        ("operator_silence_s", 61.0, "land_all"),
        ("mission_silence_s", 1.5, "hold"),
        ("mission_silence_s", 10.0, "land"),
    ],
)
def test_thresholds(event: str, value: float, action: str) -> None:
    assert strongest(replace(WELL, **{event: value})) == action


@pytest.mark.parametrize("event", EVENTS)
def test_what_is_not_a_number_is_not_well(event: str) -> None:
    assert strongest(replace(WELL, **{event: math.nan})) != "none"


@given(st.fixed_dictionaries({event: st.none() | st.floats(-10.0, 200.0) for event in EVENTS}))
def test_rows_fire_exactly_past_their_threshold_strongest_first(
    values: dict[str, float | None],
) -> None:
    fired = judge(Readings(**values), TABLE.rows())
    ranks = [RANK[one.failsafe.action] for one in fired]
    assert ranks == sorted(ranks, reverse=True)
    expected = set()
    for row in TABLE.rows():
        value = values[row.event]
        if value is not None:
            sign = -1.0 if row.event in FALLING else 1.0
            if sign * value >= sign * row.threshold:
                expected.add(row)
    assert {one.failsafe for one in fired} == expected


def test_what_fired_is_told_with_its_value() -> None:
    (fired,) = judge(replace(WELL, separation_m=0.42), TABLE.rows())
    assert fired.value == 0.42
    assert fired.text == "another drone 0.42 m away"


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"state_age_s": {}}, "state_age_s must land"),
        ({"battery_pct": {"hold": 20.0}}, "battery_pct must land"),
        ({"mission_silence_s": {"hold": 1.0}}, "mission_silence_s must land"),
        ({"video_age_s": {"explode": 1.0}}, "video_age_s.explode: unknown action"),
        ({"video_age_s": {"none": 1.0}}, "unknown action"),
        ({"fence_m": {"land": -1.0}}, "fence_m.land must be positive"),
        ({"fence_m": {"land": math.nan}}, "fence_m.land must be positive"),
    ],
)
def test_a_table_that_is_no_table_is_refused(
    change: dict[str, dict[str, float]], word: str
) -> None:
    with pytest.raises(ValueError, match=word):
        replace(TABLE, **change)


def test_an_event_may_be_switched_off() -> None:
    table = replace(TABLE, operator_silence_s={})
    assert judge(replace(WELL, operator_silence_s=1e6), table.rows()) == ()
