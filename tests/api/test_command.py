"""Who is in command, and whose absence counts, as messages and requests say it."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from server.api.command import CommandDesk
from server.api.messages import Heartbeat, ReleaseCommand, Steer
from server.api.problems import ProblemError
from server.mission.commands import RefusedError, Sticks
from server.mission.events import EventStream


class Mission:
    """Remembers what it was told of the operator."""

    def __init__(self) -> None:
        self.events = EventStream()
        self.told: list[str] = []
        self.steered: list[tuple[str, Sticks]] = []
        self.refuses = False

    def note_operator(self) -> None:
        self.told.append("here")

    def release_operator(self) -> None:
        self.told.append("left")

    def steer(self, drone_id: str, sticks: Sticks) -> None:
        if self.refuses:
            raise RefusedError(f"{drone_id} does not fly")
        self.steered.append((drone_id, sticks))


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


def sticks_of(client: str) -> Steer:
    return Steer(client=client, drone_id="drone-1", forward=0.5, left=0.0, up=-1.0, turn=0.0)


def test_only_who_is_in_command_steers_and_steering_is_a_sign_of_life(
    desk: CommandDesk, mission: Mission, clock: Clock
) -> None:
    desk.take_message(Heartbeat(client="tab-1"))
    desk.take_message(sticks_of("tab-2"))
    desk.take_message(sticks_of(""))
    assert mission.steered == []
    clock.now_s = 9.0
    desk.take_message(sticks_of("tab-1"))
    clock.now_s = 18.0
    desk.take_message(sticks_of("tab-2"))
    assert mission.steered == [("drone-1", Sticks(0.5, 0.0, -1.0, 0.0))]


def test_sticks_take_no_command(desk: CommandDesk, mission: Mission) -> None:
    desk.take_message(sticks_of("tab-1"))
    assert mission.steered == []
    assert desk.standing() == []


def test_sticks_that_come_too_late_to_count_are_dropped(
    desk: CommandDesk, mission: Mission
) -> None:
    mission.refuses = True
    desk.take_message(Heartbeat(client="tab-1"))
    desk.take_message(sticks_of("tab-1"))
    assert mission.steered == []


@pytest.mark.parametrize("push", [1.01, -2.0, float("nan"), float("inf"), "hard"])
def test_no_stick_goes_beyond_its_end(push: Any) -> None:
    with pytest.raises(ValidationError):
        Steer(client="tab-1", drone_id="drone-1", forward=push, left=0.0, up=0.0, turn=0.0)
