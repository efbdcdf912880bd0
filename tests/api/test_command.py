"""Who is in command, and whose absence counts, as messages and requests say it."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from server.api.command import CommandDesk
from server.api.messages import Heartbeat, ReleaseCommand
from server.api.problems import ProblemError
from server.mission.events import EventStream


class Mission:
    """Remembers what it was told of the operator."""

    def __init__(self) -> None:
        self.events = EventStream()
        self.told: list[str] = []

    def note_operator(self) -> None:
        self.told.append("here")

    def release_operator(self) -> None:
        self.told.append("left")


class Clock:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def mission() -> Mission:
    return Mission()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def desk(mission: Mission, clock: Clock) -> CommandDesk:
    anything: Any = mission
    return CommandDesk(anything, lapse_s=10.0, clock=clock)


def test_whoever_begins_a_flight_is_missed_even_if_no_heartbeat_ever_arrived(
    desk: CommandDesk, mission: Mission
) -> None:
    desk.note_flight("tab-1")
    assert mission.told == ["here"]
    with pytest.raises(ProblemError):
        asyncio.run(desk.admit("tab-2"))
    assert asyncio.run(desk.admit("tab-1")) == "tab-1"


def test_a_nameless_program_begins_a_flight_with_nobody_in_command(
    desk: CommandDesk, mission: Mission
) -> None:
    desk.note_flight("")
    assert mission.told == []
    assert desk.standing() == []


def test_a_nameless_program_speaks_for_nobody_who_is_in_command(
    desk: CommandDesk, mission: Mission
) -> None:
    desk.take_message(Heartbeat())
    assert mission.told == ["here"], "alone it counts"
    desk.take_message(Heartbeat(client="tab-1"))
    mission.told.clear()
    desk.take_message(Heartbeat())
    desk.take_message(ReleaseCommand())
    assert mission.told == []
    desk.take_message(ReleaseCommand(client="tab-1"))
    assert mission.told == ["left"]
