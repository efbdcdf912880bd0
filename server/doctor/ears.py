"""The sockets that listen to drones and ask them; lives on the event loop.

Listening sockets are shared by drones with the same local address, interface and port, and what
arrives is told apart by its source address. Each question goes out from a socket of its own, so
that a late answer to one question can never be taken for the answer to the next.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable
from typing import cast

from server.doctor.network import open_udp
from server.swarm.config import DroneConfig
from server.swarm.ports import VIDEO_BUFFER_BYTES, widen_buffer
from server.swarm.protocol import ProtocolError, Reply, decode_reply, encode_command

Receiver = Callable[[bytes, float], None]


class _Ear(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.receivers: dict[str, Receiver] = {}
        self.strangers: Counter[str] = Counter()
        self.transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        receiver = self.receivers.get(addr[0])
        if receiver is None:
            self.strangers[addr[0]] += 1
        else:
            receiver(data, asyncio.get_running_loop().time())


class Ears:
    """Listens on the fleet's local ports; an async context manager that closes them."""

    def __init__(self) -> None:
        self._ears: dict[tuple[str, str, int], _Ear] = {}

    async def __aenter__(self) -> Ears:
        return self

    async def __aexit__(self, *_: object) -> None:
        for ear in self._ears.values():
            if ear.transport is not None:
                ear.transport.close()
        self._ears.clear()
        await asyncio.sleep(0)  # Closing takes effect on the loop's next turn.

    async def listen(self, drone: DroneConfig, port: int, receiver: Receiver) -> None:
        """Hand what ``drone`` sends to local ``port`` to ``receiver`` with its arrival time.

        Raises:
            OSError: If the port cannot be had.
        """
        key = (drone.local_address, drone.interface, port)
        ear = self._ears.get(key)
        if ear is None:
            opened = open_udp(drone.local_address, drone.interface, port)
            with contextlib.suppress(OSError):
                widen_buffer(opened, VIDEO_BUFFER_BYTES)
            ear = _Ear()
            loop = asyncio.get_running_loop()
            await loop.create_datagram_endpoint(lambda: ear, sock=opened)
            self._ears[key] = ear
        ear.receivers[drone.address] = receiver

    def strangers(self, drone: DroneConfig, port: int) -> list[str]:
        """Return the addresses, most talkative first, that are no drone of the fleet."""
        ear = self._ears.get((drone.local_address, drone.interface, port))
        return [address for address, _ in ear.strangers.most_common()] if ear else []


class _Answer(asyncio.DatagramProtocol):
    def __init__(self, address: str, accepts: Callable[[Reply], bool]) -> None:
        self.reply: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._address = address
        self._accepts = accepts

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if addr[0] != self._address or self.reply.done():
            return
        try:
            reply = decode_reply(data)
        except ProtocolError:
            return  # A packet of the drone's binary protocol.
        if self._accepts(reply):
            self.reply.set_result(reply)

    def error_received(self, exc: Exception) -> None:
        pass  # Nobody listens there at the moment; the wait's end says so.


async def ask(
    drone: DroneConfig,
    text: str,
    *,
    tries: int,
    wait_s: float,
    accepts: Callable[[Reply], bool] = lambda _: True,
) -> Reply | None:
    """Send a question, repeatedly while it is not answered, and return the first reply.

    Only for what may be carried out twice.

    Args:
        drone: Whom to ask.
        text: The question.
        tries: How often it is sent.
        wait_s: Wait after each, seconds.
        accepts: Tells a reply from what it cannot be; others are ignored.

    Raises:
        OSError: If no socket can be opened.
    """
    opened = open_udp(drone.local_address, drone.interface, 0)
    loop = asyncio.get_running_loop()
    transport, answer = await loop.create_datagram_endpoint(
        lambda: _Answer(drone.address, accepts), sock=opened
    )
    try:
        for _ in range(tries):
            with contextlib.suppress(OSError):  # The network may be away for a moment.
                transport.sendto(encode_command(text), (drone.address, drone.command_port))
            done, _ = await asyncio.wait((answer.reply,), timeout=wait_s)
            if done:
                return answer.reply.result()
        return None
    finally:
        transport.close()


async def move_ports(drone: DroneConfig, *, tries: int, wait_s: float) -> None:
    """Tell a station what the console would tell it: where its reports and its video go.

    Args:
        drone: Whom to tell; nothing is sent unless it has ports of its own.
        tries: How often it is sent while it is not answered.
        wait_s: Wait after each, seconds.

    Raises:
        OSError: If no socket can be opened.
    """
    if drone.moves_ports:
        text = f"port {drone.state_port} {drone.video_port}"
        await ask(drone, text, tries=tries, wait_s=wait_s)
