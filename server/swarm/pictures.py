"""One drone's pictures: the newest one, how many come, when to ask for them again."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol

from server.stages import Frame
from server.swarm.errors import DroneError
from server.swarm.video_rate import VideoRate

_FPS_WINDOW_S = 3.0
# How long pictures may wait to be looked at. A long search is a matter of 100 to 200 ms, made good
# at 8 ms a picture; longer waiting would make a drone fly by what was, not by what is.
_WAITING_S = 0.3
# And so many, however close they come: a decoder may hand over what has piled up all at once.
_WAITING = 12
# So many coded pictures go along with one, two seconds' worth.
_CODED_KEPT = 60


class FrameDecoder(Protocol):
    """Turns video datagrams into frames; an async context manager living on the event loop.

    Attributes:
        overflows: Times all that waited to be decoded was dropped, because decoding was too late.
    """

    overflows: int

    async def __aenter__(self) -> object:
        """Begin."""
        ...

    async def __aexit__(self, *exc: object) -> None:
        """End; no frame is handed over afterwards."""
        ...

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        """Take one video datagram; neither blocks nor raises for bad data."""
        ...


# Makes the decoder of a drone by its id; it calls the second argument, on the event loop, with
# each frame.
DecoderMaker = Callable[[str, Callable[[Frame], None]], FrameDecoder]


class Pictures:
    """What the camera of one drone sends.

    Attributes:
        newest: Newest decoded picture, None before the first.
        wanted: True while the video is meant to be on.
        rate: What bit rate it should have.
        skipped: Pictures that nobody took from ``next_in_order`` in time.
    """

    def __init__(self, drone_id: str, clock: Callable[[], float], decoder: DecoderMaker) -> None:
        self.newest: Frame | None = None
        self.wanted = False
        self.rate = VideoRate()
        self.skipped = 0
        self._waiting: deque[Frame] = deque()
        self._in_order = False  # Somebody takes every picture.
        self._drone_id = drone_id
        self._clock = clock
        self._decoder = decoder(drone_id, self._take_frame)
        self._times: deque[float] = deque(maxlen=128)
        self._arrived = asyncio.Event()
        self._closed = False
        self._heard_s = 0.0
        self._asked_s = 0.0
        self._wanted_s = 0.0

    async def open(self) -> None:
        """Start the decoder."""
        await self._decoder.__aenter__()

    async def close(self) -> None:
        """End the decoder and whoever waits for a picture."""
        self._closed = True
        self._arrived.set()
        await self._decoder.__aexit__(None, None, None)

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        """Take one video datagram."""
        self._heard_s = arrived_s
        self._decoder.feed(datagram, arrived_s)

    def want(self, on: bool, now_s: float) -> None:
        """Note that the video was just asked for or called off."""
        if on and not self.wanted:
            self._wanted_s = now_s
        self.wanted = on
        self._heard_s = self._asked_s = now_s

    def must_ask_again(self, now_s: float, silence_s: float) -> bool:
        """Return whether wanted video has been silent for so long; notes that it is asked for."""
        due = self.wanted and now_s - max(self._heard_s, self._asked_s) > silence_s
        if due:
            self._asked_s = now_s
        return due

    def age_s(self, now_s: float) -> float | None:
        """Return the seconds since the newest picture, None while there are to be none.

        A camera that never sent one keeps a drone on the ground by the preflight check, not in the
        air by its age.
        """
        if not self.wanted or not self._times:
            return None
        return now_s - max(self._times[-1], self._wanted_s)

    @property
    def fps(self) -> float:
        """Decoded pictures per second over the last seconds."""
        since_s = self._clock() - _FPS_WINDOW_S
        return sum(at_s > since_s for at_s in self._times) / _FPS_WINDOW_S

    @property
    def overflows(self) -> int:
        """Times all video that waited to be decoded was dropped, because decoding was too late."""
        return self._decoder.overflows

    async def next(self, after: int) -> Frame:
        """Return the newest picture whose sequence exceeds ``after``, waiting for one if need be.

        Raises:
            DroneError: If the drone is closed meanwhile.
        """
        while self.newest is None or self.newest.sequence <= after:
            if self._closed:
                raise DroneError(f"{self._drone_id}: closed")
            await self._arrived.wait()
        return self.newest

    async def next_in_order(self) -> Frame:
        """Return the next picture that was not returned yet; for one reader alone.

        They wait for a short time: when one has waited too long, all but the newest are skipped and
        counted.

        Raises:
            DroneError: If the drone is closed meanwhile.
        """
        self._in_order = True
        while not self._waiting:
            if self._closed:
                raise DroneError(f"{self._drone_id}: closed")
            await self._arrived.wait()
        return self._waiting.popleft()

    def _take_frame(self, frame: Frame) -> None:
        self.newest = frame
        if self._in_order:
            if self._waiting and self._is_late(frame):
                self.skipped += len(self._waiting)
                frame = _with_those_before(frame, self._waiting)
                self._waiting.clear()
            self._waiting.append(frame)
        now_s = self._clock()
        self._times.append(now_s)
        self.rate.observe(now_s, frame.damaged)
        self._arrived.set()
        self._arrived = asyncio.Event()

    def _is_late(self, newest: Frame) -> bool:
        waited_s = newest.captured_s - self._waiting[0].captured_s
        return waited_s > _WAITING_S or len(self._waiting) >= _WAITING


def _with_those_before(frame: Frame, skipped: Iterable[Frame]) -> Frame:
    """Return ``frame`` with the coded form of skipped pictures: it cannot be decoded without.

    Back to the last key picture, before which nothing is needed; where that is too long ago, alone.
    """
    if not frame.coded:
        return frame
    coded = [*(picture for each in skipped for picture in each.coded), *frame.coded]
    keys = [index for index, picture in enumerate(coded) if picture.key]
    coded = coded[keys[-1] :] if keys else coded
    return frame if len(coded) > _CODED_KEPT else replace(frame, coded=tuple(coded))
