"""The local UDP ports of a fleet: opened once, shared, and kept bound to their interfaces.

Drones that share a local address and port (station mode: all on one network) are told apart by the
source address of what arrives, so one socket serves them all.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import time
from collections.abc import Callable
from functools import cache
from typing import cast

from server.swarm.config import DroneConfig

_LOG = logging.getLogger(__name__)

# Room for video that arrives while a busy event loop does not read: four drones send this in three
# seconds, and a key picture is 25 datagrams at once.
VIDEO_BUFFER_BYTES = 4 << 20

# Linux's SO_RCVBUFFORCE, for which Python has no name.
_SO_RCVBUFFORCE = 33

# How often it is looked whether the interfaces are still those that the sockets are bound to.
_LOOK_S = 1.0
_INTERFACE_NAME_BYTES = 16

Receiver = Callable[[bytes, float], None]


class LinkError(OSError):
    """A socket cannot be opened; the text is one line that says which and why."""


class Port(asyncio.DatagramProtocol):
    """One bound socket and the receivers behind it, by source address.

    Attributes:
        interface: Name of the interface it is bound to, empty for any.
        receivers: Who takes what arrives, by source address.
        strangers: Datagrams from addresses that are no drone of ours.
    """

    def __init__(
        self, config: DroneConfig, number: int, buffer_bytes: int, clock: Callable[[], float]
    ) -> None:
        self.interface = config.interface
        self.receivers: dict[str, Receiver] = {}
        self.strangers = 0
        self._config = config
        self._number = number
        self._buffer_bytes = buffer_bytes
        self._clock = clock
        self._transport: asyncio.DatagramTransport | None = None

    async def bind(self) -> None:
        """Open the socket, in place of the one before; raises LinkError."""
        self.close()
        bound = bound_socket(self._config, self._number, self._buffer_bytes)
        await asyncio.get_running_loop().create_datagram_endpoint(lambda: self, sock=bound)

    def send(self, datagram: bytes, to: tuple[str, int]) -> bool:
        """Send a datagram at once; return False when there is no socket to send it with."""
        if self._transport is None or self._transport.is_closing():
            return False
        try:
            self._transport.sendto(datagram, to)
        except OSError as error:
            # A vanished interface may raise here; a stop to the other drones must go on.
            _LOG.debug("datagram to %s not sent: %s", to[0], error)
            return False
        return True

    def close(self) -> None:
        """Close the socket; may be called twice."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    @property
    def is_stale(self) -> bool:
        """True when the interface that the socket was bound to is gone.

        An adapter that is pulled out and put in again is another interface, though of the same
        name: a socket bound to the old one neither sends nor receives any more.
        """
        if not self.interface:
            return False
        if self._transport is None:
            return True
        bound = self._transport.get_extra_info("socket")
        try:
            bound.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, _INTERFACE_NAME_BYTES)
        except OSError as error:
            return error.errno == errno.ENODEV
        return False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep what sends."""
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Hand a datagram to whoever listens to its source."""
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
        """Go on: ICMP's "port unreachable" and the like say that no drone is there just now."""
        _LOG.debug("socket error: %s", exc)


class PortBoard:
    """The local ports of a fleet, each opened once and shared by the drones that need it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._shared: dict[tuple[str, str, int], Port] = {}
        self._own: set[Port] = set()
        # Links open side by side; two of them must not open the same port at once.
        self._opening = asyncio.Lock()

    async def join(
        self,
        config: DroneConfig,
        address: str,
        number: int,
        receiver: Receiver,
        buffer_bytes: int = 0,
    ) -> Port:
        """Have datagrams from ``address`` to local port ``number`` delivered to ``receiver``.

        Port 0 means a socket of the drone's own on any free port.

        Raises:
            LinkError: If the socket cannot be opened.
        """
        key = (config.local_address, config.interface, number)
        async with self._opening:
            port = self._shared.get(key) if number else None
            if port is None:
                port = Port(config, number, buffer_bytes, self._clock)
                await port.bind()
                if number:
                    self._shared[key] = port
                else:
                    self._own.add(port)
        port.receivers[address] = receiver
        return port

    def leave(self, config: DroneConfig, address: str, number: int, receiver: Receiver) -> None:
        """Stop delivery to ``receiver``; the last one closes the socket.

        Whoever has taken over the address meanwhile keeps it.
        """
        key = (config.local_address, config.interface, number)
        port = self._shared.get(key)
        if port is None:
            return
        if port.receivers.get(address) == receiver:
            del port.receivers[address]
        if not port.receivers:
            port.close()
            del self._shared[key]

    def close(self, port: Port) -> None:
        """Close a drone's own port."""
        self._own.discard(port)
        port.close()

    async def keep_bound(self) -> None:
        """Bind sockets anew whose interface went away and came back, for ever."""
        while True:
            await asyncio.sleep(_LOOK_S)
            async with self._opening:
                for port in [*self._shared.values(), *self._own]:
                    if port.is_stale:
                        with contextlib.suppress(LinkError):  # Not there yet: the next look.
                            await port.bind()
                            _LOG.warning("%s is back; its ports are open again", port.interface)


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
            room_bytes = widen_buffer(bound, buffer_bytes)
            if room_bytes < buffer_bytes:
                _tell_of_small_buffer(room_bytes, buffer_bytes)
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


def widen_buffer(opened: socket.socket, wanted_bytes: int) -> int:
    """Give a socket room for datagrams that wait to be read; return how many bytes it has got.

    Linux cuts what is asked for at ``net.core.rmem_max`` and says nothing; only a process with the
    capability CAP_NET_ADMIN may have more.

    Raises:
        OSError: If the socket takes no such size at all.
    """
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted_bytes)
    room_bytes = _room_of(opened)
    if room_bytes < wanted_bytes:
        # Without the capability, or on a system that is not Linux, it stays as it is.
        with contextlib.suppress(OSError):
            opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, wanted_bytes)
        room_bytes = _room_of(opened)
    return room_bytes


def _room_of(opened: socket.socket) -> int:
    # Linux reports twice what was set: the other half is for its own bookkeeping.
    return opened.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2


@cache  # The limit is the machine's: the first socket says all there is to say.
def _tell_of_small_buffer(room_bytes: int, wanted_bytes: int) -> None:
    _LOG.warning(
        "receive buffers hold %.1f MiB in place of %.1f: video is lost while the machine is busy;"
        " sudo sysctl -w net.core.rmem_max=%d",
        room_bytes / 2**20,
        wanted_bytes / 2**20,
        wanted_bytes,
    )


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
