"""When things happened, by the clock of the console that flew.

A recording has its times by the wall clock; the console went by a clock of its own, from whose full
periods the eyes take their turns (``server.vision.region``). An event repeats a drone's report with
its time by that clock, and the report itself stands in the file: there the two clocks meet.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from server.recording.reading import Recording, RecordingError

# By the time a picture is told its drone has sent no more reports than these.
_REPORTS_KEPT = 300
# Of a repeated report, what the recorded one says otherwise.
_SAID_OTHERWISE = ("drone_id", "received_s")


@dataclass(frozen=True, slots=True)
class FlightTimes:
    """The times of one flight.

    Attributes:
        zero_ns: When the console's clock showed zero, nanoseconds since 1970.
        told_s: When it told its poses, ascending, by its clock.
    """

    zero_ns: int
    told_s: tuple[float, ...]


def flight_times(recording: Recording, wall_ns: int) -> FlightTimes:
    """Return the times of a recorded flight.

    Args:
        recording: The file.
        wall_ns: Stands in for the clock's zero in a flight that took no picture.

    Raises:
        RecordingError: If a message is not what its topic promises.
    """
    told_ns: set[int] = set()
    reports: dict[str, deque[bytes]] = {}
    zero_ns: int | None = None
    for message in recording.messages():
        drone_id, _, kind = message.topic.removeprefix("/").rpartition("/")
        if kind == "pose":
            told_ns.add(message.publish_ns)
        elif kind == "telemetry":
            reports.setdefault(drone_id, deque(maxlen=_REPORTS_KEPT)).append(message.data)
        elif kind == "events" and zero_ns is None and b"capture_taken" in message.data:
            try:
                event = json.loads(message.data)
                if event["event"] == "capture_taken":
                    report = event["capture"]["telemetry"]
                    zero_ns = _clock_zero_ns(report, reports.get(report["drone_id"], ()))
            except (ValueError, KeyError, TypeError) as error:
                raise RecordingError(f"{message.topic}: unreadable message: {error}") from error
    zero_ns = wall_ns if zero_ns is None else zero_ns
    return FlightTimes(zero_ns, tuple((ns - zero_ns) / 1e9 for ns in sorted(told_ns)))


def tick_times(told_s: Sequence[float], dt_s: float) -> list[float]:
    """Return when the pilot took notice.

    It tells its poses at some of these moments only; the others lie evenly between.

    Args:
        told_s: Times of which poses were told, ascending.
        dt_s: How far apart the moments are when nothing is in the way.
    """
    ticks: list[float] = []
    for before_s, after_s in pairwise(told_s):
        steps = max(1, round((after_s - before_s) / dt_s))
        ticks += np.linspace(before_s, after_s, steps, endpoint=False).tolist()
    return [*ticks, *told_s[-1:]]


def _clock_zero_ns(repeated: dict[str, Any], reports: Iterable[bytes]) -> int | None:
    """Return when the clock showed zero by which ``repeated`` was received, None when unknown.

    Args:
        repeated: A report as an event has it.
        reports: Recorded reports of the same drone, oldest first.
    """
    said = {name: value for name, value in repeated.items() if name not in _SAID_OTHERWISE}
    for data in reversed(list(reports)):
        report = json.loads(data)
        if all(report[name] == value for name, value in said.items()):
            return report["received_ns"] - round(repeated["received_s"] * 1e9)
    return None
