"""Datagrams to and from one drone.

Command replies, state reports and video arrive on three local ports. Drones that share a local
address and port (station mode: all on one network) are told apart by their source address, so the
sockets belong to a ``PortBoard`` that all links of a fleet share.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import time
from collections.abc import Callable
from typing import Protocol, cast

from server.swarm.config import DroneConfig

_LOG = logging.getLogger(__name__)

# A key picture is 25 datagrams at once; a busy event loop may not read for a while.
_VIDEO_BUFFER_BYTES = 4 << 20

Receiver = Callable[[bytes, float], None]


class LinkError(OSError):
    """A socket cannot be opened; the text is one line that says which and why."""


class DroneLink(Protocol):
    """Sends datagrams to a drone and hands over what it sends; lives on the event loop."""

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        """Open the sockets; receivers are called with (datagram, arrival time in seconds).

        Raises:
            LinkError: If a socket cannot be opened.
        """
        ...

    def send(self, datagram: bytes) -> None:
        """Send one datagram to the command port at once; losses are counted, never raised."""
        ...

    def close(self) -> None:
        """Close the sockets; may be called twice."""
        ...


class _Port(asyncio.DatagramProtocol):
    """One bound socket and the receivers behind it, by source address."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self.receivers: dict[str, Receiver] = {}
        self.strangers = 0
        self.transport: asyncio.DatagramTransport | None = None
        self._clock = clock

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        arrived_s = self._clock()
        receiver = self.receivers.get(addr[0])
        if receiver is None:
            self.strangers += 1
            if self.strangers == 1:
                _LOG.info("datagrams from %s, which is no drone of ours, are ignored", addr[0])
            return
        try:
            receiver(data, arrived_s)
        except Exception:  # noqa: BLE001  # The socket serves other drones, too: it must live on.
            _LOG.exception("a datagram of %s could not be handled", addr[0])

    def error_received(self, exc: Exception) -> None:
        # ICMP's "port unreachable" and the like: the drone is not there at the moment.
        _LOG.debug("socket error: %s", exc)


class PortBoard:
    """The local sockets of a fleet, each opened once and shared by the drones that need it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._ports: dict[tuple[str, str, int], _Port] = {}
        # Links open side by side; two of them must not open the same port at once.
        self._opening = asyncio.Lock()

    async def join(
        self,
        config: DroneConfig,
        address: str,
        port: int,
        receiver: Receiver,
        buffer_bytes: int = 0,
    ) -> asyncio.DatagramTransport:
        """Have datagrams from ``address`` to local ``port`` delivered to ``receiver``.

        Port 0 means a socket of the drone's own on any free port.

        Raises:
            LinkError: If the socket cannot be opened.
        """
        key = (config.local_address, config.interface, port)
        async with self._opening:
            opened = self._ports.get(key) if port else None
            if opened is None:
                opened = await self._open(config, port, buffer_bytes)
                if port:
                    self._ports[key] = opened
        opened.receivers[address] = receiver
        assert opened.transport is not None
        return opened.transport

    def leave(self, config: DroneConfig, address: str, port: int, receiver: Receiver) -> None:
        """Stop delivery to ``receiver``; the last one closes the socket.

        Whoever has taken over the address meanwhile keeps it.
        """
        key = (config.local_address, config.interface, port)
        opened = self._ports.get(key)
        if opened is None:
            return
        if opened.receivers.get(address) == receiver:
            del opened.receivers[address]
        if not opened.receivers and opened.transport is not None:
            opened.transport.close()
            del self._ports[key]

    async def _open(self, config: DroneConfig, port: int, buffer_bytes: int) -> _Port:
        bound = bound_socket(config, port, buffer_bytes)
        loop = asyncio.get_running_loop()
        _, protocol = await loop.create_datagram_endpoint(lambda: _Port(self._clock), sock=bound)
        return protocol


def bound_socket(config: DroneConfig, port: int, buffer_bytes: int = 0) -> socket.socket:
    """Return a UDP socket on a drone's local address and interface; port 0 means any free one.

    Raises:
        LinkError: If it cannot be opened.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        if config.interface:
            device = config.interface.encode() + b"\0"
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device)
        if buffer_bytes:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
        bound.bind((config.local_address, port))
    except OSError as error:
        bound.close()
        where = config.local_address or "any address"
        where += f" on {config.interface}" if config.interface else ""
        raise LinkError(
            f"{config.id}: cannot open UDP port {port or 'any'} of {where}:"
            f" {_reason(error, config)}"
        ) from error
    return bound


def _reason(error: OSError, config: DroneConfig) -> str:
    """Return what is wrong with a socket and what to do about it."""
    match error.errno:
        case errno.ENODEV:
            return f"there is no interface {config.interface!r}"
        case errno.EPERM if config.interface:
            return "binding to an interface needs the capability CAP_NET_RAW (or root)"
        case errno.EADDRINUSE:
            return "the port is in use; is another console running?"
        case errno.EADDRNOTAVAIL:
            return f"{config.local_address} is no address of this machine"
        case _:
            return error.strerror or str(error)


class UdpDroneLink:
    """A drone over UDP.

    Attributes:
        address: Where it is; empty while that is not known.
        unsent: Datagrams that could not be handed to the network.
    """

    def __init__(self, config: DroneConfig, board: PortBoard | None = None) -> None:
        self.address = config.address
        self.unsent = 0
        self._config = config
        self._board = board if board is not None else PortBoard()
        self._command: asyncio.DatagramTransport | None = None
        self._receivers: tuple[Receiver, Receiver, Receiver] | None = None

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        """See ``DroneLink.open``."""
        self._receivers = on_reply, on_state, on_video
        config, board, address = self._config, self._board, self.address
        try:
            await board.join(config, address, config.state_port, on_state)
            await board.join(config, address, config.video_port, on_video, _VIDEO_BUFFER_BYTES)
            # Replies go to the port a command came from, so every drone gets a port of its own.
            self._command = await board.join(config, address, 0, on_reply)
        except LinkError:
            self.close()
            raise

    async def move_to(self, address: str) -> None:
        """Go on with the drone at another address.

        Raises:
            LinkError: If a socket cannot be opened.
        """
        before, self.address = self.address, address
        if self._receivers is None or before == address:
            return
        if self._command is not None:
            self._command.close()
        await self.open(*self._receivers)
        # Only now, so that a shared port stays open.
        self._leave(before)

    def send(self, datagram: bytes) -> None:
        """See ``DroneLink.send``."""
        if self._command is None or self._command.is_closing() or not self.address:
            self.unsent += 1
            return
        try:
            self._command.sendto(datagram, (self.address, self._config.command_port))
        except OSError as error:
            # A vanished interface raises here; a stop to the other drones must go on.
            self.unsent += 1
            _LOG.debug("%s: datagram not sent: %s", self._config.id, error)

    def close(self) -> None:
        """See ``DroneLink.close``."""
        if self._command is not None:
            self._command.close()
            self._command = None
        self._leave(self.address)

    def _leave(self, address: str) -> None:
        if self._receivers is not None:
            _, on_state, on_video = self._receivers
            self._board.leave(self._config, address, self._config.state_port, on_state)
            self._board.leave(self._config, address, self._config.video_port, on_video)
