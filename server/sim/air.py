"""A driver and a simulated Tello joined without sockets, on one event loop's clock.

With the loop of ``virtual_time`` a flight takes moments and repeats exactly from its seed.
"""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable
from typing import Generic, TypeVar

from server.sim.radio import Radio
from server.sim.tello import STEP_S, Outgoing, Sender, Tello
from server.swarm.ports import Receiver

T = TypeVar("T")

Camera = Callable[[float], list[bytes]]

# The driver's own address, as the drone sees it.
DRIVER: Sender = ("192.168.10.2", 38065)
LATENCY_S = 0.004

# A timer may fire a little before its time; the datagram must not wait for another one.
_EARLY_S = 1e-3

_KINDS = ("reply", "state", "video")


class InAir(Generic[T]):
    """Datagrams on one radio, handed over when each arrives, in order of arrival."""

    def __init__(
        self, radio: Radio[T], take: Callable[[T], None], clock: Callable[[], float]
    ) -> None:
        """Make a channel that lives on the running event loop.

        Args:
            radio: Decides what arrives when.
            take: Gets what has arrived.
            clock: The radio's time in seconds; it may run at another pace than the loop's.
        """
        self._radio = radio
        self._take = take
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._under_way: list[tuple[float, int, T]] = []
        self._count = 0

    def send(self, item: T) -> None:
        """Put something on the air."""
        now_s = self._clock()
        for arrive_s, arriving in self._radio.send(item, now_s):
            self._count += 1
            heapq.heappush(self._under_way, (arrive_s, self._count, arriving))
            self._loop.call_later(arrive_s - now_s, self._arrive)

    def _arrive(self) -> None:
        # Timers of one instant fire in any order; what was sent first is handed over first.
        now_s = self._clock()
        while self._under_way and self._under_way[0][0] <= now_s + _EARLY_S:
            self._take(heapq.heappop(self._under_way)[2])


class AirLink:
    """A ``DroneLink`` to a simulated drone in the same process and loop.

    The drone lives from ``open`` on and goes on living when the driver closes the link, as a real
    one does: until ``end``, or the end of the loop.

    Attributes:
        tello: The drone: the truth.
        unsent: See ``DroneLink``; the air takes everything.
    """

    def __init__(
        self,
        tello: Tello,
        *,
        camera: Camera | None = None,
        fps: float = 10.0,
        latency_s: float = LATENCY_S,
    ) -> None:
        """Make a link.

        Args:
            tello: The drone at its other end.
            camera: Returns the video datagrams of a picture taken at a time in seconds; None: no
                video.
            fps: Pictures per second while the drone's video is on.
            latency_s: What each datagram takes when nothing is wrong, seconds.
        """
        self.tello = tello
        self.unsent = 0
        self._camera = camera
        self._picture_s = 1.0 / fps
        for radio in (tello.uplink, tello.downlink):
            radio.latency_s = latency_s
        self._receivers: tuple[Receiver, Receiver, Receiver] | None = None
        self._up: InAir[tuple[bytes, Sender]] | None = None
        self._down: InAir[Outgoing] | None = None
        self._ended = False
        self._begun_s = 0.0

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        """See ``DroneLink.open``."""
        self._receivers = on_reply, on_state, on_video
        if self._up is None:
            clock = asyncio.get_running_loop().time
            self._up = InAir(self.tello.uplink, self._reach_drone, clock)
            self._down = InAir(self.tello.downlink, self._reach_driver, clock)
            self._begun_s = clock()
            self._live(0)
            if self._camera is not None:
                self._shoot(self._camera, 0)

    def send(self, datagram: bytes) -> None:
        """See ``DroneLink.send``."""
        if self._up is not None and self._receivers is not None:
            self._up.send((datagram, DRIVER))

    def close(self) -> None:
        """See ``DroneLink.close``; the drone hears nothing more but lives on."""
        self._receivers = None

    def end(self) -> None:
        """Stop simulating the drone."""
        self._receivers = None
        self._ended = True

    def _live(self, step: int) -> None:
        if self._ended:
            return
        loop = asyncio.get_running_loop()
        self._put_on_air(self.tello.advance(loop.time()))
        step += 1
        loop.call_at(self._begun_s + step * STEP_S, self._live, step)

    def _shoot(self, camera: Camera, picture: int) -> None:
        if self._ended:
            return
        loop = asyncio.get_running_loop()
        if self.tello.wants_pictures:
            videos = (self.tello.video(datagram) for datagram in camera(loop.time()))
            self._put_on_air([video for video in videos if video is not None])
        picture += 1
        loop.call_at(self._begun_s + picture * self._picture_s, self._shoot, camera, picture)

    def _reach_drone(self, arrived: tuple[bytes, Sender]) -> None:
        if not self._ended:
            self._put_on_air(self.tello.receive(*arrived, asyncio.get_running_loop().time()))

    def _put_on_air(self, outgoing: list[Outgoing]) -> None:
        assert self._down is not None
        for datagram in outgoing:
            self._down.send(datagram)

    def _reach_driver(self, arrived: Outgoing) -> None:
        if self._receivers is not None:
            take = self._receivers[_KINDS.index(arrived.kind)]
            take(arrived.datagram, asyncio.get_running_loop().time())
