"""A simulated Tello on UDP: its sockets, its clockwork, its place at the start."""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import time
from collections.abc import Callable, Iterable
from typing import cast

import numpy as np

from server.sim.config import SimConfig
from server.sim.dynamics import Airframe
from server.sim.sdk import Outgoing, TextSdk, state_line

_LOG = logging.getLogger(__name__)

COMMAND_PORT = 8889
STATE_PORT = 8890
VIDEO_PORT = 11111

_STEP_S = 0.02
_STATE_PERIOD_S = 0.1
_START_ERROR_M = 0.20
_START_ERROR_DEG = 15.0


class SimError(OSError):
    """The simulator cannot start; the text is one line that says why."""


def placed_airframe(config: SimConfig, index: int) -> Airframe:
    """Return the drone as somebody set it down: roughly on its place, roughly facing the centre."""
    rng = np.random.default_rng([config.seed, index])
    azimuth = math.radians(config.azimuth_deg(index))
    error = config.start_sigma_m * rng.standard_normal(2)
    # The cap bounds the length of the error, not each of its parts.
    error *= min(1.0, _START_ERROR_M / max(1e-9, float(np.linalg.norm(error))))
    turned_deg = config.start_sigma_deg * rng.standard_normal()
    turned_deg = min(max(turned_deg, -_START_ERROR_DEG), _START_ERROR_DEG)
    nominal = config.start_radius_m * np.array([math.cos(azimuth), math.sin(azimuth)])
    position = np.array([*(nominal + error), 0.0])
    yaw_rad = azimuth + math.pi + math.radians(turned_deg)
    return Airframe(position, yaw_rad, config.dynamics, rng)


class _CommandPort(asyncio.DatagramProtocol):
    """Answers each datagram from the socket it came to."""

    def __init__(self, answer: Callable[[bytes, tuple[str, int]], Iterable[Outgoing]]) -> None:
        self._answer = answer
        self.transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        self.send(self._answer(data, addr))

    def send(self, outgoing: Iterable[Outgoing]) -> None:
        if self.transport is not None:
            for datagram, receiver in outgoing:
                self.transport.sendto(datagram, receiver)

    def error_received(self, exc: Exception) -> None:
        # A client that has gone: a real drone goes on talking into the void, too.
        _LOG.debug("socket error: %s", exc)


class SimulatedDrone:
    """One Tello at an address; an async context manager, everything on the event loop.

    Attributes:
        drone_id: Its id in the simulation.
        address: Its IPv4 address; commands, state and video all come from it.
        airframe: Its body.
        sdk: Its side of the protocol.
    """

    def __init__(
        self, config: SimConfig, index: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.drone_id = config.drone_id(index)
        self.address = config.address(index)
        self.airframe = placed_airframe(config, index)
        self.sdk = TextSdk(self.airframe, f"0TQSIM{config.seed % 10000:04d}{index + 1:04d}")
        self._clock = clock
        self._port = _CommandPort(lambda data, sender: self.sdk.receive(data, sender, clock()))
        self._sender: socket.socket | None = None
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> SimulatedDrone:
        try:
            commands = _bound_socket(self.address, COMMAND_PORT)
            self._sender = _bound_socket(self.address, 0)
        except OSError as error:
            reason = error.strerror or str(error)
            raise SimError(
                f"{self.drone_id}: cannot use UDP {self.address}:{COMMAND_PORT}: {reason}"
            ) from error
        loop = asyncio.get_running_loop()
        await loop.create_datagram_endpoint(lambda: self._port, sock=commands)
        self._task = asyncio.create_task(self._live(), name=f"sim {self.drone_id}")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._port.transport is not None:
            self._port.transport.close()
        if self._sender is not None:
            self._sender.close()
            self._sender = None

    @property
    def wants_pictures(self) -> bool:
        """True while somebody has switched the video on."""
        return self.sdk.streaming and self.sdk.client is not None

    def send_video(self, datagrams: Iterable[bytes]) -> None:
        """Send one picture's datagrams to the client."""
        for datagram in datagrams:
            self._send_to_client(datagram, VIDEO_PORT)

    def _send_to_client(self, datagram: bytes, port: int) -> None:
        if self.sdk.client is None or self._sender is None:
            return
        try:
            self._sender.sendto(datagram, (self.sdk.client, port))
        except OSError as error:
            # Nobody listens there any more, or its buffer is full: on the air it would be lost.
            _LOG.debug("%s: datagram lost: %s", self.drone_id, error)

    async def _live(self) -> None:
        """Fly and report in real time; a busy machine is caught up with in small steps."""
        before_s = self._clock()
        state_s = before_s
        while True:
            await asyncio.sleep(_STEP_S)
            now_s = self._clock()
            while now_s - before_s >= _STEP_S:
                before_s += _STEP_S
                self.airframe.step(_STEP_S)
                self._port.send(self.sdk.tick(now_s))
            if now_s >= state_s:
                # After a stall reports are left out, not sent in a burst.
                state_s = max(state_s + _STATE_PERIOD_S, now_s)
                self._send_to_client(state_line(self.airframe), STATE_PORT)


def _bound_socket(address: str, port: int) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.bind((address, port))
    except OSError:
        bound.close()
        raise
    return bound
