"""The websocket ``/api/v1/stream``: events as JSON, pictures as binary messages.

Per client one task moves events from the mission into an ``Outbox``, one sends from it as fast as
the client takes them, one reads what the client says. The first to end ends the others.

A client whose user flies sends heartbeats. A socket that closes takes no leave of the mission: only
``release_command`` does, and everything else is a silence that the failsafe table answers.
"""

from __future__ import annotations

import asyncio
import logging
import time
from contextlib import suppress
from dataclasses import dataclass

from fastapi import APIRouter, WebSocket
from pydantic import TypeAdapter, ValidationError
from starlette.websockets import WebSocketDisconnect

from server.api.access import allows
from server.api.command import CommandDesk, CommandMessage
from server.api.config import StreamConfig
from server.api.journal import Journal
from server.api.messages import ClientMessage, Missed, ShowTiles, TileShown
from server.api.outbox import Outbox
from server.mission.commands import MissionControl
from server.mission.events import Event, Subscription

logger = logging.getLogger(__name__)

_UNSUPPORTED_DATA = 1003
_POLICY_VIOLATION = 1008
_TOO_BIG = 1009
_INTERNAL_ERROR = 1011
_LONGEST_MESSAGE = 16 * 1024

_client_message: TypeAdapter[ShowTiles | TileShown | CommandMessage] = TypeAdapter(ClientMessage)


@dataclass(slots=True)
class StreamCounts:
    """Counters for ``/metrics``.

    Attributes:
        clients: Clients connected now.
        messages: Text messages sent since the start.
        tiles: Pictures sent since the start.
        missed: Events that slow clients lost since the start.
    """

    clients: int = 0
    messages: int = 0
    tiles: int = 0
    missed: int = 0


def standing_events(mission: MissionControl, journal: Journal, config: StreamConfig) -> list[Event]:
    """Return what a newcomer needs to see the present state, oldest first."""
    standing = mission.standing()
    known = {id(event) for event in standing}
    notes = [line.note for line in journal.newest(config.history)]
    captures = [record.status for record in reversed(mission.captures()[: config.captures])]
    remembered: list[Event] = [*notes, *captures, *journal.pictures.values()]
    if journal.plan_view is not None:
        remembered.append(journal.plan_view)
    # An event the mission keeps standing and the journal remembers is one and the same object.
    return [*(e for e in remembered if id(e) not in known), *standing, *mission.drones()]


def make_stream_router(
    mission: MissionControl,
    journal: Journal,
    desk: CommandDesk,
    config: StreamConfig,
    counts: StreamCounts,
) -> APIRouter:
    """Return the router of the event stream."""
    router = APIRouter()

    @router.websocket("/api/v1/stream")
    async def stream(socket: WebSocket) -> None:
        await socket.accept()
        counts.clients += 1
        try:
            # Subscribed before the standing events are asked for, so that nothing falls between.
            with mission.events.subscribe(config.queue) as subscription:
                standing = [*desk.standing(), *standing_events(mission, journal, config)]
                outbox = Outbox(config.pending, standing)
                may_fly = allows(socket.state.visitor.role, "operator")
                conversation = _Conversation(
                    socket, subscription, outbox, desk if may_fly else None, counts
                )
                await conversation.run()
        except Exception:
            # The supervisor of one client: whatever broke, only this client notices.
            logger.exception("the event stream of a client failed")
            await _close(socket, _INTERNAL_ERROR, "the server failed")
        finally:
            counts.clients -= 1

    return router


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    with suppress(RuntimeError, WebSocketDisconnect):  # It may be closed already.
        await socket.close(code, reason)


class _Conversation:
    """One connected client."""

    def __init__(
        self,
        socket: WebSocket,
        subscription: Subscription,
        outbox: Outbox,
        desk: CommandDesk | None,
        counts: StreamCounts,
    ) -> None:
        """Begin to talk; without ``desk`` the client only watches."""
        self._socket = socket
        self._subscription = subscription
        self._outbox = outbox
        self._desk = desk
        self._counts = counts
        self._work = asyncio.Event()
        self._work.set()

    async def run(self) -> None:
        """Talk until one side has had enough; raises what broke, not that the client left."""
        tasks = [
            asyncio.create_task(self._collect(), name="stream collect"),
            asyncio.create_task(self._send(), name="stream send"),
            asyncio.create_task(self._listen(), name="stream listen"),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            ends = await asyncio.gather(*tasks, return_exceptions=True)
        for end in ends:
            if isinstance(end, Exception) and not isinstance(end, WebSocketDisconnect):
                raise end

    async def _collect(self) -> None:
        dropped = 0
        async for event in self._subscription:
            self._outbox.offer(event)
            if self._subscription.dropped > dropped:
                lost = self._subscription.dropped - dropped
                self._outbox.missed(lost)
                dropped += lost
            self._work.set()

    async def _send(self) -> None:
        while True:
            await self._work.wait()
            self._work.clear()
            while (message := self._outbox.take(time.monotonic())) is not None:
                if isinstance(message, bytes):
                    await self._socket.send_bytes(message)
                    self._counts.tiles += 1
                else:
                    await self._socket.send_text(message.model_dump_json())
                    self._counts.messages += 1
                    if isinstance(message, Missed):
                        self._counts.missed += message.events
                # A fast client's send never waits; others must get their turn all the same.
                await asyncio.sleep(0)

    async def _listen(self) -> None:
        while True:
            received = await self._socket.receive()
            if received["type"] == "websocket.disconnect":
                return
            text = received.get("text")
            if text is None:
                await _close(self._socket, _UNSUPPORTED_DATA, "only text messages are understood")
                return
            if len(text) > _LONGEST_MESSAGE:
                await _close(self._socket, _TOO_BIG, "no message here is so long")
                return
            try:
                message = _client_message.validate_json(text)
            except ValidationError:
                await _close(self._socket, _POLICY_VIOLATION, "not a message of this protocol")
                return
            match message:
                case ShowTiles(drone_ids=drone_ids, coding=coding):
                    self._outbox.show(drone_ids, coded=coding == "h264")
                case TileShown(drone_id=drone_id, sequence=sequence, decoded=decoded):
                    self._outbox.shown(drone_id, sequence, decoded=decoded)
                case _ if self._desk is not None:
                    self._desk.take_message(message)
                case _:
                    pass  # Who only watches has nothing to say about the command.
            self._work.set()
