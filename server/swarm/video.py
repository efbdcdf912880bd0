"""Decodes one drone's video in one thread and hands the newest pictures to the event loop."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable

from server.stages import Frame
from server.swarm.access_units import AccessUnit, AccessUnits
from server.swarm.unit_decoder import UnitDecoder

_LOG = logging.getLogger(__name__)

# More waiting pictures than this and the decoder is hopelessly late: it goes on at a key picture.
_BACKLOG = 24


class VideoDecoder:
    """The decoder of one drone: ``feed`` and ``on_frame`` on the loop, decoding in a thread.

    Waiting pictures are bounded: on overflow all of them are dropped and pictures are damaged until
    the next key picture. An async context manager; leaving it ends the thread.

    Attributes:
        overflows: Times the backlog was dropped.
    """

    def __init__(self, drone_id: str, on_frame: Callable[[Frame], None]) -> None:
        self.overflows = 0
        self._drone_id = drone_id
        self._decoder = UnitDecoder(drone_id)
        self._on_frame = on_frame
        self._units = AccessUnits()
        self._waiting: deque[AccessUnit] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    async def __aenter__(self) -> VideoDecoder:
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(
            target=self._run, name=f"video {self._drone_id}", daemon=True
        )
        self._thread.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._thread is not None:
            await asyncio.to_thread(self._thread.join, 5.0)

    @property
    def errors(self) -> int:
        """Pictures that the decoder refused or patched up."""
        return self._decoder.errors

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        """Take one video datagram; never blocks for long and never raises for bad data."""
        units = self._units.feed(datagram, arrived_s)
        if not units:
            return
        with self._changed:
            self._waiting.extend(units)
            if len(self._waiting) > _BACKLOG:
                self._waiting.clear()
                self._units.lost()
                self.overflows += 1
            self._changed.notify()

    def _next_unit(self) -> AccessUnit | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closing)
            return None if self._closing else self._waiting.popleft()

    def _run(self) -> None:
        while (unit := self._next_unit()) is not None:
            for frame in self._decoder.decode(unit):
                self._hand_over(frame)

    def _hand_over(self, frame: Frame) -> None:
        assert self._loop is not None
        try:
            self._loop.call_soon_threadsafe(self._on_frame, frame)
        except RuntimeError:
            # The loop is gone: the program is ending and nobody wants pictures any more.
            _LOG.debug("%s: picture after the end of the event loop", self._drone_id)
