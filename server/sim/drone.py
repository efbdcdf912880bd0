"""A simulated Tello on UDP: its sockets and its clockwork around ``Tello``."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Callable, Iterable
from typing import cast

from server.sim.air import InAir
from server.sim.config import SimConfig
from server.sim.dynamics import Airframe
from server.sim.faults import Fault
from server.sim.namespaces import NamespaceError, in_namespace
from server.sim.sdk import TextSdk
from server.sim.tello import STEP_S, Outgoing, Sender, Tello

_LOG = logging.getLogger(__name__)

COMMAND_PORT = 8889


class SimError(OSError):
    """The simulator cannot start; the text is one line that says why."""


class _CommandPort(asyncio.DatagramProtocol):
    """The socket that commands come to and replies leave from."""

    def __init__(self, take: Callable[[tuple[bytes, Sender]], None]) -> None:
        self._take = take
        self.transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: Sender) -> None:
        self._take((data, addr))

    def error_received(self, exc: Exception) -> None:
        # A client that has gone: a real drone goes on talking into the void, too.
        _LOG.debug("socket error: %s", exc)


class SimulatedDrone:
    """One Tello at an address; an async context manager, everything on the event loop.

    Attributes:
        drone_id: Its id in the simulation.
        address: Its IPv4 address; commands, state and video all come from it.
        tello: The drone itself.
    """

    def __init__(
        self, config: SimConfig, index: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.drone_id = config.drone_id(index)
        self.address = config.address(index)
        self.tello = Tello(config, index)
        self._namespace = config.namespaces[index] if config.namespaces else None
        self._clock = clock
        self._port: _CommandPort | None = None
        self._down: InAir[Outgoing] | None = None
        self._sender: socket.socket | None = None
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> SimulatedDrone:
        try:
            commands, self._sender = await asyncio.to_thread(self._open_sockets)
        except NamespaceError as error:
            raise SimError(f"{self.drone_id}: {error}") from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise SimError(
                f"{self.drone_id}: cannot use UDP {self.address}:{COMMAND_PORT}: {reason}"
            ) from error
        self._down = InAir(self.tello.downlink, self._leave, self._clock)
        up = InAir(self.tello.uplink, self._receive, self._clock)
        loop = asyncio.get_running_loop()
        _, self._port = await loop.create_datagram_endpoint(
            lambda: _CommandPort(up.send), sock=commands
        )
        self._task = asyncio.create_task(self._live(), name=f"sim {self.drone_id}")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._port is not None and self._port.transport is not None:
            self._port.transport.close()
        if self._sender is not None:
            self._sender.close()
            self._sender = None

    @property
    def airframe(self) -> Airframe:
        """Its body: the truth."""
        return self.tello.airframe

    @property
    def sdk(self) -> TextSdk:
        """Its side of the protocol."""
        return self.tello.sdk

    @property
    def wants_pictures(self) -> bool:
        """True while somebody has switched the video on."""
        return self.tello.wants_pictures

    def inject(self, fault: Fault) -> None:
        """Let something go wrong from now on."""
        self.tello.inject(fault, self._clock())

    def send_video(self, datagrams: Iterable[bytes]) -> None:
        """Send one picture's datagrams to the client."""
        for datagram in datagrams:
            outgoing = self.tello.video(datagram)
            if outgoing is not None:
                self._put_on_air([outgoing])

    def _open_sockets(self) -> tuple[socket.socket, socket.socket]:
        if self._namespace is None:
            return self._bind_both()
        return in_namespace(self._namespace, self._bind_both)

    def _bind_both(self) -> tuple[socket.socket, socket.socket]:
        commands = _bound_socket(self.address, COMMAND_PORT)
        try:
            return commands, _bound_socket(self.address, 0)
        except OSError:
            commands.close()
            raise

    def _receive(self, arrived: tuple[bytes, Sender]) -> None:
        self._put_on_air(self.tello.receive(*arrived, self._clock()))

    def _put_on_air(self, outgoing: Iterable[Outgoing]) -> None:
        if self._down is not None:
            for datagram in outgoing:
                self._down.send(datagram)

    def _leave(self, outgoing: Outgoing) -> None:
        """Hand a datagram to the network; it has survived the air already."""
        try:
            if outgoing.kind == "reply":
                if self._port is not None and self._port.transport is not None:
                    self._port.transport.sendto(outgoing.datagram, outgoing.to)
            elif self._sender is not None:
                self._sender.sendto(outgoing.datagram, outgoing.to)
        except OSError as error:
            # Nobody listens there any more, or its buffer is full: on the air it would be lost.
            _LOG.debug("%s: datagram lost: %s", self.drone_id, error)

    async def _live(self) -> None:
        """Fly and report in real time; a busy machine is caught up with in small steps."""
        while True:
            self._put_on_air(self.tello.advance(self._clock()))
            await asyncio.sleep(STEP_S)


def _bound_socket(address: str, port: int) -> socket.socket:
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.bind((address, port))
    except OSError:
        bound.close()
        raise
    return bound
