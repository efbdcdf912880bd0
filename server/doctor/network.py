"""Checks of interfaces and ports. What reads the machine stands first, then what judges it."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import psutil

from server.doctor.finding import Finding
from server.swarm.config import DroneConfig
from server.swarm.ports import VIDEO_BUFFER_BYTES, widen_buffer

_ON_THE_WAY = "join the drone's Wi-Fi (TELLO-...), or mend its address in the fleet file"


@dataclass(frozen=True, slots=True)
class Interface:
    """A network interface.

    Attributes:
        name: Its name.
        up: Whether it is switched on.
        addresses: Its IPv4 addresses with their networks.
    """

    name: str
    up: bool
    addresses: tuple[IPv4Interface, ...]


@dataclass(frozen=True, slots=True)
class Holder:
    """A process that holds a port.

    Attributes:
        pid: Its id, None when it belongs to somebody else and cannot be seen.
        command: Its command line, empty when unknown.
    """

    pid: int | None
    command: str = ""

    @property
    def is_console(self) -> bool:
        """Whether it is one of our own consoles."""
        return any(word in self.command for word in ("dronerf serve", "dronerf demo")) or (
            "server serve" in self.command or "server demo" in self.command
        )

    def __str__(self) -> str:
        if self.pid is None:
            return "a process of another user"
        words = self.command.split()
        # The interpreter and the folders say little.
        words = [Path(word).name for word in words[:2]] + words[2:]
        if words and words[0].startswith("python"):
            words = words[1:]
        return f"process {self.pid}" + (f" ({' '.join(words)[:60]})" if words else "")


def read_interfaces() -> list[Interface]:
    """Return this machine's interfaces."""
    states = psutil.net_if_stats()
    found: list[Interface] = []
    for name, entries in psutil.net_if_addrs().items():
        addresses = tuple(
            IPv4Interface(f"{entry.address}/{entry.netmask or '255.255.255.255'}")
            for entry in entries
            if entry.family == socket.AF_INET
        )
        found.append(Interface(name, name in states and states[name].isup, addresses))
    return found


def read_rp_filter(interface: str, root: Path = Path("/proc/sys/net/ipv4/conf")) -> int | None:
    """Return the reverse path filter that acts on an interface, None where there is none.

    The kernel takes the larger one of the interface's own value and that of ``all``.
    """
    try:
        return max(int((root / name / "rp_filter").read_text()) for name in (interface, "all"))
    except (OSError, ValueError):
        return None


def read_holders(port: int, local_address: str) -> list[Holder]:
    """Return who, ourselves excepted, holds a UDP port of an address (empty: of any address)."""
    try:
        sockets = psutil.net_connections("udp4")
    except psutil.Error:
        return []
    found: list[Holder] = []
    for entry in sockets:
        ip, number = entry.laddr or ("", 0)
        if number != port or entry.pid == os.getpid():
            continue
        if local_address and ip not in (local_address, "0.0.0.0"):
            continue
        command = ""
        if entry.pid is not None:
            try:
                command = " ".join(psutil.Process(entry.pid).cmdline())
            except psutil.Error:
                command = ""
        found.append(Holder(entry.pid, command))
    return found


def console_of(drones: Iterable[DroneConfig]) -> Holder | None:
    """Return the console of ours that has any of these drones' local ports, None without one."""
    holders = (
        holder
        for drone in drones
        for port in (drone.state_port, drone.video_port)
        for holder in read_holders(port, drone.local_address)
    )
    return next((holder for holder in holders if holder.is_console), None)


def read_buffer() -> int:
    """Return how many bytes of unread video the kernel keeps for a socket of ours."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        return widen_buffer(opened, VIDEO_BUFFER_BYTES)


def open_udp(local_address: str, interface: str, port: int) -> socket.socket:
    """Return a non-blocking UDP socket bound as the driver binds its own; raises OSError."""
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        opened.setblocking(False)
        if interface:
            # Only Linux can bind a socket to an interface.
            option = getattr(socket, "SO_BINDTODEVICE", None)
            if option is None:
                raise OSError(errno.ENOPROTOOPT, "this system cannot bind to an interface")
            opened.setsockopt(socket.SOL_SOCKET, option, interface.encode() + b"\0")
        opened.bind((local_address, port))
    except OSError:
        opened.close()
        raise
    return opened


def check_port(
    port: int,
    local_address: str = "",
    interface: str = "",
    *,
    needed: bool = True,
    holders: Callable[[int, str], Sequence[Holder]] = read_holders,
) -> Finding:
    """Judge whether a local UDP port can be had, by having it for a moment.

    Args:
        port: The port.
        local_address: Of this address; empty for any.
        interface: On this interface; empty for any.
        needed: False when drones are flown without it, too.
        holders: Tells who holds a port.
    """
    check = f"UDP port {port}"
    where = (local_address or "any address") + (f" on {interface}" if interface else "")
    try:
        open_udp(local_address, interface, port).close()
    except OSError as error:
        return _judge_bind_error(check, where, error, needed, list(holders(port, local_address)))
    return Finding(check, "ok", f"free at {where}")


def _judge_bind_error(
    check: str, where: str, error: OSError, needed: bool, held_by: list[Holder]
) -> Finding:
    if error.errno == errno.EADDRINUSE:
        who = ", ".join(map(str, held_by)) or "a process that cannot be seen from here"
        detail = f"taken at {where} by {who}"
        if any(holder.is_console for holder in held_by):
            remedy = "a console is running and shows its drones itself; end it to check them here"
            return Finding(check, "warn", detail, remedy)
        if not needed:
            remedy = "another Tello program? two of them must not command one drone"
            return Finding(check, "warn", detail, remedy)
        return Finding(check, "fail", detail, "end that program, or give it another port")
    if error.errno == errno.EPERM:
        return Finding(
            check,
            "fail",
            f"no right to bind a socket to an interface ({where})",
            'sudo setcap cap_net_raw+ep "$(readlink -f .venv/bin/python)", or run as root',
        )
    if error.errno == errno.ENODEV:
        remedy = "plug the adapter in, or correct `interface` in the fleet file (ip -br link)"
        return Finding(check, "fail", f"there is no such interface ({where})", remedy)
    if error.errno == errno.EADDRNOTAVAIL:
        remedy = "correct `local_address` in the fleet file (ip -br address), or leave it out"
        return Finding(check, "fail", f"{where} is no address of this machine", remedy)
    detail = f"cannot be opened at {where}: {error.strerror or error}"
    return Finding(check, "fail", detail, "correct local_address and interface in the fleet file")


def check_route(drone: DroneConfig, interfaces: Sequence[Interface]) -> Finding:
    """Judge whether this machine has a way to a drone."""
    address = IPv4Address(drone.address)
    if drone.interface:
        return _judge_interface(drone, address, interfaces)
    near = [
        interface
        for interface in interfaces
        if interface.up and any(address in own.network for own in interface.addresses)
    ]
    if near:
        names = ", ".join(interface.name for interface in near)
        if len(near) > 1:
            return Finding(
                "network",
                "warn",
                f"{address} is on the networks of {names}: which one is left to chance",
                "set `interface` in the fleet file",
                drone.id,
            )
        return Finding("network", "ok", f"{address} is on the network of {names}", "", drone.id)
    if address == IPv4Address("192.168.10.1"):
        detail = f"no network of this machine holds {address}"
        return Finding("network", "fail", detail, _ON_THE_WAY, drone.id)
    detail = f"{address} is on no network of this machine, only a router leads there"
    return Finding("network", "warn", detail, _ON_THE_WAY, drone.id)


def _judge_interface(
    drone: DroneConfig, address: IPv4Address, interfaces: Sequence[Interface]
) -> Finding:
    name = drone.interface
    found = next((interface for interface in interfaces if interface.name == name), None)
    if found is None:
        known = ", ".join(interface.name for interface in interfaces)
        return Finding(
            "network",
            "fail",
            f"there is no interface {name} (there are {known})",
            "plug the adapter in, or correct `interface` in the fleet file",
            drone.id,
        )
    if not found.up:
        remedy = f"sudo ip link set {name} up, and join the drone's Wi-Fi with it"
        return Finding("network", "fail", f"{name} is switched off", remedy, drone.id)
    if not found.addresses:
        remedy = f"join the drone's Wi-Fi with {name}; it hands out an address by itself"
        return Finding("network", "fail", f"{name} has no IPv4 address", remedy, drone.id)
    own = ", ".join(str(entry) for entry in found.addresses)
    if not any(address in entry.network for entry in found.addresses):
        return Finding(
            "network",
            "fail",
            f"{name} has {own}, which is not the network of {address}",
            f"{name} has joined another Wi-Fi: join that of the drone (TELLO-...)",
            drone.id,
        )
    return Finding("network", "ok", f"{name} has {own}", "", drone.id)


def check_shared_networks(
    names: Iterable[str],
    interfaces: Sequence[Interface],
    rp_filter: Callable[[str], int | None] = read_rp_filter,
) -> Finding | None:
    """Judge adapters that share one network, as those of drones that are all 192.168.10.1 do.

    Args:
        names: Interfaces that the fleet names.
        interfaces: Those of the machine.
        rp_filter: Reads the reverse path filter that acts on an interface.

    Returns:
        None when no two of them share a network.
    """
    wanted = set(names)
    on: dict[ipaddress.IPv4Network, list[str]] = {}
    for interface in interfaces:
        if interface.name in wanted:
            for own in interface.addresses:
                on.setdefault(own.network, []).append(interface.name)
    shared = sorted({name for users in on.values() if len(users) > 1 for name in users})
    if not shared:
        return None
    strict = [name for name in shared if rp_filter(name) == 1]
    if strict:
        lines = " ".join(f"net.ipv4.conf.{name}.rp_filter=2" for name in strict)
        return Finding(
            "reverse path filter",
            "fail",
            f"{', '.join(shared)} share a network and {', '.join(strict)} filter strictly:"
            " the kernel drops what drones send there",
            f"sudo sysctl -w {lines}",
        )
    return Finding("reverse path filter", "ok", f"{', '.join(shared)} share a network, not strict")


def check_buffer(room_bytes: int, needed_bytes: int = VIDEO_BUFFER_BYTES) -> Finding:
    """Judge the room for video that arrives while the console is busy.

    Args:
        room_bytes: How many bytes the kernel keeps.
        needed_bytes: How many the console asks for.
    """
    check = "receive buffer"
    detail = f"{room_bytes / 2**20:.1f} MiB for video that waits to be read"
    if room_bytes < needed_bytes:
        detail += f", {needed_bytes / 2**20:.1f} are wanted: a busy moment damages pictures"
        return Finding(check, "warn", detail, f"sudo sysctl -w net.core.rmem_max={needed_bytes}")
    return Finding(check, "ok", detail)
