"""Checklist, failsafe table and overrides over a real server."""

from __future__ import annotations

import json

import httpx
import pytest
from fake_mission import capture_changed, checklist, level_failed, link_failed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from served_console import Console

from server.api.safety import unit_from_event
from server.mission.commands import CaptureRequest, failsafe_falls, failsafe_meaning
from server.swarm.failsafes import FailsafeTable, Readings, judge

pytestmark = pytest.mark.loopback

CAPTURES = "/api/v1/captures"


def is_invalid(response: httpx.Response) -> list[str]:
    """Return the fields that a 422 names."""
    assert response.status_code == 422
    assert response.headers["content-type"] == "application/problem+json"
    return [error["field"] for error in response.json()["errors"]]


async def test_the_checklist_says_what_was_found_and_what_to_do(console: Console) -> None:
    console.mission.checks = checklist(level_failed("drone-2"), link_failed("drone-3"))
    async with console.client() as client:
        checks = (await client.get("/api/v1/preflight")).json()
    by_key = {check["key"]: check for check in checks}
    assert len(by_key) == len(checks) == 3 * 8 + 1 + 1
    assert by_key["drone-2.level"] == {
        "key": "drone-2.level",
        "item": "level",
        "drone_id": "drone-2",
        "passed": False,
        "found": "leans 14 degrees",
        "remedy": "Set it down on a level place.",
        "final": False,
    }
    assert by_key["drone-3.link"]["final"] is True
    assert by_key["disk"]["drone_id"] is None


async def test_the_failsafe_table_names_direction_unit_and_meaning(console: Console) -> None:
    async with console.client() as client:
        rows = (await client.get("/api/v1/failsafes")).json()
    table = FailsafeTable().rows()
    told = [(row["event"], row["threshold"], row["action"]) for row in rows]
    assert told == [(row.event, row.threshold, row.action) for row in table]
    for row in rows:
        # The direction is the one in which the table really fires.
        beyond = row["threshold"] + (-0.01 if row["direction"] == "at_most" else 0.01)
        fired = judge(Readings(**{row["event"]: beyond}), FailsafeTable().rows())
        assert row["action"] in [one.failsafe.action for one in fired]
        assert row["unit"]
        assert row["description"].endswith(".")
    (battery,) = [row for row in rows if row["event"] == "battery_pct"]
    assert (battery["unit"], battery["direction"]) == ("%", "at_most")


async def test_the_table_shown_is_the_table_in_force(console: Console) -> None:
    console.mission.table = FailsafeTable(video_age_s={}, battery_pct={"land": 22.0})
    async with console.client() as client:
        rows = (await client.get("/api/v1/failsafes")).json()
    assert not [row for row in rows if row["event"] == "video_age_s"]
    assert [row["threshold"] for row in rows if row["event"] == "battery_pct"] == [22.0]


async def test_both_need_the_token(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        for path in ("/api/v1/preflight", "/api/v1/failsafes"):
            assert (await client.get(path)).status_code == 401


def test_words_of_unknown_events_are_empty() -> None:
    assert unit_from_event("mystery") == ""
    assert failsafe_meaning("mystery") == ""
    assert not failsafe_falls("mystery")
    # A meaning that runs over two lines is told whole, and alone.
    assert failsafe_meaning("mission_silence_s").count(".") == 1


async def test_overrides_reach_the_mission_and_are_shown(console: Console) -> None:
    body = {"overrides": {"drone-2.level": "  stands on a ramp ", "video": "no need of it"}}
    async with console.client() as client:
        started = await client.post(CAPTURES, json=body)
        shown = (await client.get(started.headers["location"])).json()
    overrides = {"drone-2.level": "stands on a ramp", "video": "no need of it"}
    assert console.mission.calls == [("start", CaptureRequest(overrides=overrides))]
    assert shown["overrides"] == overrides


@pytest.mark.parametrize(
    ("overrides", "field"),
    [
        ({"level": ""}, "body.overrides.level"),
        ({"level": "ok"}, "body.overrides.level"),
        ({"level": "  ok  "}, "body.overrides.level"),
        ({"level": "x" * 301}, "body.overrides.level"),
        ({"level": "two\nlines"}, "body.overrides.level"),
        ({"level": 12345}, "body.overrides.level"),
        ({"level": None}, "body.overrides.level"),
        ({"": "a good reason"}, "body.overrides..[key]"),
        ({"x" * 81: "a good reason"}, f"body.overrides.{'x' * 81}.[key]"),
        ({f"item-{number}": "a good reason" for number in range(41)}, "body.overrides"),
        (["level"], "body.overrides"),
        ("level", "body.overrides"),
        (None, "body.overrides"),
    ],
)
async def test_bad_overrides_name_the_field(
    console: Console, overrides: object, field: str
) -> None:
    async with console.client() as client:
        response = await client.post(CAPTURES, json={"overrides": overrides})
    assert is_invalid(response) == [field]
    assert console.mission.calls == []


async def test_forty_overrides_of_three_hundred_letters_are_taken(console: Console) -> None:
    overrides = {f"item-{number}": "x" * 300 for number in range(40)}
    async with console.client() as client:
        assert (await client.post(CAPTURES, json={"overrides": overrides})).status_code == 202


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b'{"overrides": {"\\ud800": "a good reason"}}', 422),
        (b'{"overrides": {"level": "reason \\ud800"}}', 422),
        (b'{"\\ud800": 1}', 422),
        (b'{"overrides": {"level": "reason \xff"}}', 400),
    ],
)
async def test_text_that_is_no_text_is_refused(console: Console, body: bytes, status: int) -> None:
    async with console.client() as client:
        response = await client.post(
            CAPTURES, content=body, headers={"Content-Type": "application/json"}
        )
    assert response.status_code == status
    assert response.headers["content-type"] == "application/problem+json"
    assert console.mission.calls == []


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=8,
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(overrides=_JSON)
async def test_no_overrides_break_the_server(console: Console, overrides: object) -> None:
    console.mission.records.clear()
    async with console.client() as client:
        response = await client.post(
            CAPTURES,
            content=json.dumps({"overrides": overrides}),
            headers={"Content-Type": "application/json"},
        )
    assert response.status_code in (202, 422)


async def test_a_grounded_capture_is_shown_as_paused(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "paused", "grounded"))
    async with console.client() as client:
        shown = (await client.get(CAPTURES + "/run-1")).json()
        resumed = await client.post(CAPTURES + "/run-1/resume")
    assert (shown["state"], shown["phase"]) == ("paused", "grounded")
    assert resumed.json()["state"] == "running"
