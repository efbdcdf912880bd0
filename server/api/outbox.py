"""What is waiting for one client of the event stream. Does no I/O and reads no clock.

State (a drone's report, a capture, the training, a preview) keeps one slot: a newer value replaces
the one that has not been sent. Everything else queues in order. When too much is waiting the
oldest goes, and the client is told how many went. Pictures have one slot per drone, newest wins,
and a drone's next picture goes out only after the client has shown the last one. A client that
decodes video itself gets coded pictures instead wherever it can decode them (``coded_queue``).
"""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import BaseModel

from server.api.coded_queue import CodedQueue
from server.api.messages import Missed
from server.api.translate import coded_tile_from_frame, message_from_event, tile_from_frame
from server.mission.events import (
    CaptureChanged,
    DroneReported,
    Event,
    FrameAnnotated,
    NoGoChanged,
    ObjectPointedOut,
    PlanProgressed,
    PoseEstimated,
    PreviewRendered,
    PrioritiesChanged,
    TrainingProgressed,
    ViewsDisagree,
)

_Slot = tuple[str, object]


def _slot(event: Event) -> _Slot | None:
    """Return the slot a state event replaces, None for what must arrive one by one."""
    match event:
        case DroneReported():
            return ("drone", event.drone_id)
        case CaptureChanged():
            return ("capture", event.id)
        case PlanProgressed():
            return ("planning", None)
        case TrainingProgressed():
            return ("training", event.stage)
        case PreviewRendered():
            return ("preview", None)
        case ObjectPointedOut():
            return ("pick", event.drone_id)
        case ViewsDisagree():
            return ("disagreement", None)
        case PrioritiesChanged():
            return ("priorities", None)
        case NoGoChanged():
            return ("no-go", None)
        case _:
            return None


class Outbox:
    """Messages and pictures waiting for one client."""

    def __init__(self, limit: int, standing: Iterable[Event] = ()) -> None:
        """Make an outbox that opens with ``standing`` and keeps ``limit`` messages beyond it."""
        self._events: dict[_Slot, Event] = {}
        self._arrivals = 0
        self._missed = 0
        self._limit = limit
        self._newest: dict[str, FrameAnnotated] = {}
        self._in_flight: dict[str, int] = {}
        self._wanted: frozenset[str] | None = None
        self._coded: dict[str, CodedQueue] | None = None  # None: this client wants JPEG alone.
        self._tiles_first = False
        self._limit = 2**31
        for event in standing:
            self.offer(event)
        self._limit = limit + len(self._events)

    def offer(self, event: Event) -> None:
        """Queue ``event``, or put it into its slot."""
        if isinstance(event, PoseEstimated):
            return
        if isinstance(event, FrameAnnotated):
            if self._wanted is None or event.drone_id in self._wanted:
                self._offer_picture(event)
            return
        self._arrivals += 1
        slot = _slot(event) or ("arrival", self._arrivals)
        self._events.pop(slot, None)  # A newer value also moves to the end of the queue.
        self._events[slot] = event
        while len(self._events) > self._limit:
            del self._events[next(iter(self._events))]
            self._missed += 1

    def _offer_picture(self, event: FrameAnnotated) -> None:
        if self._coded is not None:
            queue = self._coded.setdefault(event.drone_id, CodedQueue())
            if queue.offer(event):
                self._newest.pop(event.drone_id, None)
                return
        self._newest[event.drone_id] = event

    def missed(self, events: int) -> None:
        """Count events that were lost before they came here."""
        self._missed += events

    def show(self, drone_ids: Iterable[str], *, coded: bool = False) -> None:
        """Send pictures of these drones only, ``coded`` where the client can decode them."""
        wanted = frozenset(drone_ids)
        before = self._coded or {}
        self._coded = {d: before[d] for d in wanted if d in before} if coded else None
        for drone_id in list(self._newest):
            if drone_id not in wanted:
                del self._newest[drone_id]
        # A tile that was hidden may never have shown its last picture; it starts afresh.
        for drone_id in list(self._in_flight):
            if drone_id not in wanted:
                del self._in_flight[drone_id]
        self._wanted = wanted

    def shown(self, drone_id: str, sequence: int, *, decoded: bool = True) -> None:
        """Note that the client has shown a picture; any but those in flight is ignored."""
        if self._in_flight.get(drone_id) == sequence:
            del self._in_flight[drone_id]
        if self._coded is not None and drone_id in self._coded:
            self._coded[drone_id].shown(sequence, decoded=decoded)

    def take(self, now_s: float) -> BaseModel | bytes | None:
        """Return what to send next, None when nothing can be sent now.

        Messages and pictures take turns, so neither starves the other on a slow line.
        """
        self._tiles_first = not self._tiles_first
        if self._tiles_first:
            return self._take_tile(now_s) or self._take_message()
        return self._take_message() or self._take_tile(now_s)

    def _take_message(self) -> BaseModel | None:
        if self._missed:
            missed, self._missed = Missed(events=self._missed), 0
            return missed
        while self._events:
            event = self._events.pop(next(iter(self._events)))
            message = message_from_event(event)
            if message is not None:
                return message
        return None

    def _take_tile(self, now_s: float) -> bytes | None:
        for drone_id, frame in self._newest.items():
            if drone_id not in self._in_flight:
                del self._newest[drone_id]
                self._in_flight[drone_id] = frame.sequence
                return tile_from_frame(frame, now_s)
        return self._take_coded(now_s)

    def _take_coded(self, now_s: float) -> bytes | None:
        for drone_id, queue in (self._coded or {}).items():
            if (frame := queue.take()) is not None:
                # Those of the other drones come first next time.
                assert self._coded is not None
                self._coded[drone_id] = self._coded.pop(drone_id)
                return coded_tile_from_frame(frame, now_s)
        return None
