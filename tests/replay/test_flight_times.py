"""The clock of a recorded flight is found again, and the moments of its pilot."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.recording.reading import RecordedMessage, Recording, RecordingError
from server.replay.times import flight_times, tick_times

ZERO_NS = 1_750_000_000_123_456_789
SAID = {"yaw_rad": 0.25, "velocity_m_s": [0.1, 0.0, 0.0], "tof_m": None, "motor_time_s": 7.0}


def message(topic: str, about_s: float, fields: object = None) -> RecordedMessage:
    about_ns = ZERO_NS + round(about_s * 1e9)
    data = fields if isinstance(fields, bytes) else json.dumps(fields).encode()
    return RecordedMessage(topic, "", about_ns, about_ns, data)


def report(received_s: float, **said: object) -> RecordedMessage:
    fields = SAID | said | {"activity": "flying", "received_ns": ZERO_NS + round(received_s * 1e9)}
    return message("/north/telemetry", received_s, fields)


def picture(received_s: float) -> RecordedMessage:
    repeated = SAID | {"drone_id": "north", "received_s": received_s}
    fields = {"event": "capture_taken", "capture": {"telemetry": repeated}}
    return message("/events", received_s + 0.5, fields)


def recording(*messages: RecordedMessage) -> Recording:
    return cast(Recording, SimpleNamespace(messages=lambda: iter(messages)))


def test_a_report_that_an_event_repeats_tells_the_consoles_clock() -> None:
    times = flight_times(
        recording(
            message("/north/pose", 4711.5),
            message("/south/pose", 4711.5),
            report(4711.2),
            report(4711.3, yaw_rad=0.26),
            report(4711.4),
            report(4711.5, yaw_rad=0.27),
            picture(4711.4),
            message("/north/pose", 4711.6),
        ),
        wall_ns=1,
    )
    assert times.zero_ns == pytest.approx(ZERO_NS, abs=1)
    assert times.told_s == pytest.approx((4711.5, 4711.6))


def test_without_a_picture_times_count_from_the_beginning() -> None:
    moments = (message("/north/pose", 2.0), report(2.0), message("/events", 2.0, {"event": "x"}))
    times = flight_times(recording(*moments), ZERO_NS)
    assert times.zero_ns == ZERO_NS
    assert times.told_s == (2.0,)


def test_a_picture_whose_report_is_not_in_the_file_tells_nothing() -> None:
    assert flight_times(recording(report(9.0, yaw_rad=1.0), picture(9.0)), 5).zero_ns == 5
    assert flight_times(recording(picture(9.0), report(9.0), picture(9.0)), 5).zero_ns != 5


@pytest.mark.parametrize("data", [b'{"capture_taken"', b'{"event": "capture_taken"}'])
def test_a_picture_that_makes_no_sense_is_refused(data: bytes) -> None:
    with pytest.raises(RecordingError, match="/events"):
        flight_times(recording(message("/events", 1.0, data)), 0)


@given(st.lists(st.integers(1, 5), min_size=1, max_size=30))
def test_moments_between_told_poses_are_found_again(steps: list[int]) -> None:
    dt_s = 1.0 / 15.0
    told = np.concatenate([[0.0], np.cumsum(steps)]) * dt_s
    ticks = tick_times(told.tolist(), dt_s)
    np.testing.assert_allclose(ticks, np.arange(sum(steps) + 1) * dt_s, atol=1e-9)


def test_without_told_poses_nothing_is_known() -> None:
    assert tick_times([], 0.1) == []
