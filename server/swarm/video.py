"""Decodes one drone's video in one thread and hands the newest pictures to the event loop."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable

import av
import numpy as np
from av.codec.context import Flags
from av.error import FFmpegError

from server.stages import Frame
from server.swarm.access_units import AccessUnit, AccessUnits

_LOG = logging.getLogger(__name__)

# More waiting pictures than this and the decoder is hopelessly late: it goes on at a key picture.
_BACKLOG = 24


class VideoDecoder:
    """The decoder of one drone: ``feed`` and ``on_frame`` on the loop, decoding in a thread.

    Waiting pictures are bounded: on overflow all of them are dropped and pictures are damaged until
    the next key picture. An async context manager; leaving it ends the thread.

    Attributes:
        errors: Pictures that the decoder refused or patched up.
        overflows: Times the backlog was dropped.
    """

    def __init__(self, drone_id: str, on_frame: Callable[[Frame], None]) -> None:
        self.errors = 0
        self.overflows = 0
        self._drone_id = drone_id
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
        codec = _open_codec()
        damaged = True
        running = False  # Until the first key picture there is nothing to decode.
        sequence = 0
        while (unit := self._next_unit()) is not None:
            if unit.key:
                running = True
                if unit.has_sets:
                    # What a decoder keeps of a broken picture spoils even the next key picture,
                    # unnoticed, and flushing does not help; a new one costs next to nothing.
                    codec, damaged = _open_codec(), False
            if not running:
                continue
            damaged = damaged or unit.damaged
            try:
                pictures = codec.decode(av.Packet(unit.data))
                # Converting may fail, too: rubbish can announce any size and pixel format.
                images = [picture.to_ndarray(format="bgr24") for picture in pictures]
            except FFmpegError:
                self.errors += 1
                damaged = True
                continue
            except Exception:  # noqa: BLE001  # The thread outlives any one picture.
                _LOG.exception("%s: decoder failed, starts anew", self._drone_id)
                codec, running, damaged = _open_codec(), False, True
                continue
            if len(pictures) != 1 or any(picture.is_corrupt for picture in pictures):
                self.errors += 1
                damaged = True
            for picture in images:
                image = np.ascontiguousarray(picture, np.uint8)
                frame = Frame(self._drone_id, sequence, unit.captured_s, image, damaged)
                sequence += 1
                self._hand_over(frame)

    def _hand_over(self, frame: Frame) -> None:
        assert self._loop is not None
        try:
            self._loop.call_soon_threadsafe(self._on_frame, frame)
        except RuntimeError:
            # The loop is gone: the program is ending and nobody wants pictures any more.
            _LOG.debug("%s: picture after the end of the event loop", self._drone_id)


def _open_codec() -> av.VideoCodecContext:
    codec = av.CodecContext.create("h264", "r")
    assert isinstance(codec, av.VideoCodecContext)
    codec.thread_count = 1
    # Without this the decoder may hold pictures back: the drone's SPS does not bound reordering.
    codec.flags |= Flags.low_delay
    codec.options = {"err_detect": "crccheck+bitstream+buffer"}
    return codec
