"""Looks for drones in a network; only ever on request."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from ipaddress import IPv4Address, IPv4Network

from server.doctor.config import DoctorConfig
from server.doctor.reads import ask_reads, number_in
from server.swarm.config import DroneConfig
from server.swarm.station import Progress, roll_call

_WIDEST = 22


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


async def scan(
    network: IPv4Network, config: DoctorConfig, progress: Progress, skip: Collection[str] = ()
) -> list[FoundDrone]:
    """Ask every address of ``network`` twice whether it is a drone, then each drone who it is.

    Args:
        network: See ``parse_subnet``.
        config: Waits.
        progress: Told (asked, of how many, answered so far).
        skip: Addresses that are not asked, such as our own.
    """
    answered = await roll_call(network, 1.0 / config.scan_pause_s, skip=skip, progress=progress)
    return [await _introduce(address, config) for address in sorted(answered, key=IPv4Address)]


async def _introduce(address: str, config: DoctorConfig) -> FoundDrone:
    drone = replace(DroneConfig(), link="relay", address=address)
    answers = await ask_reads(drone, ("sn?", "sdk?", "battery?"), config)
    battery_pct = number_in(answers, "battery?")
    return FoundDrone(address, answers.get("sn?", ""), answers.get("sdk?", ""), battery_pct)
