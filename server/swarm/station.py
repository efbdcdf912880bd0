"""Finds drones that have joined a network, by asking every address of it who is there.

Addresses come from the network's router and change; serial numbers stay. Each address is sent
``command``, and whoever answers is asked ``sn?``. That sets no drone in motion. It is done only
when somebody wants it, at a bounded rate.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Mapping
from ipaddress import IPv4Network
from typing import cast

from server.swarm.config import DroneConfig, StationConfig
from server.swarm.ports import bound_socket
from server.swarm.protocol import ProtocolError, decode_reply, read_serial

_LOG = logging.getLogger(__name__)

# Datagrams get lost: every address is asked so often, and the last answer may take so long.
_ROUNDS = 2
_LAST_ANSWER_S = 1.0

# Told (addresses asked, addresses in all, answered so far).
Progress = Callable[[int, int, int], None]


class _Hearing(asyncio.DatagramProtocol):
    """Collects who answers; asks everybody who does for its serial number."""

    def __init__(self, network: IPv4Network, command_port: int) -> None:
        self.serials: dict[str, str] = {}  # By address; empty while it has told none.
        self._network = {str(host) for host in network.hosts()}
        self._command_port = command_port
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if addr[1] != self._command_port or addr[0] not in self._network:
            return
        try:
            reply = decode_reply(data)
            if reply.kind == "ok":
                self.serials.setdefault(addr[0], "")
                self.ask(addr[0], b"sn?")
            elif reply.kind == "value":
                self.serials[addr[0]] = read_serial(reply.text)
        except ProtocolError:
            _LOG.debug("%s answers, but not like a drone", addr[0])

    def error_received(self, exc: Exception) -> None:
        # Most addresses belong to nobody.
        _LOG.debug("search: %s", exc)

    def ask(self, address: str, what: bytes) -> None:
        assert self._transport is not None
        try:
            self._transport.sendto(what, (address, self._command_port))
        except OSError as error:
            _LOG.debug("search: %s: %s", address, error)


async def roll_call(
    network: IPv4Network,
    hosts_per_s: float,
    *,
    through: DroneConfig | None = None,
    skip: Collection[str] = (),
    enough: Callable[[Mapping[str, str]], bool] = lambda _: False,
    progress: Progress | None = None,
) -> dict[str, str]:
    """Return the serial number, by address, of every drone in a network; empty if it tells none.

    Args:
        network: Whose addresses are asked, twice each.
        hosts_per_s: How many addresses are asked per second.
        through: Whose local address, interface and command port to use.
        skip: Addresses that are not asked.
        enough: Says of those found so far whether to end early.
        progress: Called with (addresses asked, addresses in all, both over all rounds, answered).

    Raises:
        LinkError: If the socket cannot be opened.
    """
    asker = through if through is not None else DroneConfig(id="search")
    hosts = [str(host) for host in network.hosts() if str(host) not in skip]
    loop = asyncio.get_running_loop()
    transport, hearing = await loop.create_datagram_endpoint(
        lambda: _Hearing(network, asker.command_port), sock=bound_socket(asker, 0)
    )
    serials = hearing.serials
    try:
        asked = 0
        for _ in range(_ROUNDS):
            for host in hosts:
                if enough(serials):
                    return dict(serials)
                # Whoever answered ``command`` but whose serial number got lost is asked once more.
                if not serials.get(host):
                    hearing.ask(host, b"command")
                    await asyncio.sleep(1.0 / hosts_per_s)
                asked += 1
                if progress is not None:
                    progress(asked, _ROUNDS * len(hosts), len(serials))
            deadline_s = loop.time() + _LAST_ANSWER_S
            while loop.time() < deadline_s and not enough(serials):  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        return dict(serials)
    finally:
        transport.close()


async def find_stations(
    config: StationConfig,
    wanted: Collection[str] = (),
    *,
    through: DroneConfig | None = None,
    skip: Collection[str] = (),
    progress: Progress | None = None,
) -> dict[str, str]:
    """Return the addresses of the drones in a network by their serial numbers.

    Args:
        config: Which network, how fast.
        wanted: Ends early when all these serial numbers are found; empty means to ask everybody.
        through: See ``roll_call``, as are the others.
        skip: Addresses that are not asked.
        progress: Told how far the search is.

    Raises:
        ValueError: If the network is not given or wrong.
        LinkError: If the socket cannot be opened.
    """
    serials = await roll_call(
        config.network(),
        config.hosts_per_s,
        through=through,
        skip=skip,
        enough=lambda found: bool(wanted) and set(wanted) <= set(found.values()),
        progress=progress,
    )
    return {serial: address for address, serial in serials.items() if serial}
