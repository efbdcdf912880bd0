"""Looks for drones in a network; only ever on request."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from ipaddress import IPv4Network
from typing import cast

from server.doctor.config import DoctorConfig
from server.doctor.ears import ask
from server.swarm.config import DroneConfig
from server.swarm.protocol import ProtocolError, decode_reply, encode_command

_WIDEST = 22
_COMMAND_PORT = 8889
_SETTLE_S = 1.0


@dataclass(frozen=True, slots=True)
class FoundDrone:
    """A drone that answered.

    Attributes:
        address: Its IPv4 address.
        serial: Its serial number, empty when it does not tell.
        sdk: Its SDK level as it tells, empty when it does not.
        battery_pct: Its charge, percent; None when it does not tell.
    """

    address: str
    serial: str
    sdk: str
    battery_pct: float | None


def parse_subnet(text: str) -> IPv4Network:
    """Read a subnet that may be scanned, such as ``192.168.1.0/24``.

    Raises:
        ValueError: If it is none, is larger than a /22 or is not private.
    """
    try:
        network = IPv4Network(text, strict=False)
    except ValueError:
        raise ValueError(f"{text!r} is no subnet like 192.168.1.0/24") from None
    if network.prefixlen < _WIDEST:
        raise ValueError(f"{network} is larger than a /{_WIDEST}: name the part the drones are in")
    if not network.is_private:
        raise ValueError(f"{network} is not a private network; only those are scanned")
    return network


class _Roll(asyncio.DatagramProtocol):
    """Collects the addresses that answer ``command`` as a drone does."""

    def __init__(self, asked: Collection[str]) -> None:
        self.answered: dict[str, None] = {}
        self._asked = asked

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        with contextlib.suppress(ProtocolError):
            if decode_reply(data).kind == "ok" and addr[0] in self._asked:
                self.answered[addr[0]] = None

    def error_received(self, exc: Exception) -> None:
        pass  # Hosts without a drone refuse; that is what a scan meets.


async def scan(
    network: IPv4Network,
    config: DoctorConfig,
    progress: Callable[[int, int, int], None],
    skip: Collection[str] = (),
) -> list[FoundDrone]:
    """Ask every address of ``network`` twice whether it is a drone, then each drone who it is.

    Args:
        network: See ``parse_subnet``.
        config: Waits.
        progress: Told (asked, of how many, answered so far).
        skip: Addresses that are not asked, such as our own.
    """
    hosts = [str(host) for host in network.hosts() if str(host) not in skip]
    loop = asyncio.get_running_loop()
    transport, roll = await loop.create_datagram_endpoint(
        lambda: _Roll(frozenset(hosts)), local_addr=("0.0.0.0", 0)
    )
    transport = cast("asyncio.DatagramTransport", transport)
    try:
        for turn in range(2):
            for index, host in enumerate(hosts):
                if host not in roll.answered:
                    with contextlib.suppress(OSError):
                        transport.sendto(encode_command("command"), (host, _COMMAND_PORT))
                    await asyncio.sleep(config.scan_pause_s)
                progress(turn * len(hosts) + index + 1, 2 * len(hosts), len(roll.answered))
            await asyncio.sleep(_SETTLE_S)
        progress(2 * len(hosts), 2 * len(hosts), len(roll.answered))
        addresses = sorted(roll.answered, key=lambda text: tuple(map(int, text.split("."))))
    finally:
        transport.close()
    return [await _introduce(address, config) for address in addresses]


async def _introduce(address: str, config: DoctorConfig) -> FoundDrone:
    drone = replace(DroneConfig(), link="relay", address=address)
    answers: dict[str, str] = {}
    for question in ("sn?", "sdk?", "battery?"):
        reply = await ask(drone, question, tries=config.tries, wait_s=config.reply_s)
        if reply is not None and reply.kind == "value":
            answers[question] = reply.text
    charge = answers.get("battery?", "")
    battery = float(charge) if charge.isdecimal() else None
    return FoundDrone(address, answers.get("sn?", ""), answers.get("sdk?", ""), battery)
