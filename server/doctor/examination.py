"""Runs all checks in their order and hands out each finding as it is made."""

from __future__ import annotations

import asyncio
import ctypes
import os
import sys
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, distributions, requires, version
from ipaddress import IPv4Network
from pathlib import Path

import cv2
import psutil

from server.doctor.config import DoctorConfig
from server.doctor.diagnosis import diagnose
from server.doctor.ears import Ears
from server.doctor.finding import Finding
from server.doctor.firewall import opening_advice, read_platform, read_tools
from server.doctor.machine import (
    check_clock,
    check_gpu,
    check_memory,
    check_opencv,
    check_packages,
    check_processors,
    check_python,
    check_runs,
    check_settings,
    check_web,
    check_x11,
)
from server.doctor.network import (
    check_buffer,
    check_port,
    check_route,
    check_shared_networks,
    console_of,
    read_buffer,
    read_interfaces,
)
from server.doctor.probe import probe_drone
from server.doctor.readings import read_gpu_driver, read_time_server, read_torch_device
from server.swarm.config import STATE_PORT, VIDEO_PORT, DroneConfig, FleetConfig

# Most Tello programs send their commands from this port; the console does not need it.
_COMMAND_PORT = 8889
_DIST = Path(__file__).parent.parent.parent / "web" / "dist"


@dataclass(frozen=True, slots=True)
class Subject:
    """What is examined.

    Attributes:
        fleet: The drones, None for the machine alone.
        runs: Folder of the run folders.
        web: Folder of the built dashboard.
        config: Waits and limits.
    """

    fleet: FleetConfig | None
    runs: Path
    web: Path = _DIST
    config: DoctorConfig = field(default_factory=DoctorConfig)


async def examine(subject: Subject) -> AsyncIterator[Finding]:
    """Yield the findings, those about the machine first."""
    offset_s = time.time() - time.monotonic()
    config = subject.config
    for finding in _machine(subject):
        yield finding
    yield check_gpu(*await asyncio.gather(read_gpu_driver(), read_torch_device(config.gpu_s)))
    step_s = time.time() - time.monotonic() - offset_s
    yield check_clock(await read_time_server(), step_s, config)
    if subject.fleet is None:
        for port in (_COMMAND_PORT, STATE_PORT, VIDEO_PORT):
            # Another address of this machine may be all that is taken, so this does not fail.
            yield check_port(port, needed=False)
        detail = "none were asked: name them with --fleet FILE, or simulate some with --sim"
        yield Finding("drones", "skip", detail)
        return
    console = console_of(subject.fleet.drones)
    if console is not None:
        detail = f"left alone: a console has them, {console}"
        yield Finding("drones", "skip", detail, "its dashboard shows them; end it to check here")
        return
    for finding in _network(subject.fleet):
        yield finding
    async for finding in _drones(subject.fleet, config):
        yield finding


def _machine(subject: Subject) -> Iterator[Finding]:
    config = subject.config
    yield check_python((sys.version_info.major, sys.version_info.minor))
    yield check_packages(_requirements(), _version)
    packages = {item.name.lower(): item.version for item in distributions()}
    opencv = {name: number for name, number in packages.items() if name.startswith("opencv")}
    yield check_opencv(opencv, cv2.__version__)
    yield check_x11(ctypes.CDLL)
    yield check_web(subject.web)
    yield check_settings(os.environ)
    yield check_runs(subject.runs, config)
    memory = psutil.virtual_memory()
    yield check_memory(memory.available, memory.total, config)
    yield check_processors(os.cpu_count() or 1, os.getloadavg()[0])


def _requirements() -> list[str]:
    try:
        return requires("dronerf") or []
    except PackageNotFoundError:
        return []


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _network(fleet: FleetConfig) -> Iterator[Finding]:
    places: dict[tuple[int, str, str], bool] = {}
    for drone in fleet.drones:
        where = (drone.local_address, drone.interface)
        places[(_COMMAND_PORT, *where)] = False
        for port in (drone.state_port, drone.video_port):
            places[(port, *where)] = True
    findings = [check_port(*place, needed=needed) for place, needed in places.items()]
    bad = [finding for finding in findings if finding.status != "ok"]
    yield from bad
    if not bad:
        ports = ", ".join(map(str, sorted({port for port, _, _ in places})))
        yield Finding("UDP ports", "ok", f"{ports} are free")
    yield check_buffer(read_buffer())
    named = [drone.interface for drone in fleet.drones if drone.interface]
    shared = check_shared_networks(named, read_interfaces())
    if shared is not None:
        yield shared


async def _drones(fleet: FleetConfig, config: DoctorConfig) -> AsyncIterator[Finding]:
    ports = sorted({port for d in fleet.drones for port in (d.state_port, d.video_port)})
    opening = opening_advice(ports, read_platform(), read_tools())
    async with Ears() as ears:
        # Side by side, as in a capture: what four streams do to the air and to the machine shows.
        probing = [
            asyncio.create_task(
                _drone(drone, ears, opening, fleet.station.subnet, config),
                name=f"doctor {drone.id}",
            )
            for drone in fleet.drones
        ]
        try:
            for task in probing:
                for finding in await task:
                    yield finding
        finally:
            for task in probing:
                task.cancel()
            await asyncio.gather(*probing, return_exceptions=True)


async def _drone(
    drone: DroneConfig, ears: Ears, opening: str, subnet: str, config: DoctorConfig
) -> list[Finding]:
    if not drone.address:
        detail = f"known by its serial number {drone.serial} alone: --scan {subnet} looks for it"
        return [Finding("drone", "skip", detail, "", drone.id)]
    route = check_route(drone, read_interfaces())
    try:
        probe = await probe_drone(drone, ears, config)
    except OSError as error:
        detail = f"not asked, its sockets cannot be opened: {error.strerror or error}"
        return [route, Finding("drone", "skip", detail, "", drone.id)]
    return [route, *diagnose(drone, probe, opening, config)]


def named_by_scan(fleet: FleetConfig, found: dict[str, str]) -> FleetConfig:
    """Return the fleet with addresses of drones that were found by their serial number.

    Args:
        fleet: The fleet.
        found: Addresses by serial number.
    """
    return replace(
        fleet,
        drones=tuple(
            drone if drone.address else replace(drone, address=found.get(drone.serial, ""))
            for drone in fleet.drones
        ),
    )


def may_scan(network: IPv4Network) -> Finding | None:
    """Return why a scan must not be made now, None when it may.

    A console's drones would be asked in flight, and their reports would tell nothing new.
    """
    console = console_of([DroneConfig()])  # The usual ports, at any address.
    if console is None:
        return None
    detail = f"{network} was not scanned: {console} flies drones"
    return Finding("scan", "skip", detail, "end the console first")
