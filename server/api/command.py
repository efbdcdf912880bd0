"""The command over the drones as the server keeps it: one lease, told to every browser."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated

from fastapi import Header

from server.api.lease import Lease, Standing
from server.api.messages import (
    AnswerCommand,
    AskCommand,
    Heartbeat,
    ReleaseCommand,
    Steer,
    TakeCommand,
)
from server.api.problems import ProblemError
from server.mission.commands import MissionControl, RefusedError, Sticks, UnknownError
from server.mission.events import CommandChanged

CommandMessage = Heartbeat | ReleaseCommand | TakeCommand | AskCommand | AnswerCommand | Steer
_LOOK_S = 1.0


class CommandDesk:
    """Hands the command from browser to browser and tells all of them."""

    def __init__(
        self,
        mission: MissionControl,
        lapse_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._mission = mission
        self._lease = Lease(lapse_s)
        self._told = Standing()
        self._clock = clock

    def standing(self) -> list[CommandChanged]:
        """Return what a newcomer needs to know: who is in command, if anybody is."""
        return [] if self._lease.standing == Standing() else [self._event]

    @property
    def _event(self) -> CommandChanged:
        return CommandChanged(self._lease.standing.holder, self._lease.standing.asking)

    def take_message(self, message: CommandMessage) -> None:
        """Carry out what a browser says about the command."""
        now_s, client = self._clock(), message.client
        match message:
            case Heartbeat():
                if self._speaks_for_all(client) or (client and self._lease.renew(client, now_s)):
                    self._mission.note_operator()
            case ReleaseCommand():
                if self._speaks_for_all(client) or (client and self._lease.release(client)):
                    self._mission.release_operator()
            case TakeCommand():
                self._lease.take(client, now_s)
                self._mission.note_operator()
            case AskCommand():
                self._lease.ask(client)
            case AnswerCommand(grant=grant):
                self._lease.answer(client, grant, now_s)
            case Steer():
                self._steer(message, now_s)
        self._tell()

    def _steer(self, message: Steer, now_s: float) -> None:
        """Hand on the sticks of who is in command; they may come a moment after they count."""
        self._lease.lapse(now_s)
        if not message.client or self._lease.standing.holder != message.client:
            return
        self._lease.renew(message.client, now_s)
        self._mission.note_operator()
        sticks = Sticks(message.forward, message.left, message.up, message.turn)
        with suppress(UnknownError, RefusedError):
            self._mission.steer(message.drone_id, sticks)

    def _speaks_for_all(self, client: str) -> bool:
        """Return whether a program that names no browser counts: only while no browser flies."""
        return not client and self._lease.standing.holder is None

    def note_flight(self, client: str) -> None:
        """Note that ``client`` had a flight begun or resumed; a nameless program flies unwatched.

        The lost operator counts from here: its websocket may be down already.
        """
        if client and self._lease.renew(client, self._clock()):
            self._mission.note_operator()
        self._tell()

    async def admit(self, x_dronerf_client: Annotated[str, Header(max_length=64)] = "") -> str:
        """Refuse a request that flies while another browser is in command (HTTP 409).

        Returns:
            Which browser asks, empty for a program that names none.
        """
        if x_dronerf_client and not self._lease.admits(x_dronerf_client, self._clock()):
            raise ProblemError(
                409,
                "another browser is in command; ask it for the command, or take it over",
                "not_in_command",
            )
        return x_dronerf_client

    async def watch(self) -> None:
        """Let the command lapse when its holder is gone; until cancelled."""
        while True:
            await asyncio.sleep(_LOOK_S)
            self._lease.lapse(self._clock())
            self._tell()

    def _tell(self) -> None:
        if self._lease.standing != self._told:
            self._told = self._lease.standing
            self._mission.events.publish(self._event)
