"""Finding drones in a network, and sockets that cannot be opened."""

from __future__ import annotations

import asyncio
import errno
import random
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from server.sim.config import SimConfig
from server.sim.drone import SimulatedDrone
from server.swarm.config import DroneConfig, FleetConfig, StationConfig
from server.swarm.fleet import Fleet
from server.swarm.link import UdpDroneLink
from server.swarm.ports import LinkError, bound_socket
from server.swarm.station import find_stations

pytestmark = pytest.mark.loopback

PATIENCE_S = 30.0


def block() -> str:
    """The first three parts of addresses of this test's own."""
    return f"127.{random.randint(16, 250)}.{random.randint(0, 255)}"


@asynccontextmanager
async def drones_at(addresses: dict[str, str]) -> AsyncIterator[list[SimulatedDrone]]:
    """Simulated drones by address, with the serial numbers that go with them."""
    async with AsyncExitStack() as stack:
        drones: list[SimulatedDrone] = []
        for address, serial in addresses.items():
            drone = SimulatedDrone(SimConfig(drones=1, base_address=address, station=True), 0)
            drone.tello._serial = drone.tello.sdk._serial = serial
            drones.append(await stack.enter_async_context(drone))
        yield drones


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110 - The truth raises no events.
            await asyncio.sleep(0.02)


@pytest.mark.slow
async def test_a_search_finds_who_is_there_and_reports_how_far_it_is() -> None:
    net = block()
    config = StationConfig(f"{net}.0/28", hosts_per_s=500.0)
    seen: list[tuple[int, int, int]] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((f"{net}.9", 8889))  # Somebody who is no drone and never answers.
        async with drones_at({f"{net}.3": "0TQAAAAAAAAAA3", f"{net}.11": "0TQAAAAAAAAAB1"}):
            found = await find_stations(config, progress=lambda *at: seen.append(at))
            assert found == {"0TQAAAAAAAAAA3": f"{net}.3", "0TQAAAAAAAAAB1": f"{net}.11"}
            assert seen[-1] == (28, 28, 2)
            assert [at for at, _, _ in seen] == list(range(1, 29))
            seen.clear()
            found = await find_stations(
                config, ["0TQAAAAAAAAAA3"], progress=lambda *at: seen.append(at)
            )
            assert found["0TQAAAAAAAAAA3"] == f"{net}.3"
            assert len(seen) < 28, "it ends when the wanted ones are found"
            found = await find_stations(config, skip=[f"{net}.3"])
            assert list(found) == ["0TQAAAAAAAAAB1"]


async def test_nothing_is_searched_without_a_network() -> None:
    with pytest.raises(ValueError, match=r"station\.subnet must be a network"):
        await find_stations(StationConfig())


@pytest.mark.slow
async def test_a_fleet_finds_its_stations_and_finds_them_again() -> None:
    """Known by serial numbers; one gets another address from its router."""
    net = block()
    local = f"{net}.14"
    serials = ("0TQAAAAAAAAAA1", "0TQAAAAAAAAAA2")
    fleet_config = FleetConfig(
        tuple(
            DroneConfig(id=f"d{k}", link="station", address="", serial=serial, local_address=local)
            for k, serial in enumerate(serials)
        ),
        station=StationConfig(f"{net}.0/28", hosts_per_s=500.0, search_again_s=1.0),
    )
    async with AsyncExitStack() as stack:
        moving = await stack.enter_async_context(AsyncExitStack())
        await moving.enter_async_context(drones_at({f"{net}.2": serials[0]}))
        await stack.enter_async_context(drones_at({f"{net}.3": serials[1]}))
        fleet = await stack.enter_async_context(Fleet(fleet_config))
        assert fleet.address("d0") == ""
        assert await fleet.connect(PATIENCE_S) == {}
        assert [fleet.address(i) for i in fleet.drones] == [f"{net}.2", f"{net}.3"]
        await until(lambda: all(d.facts.serial == d.config.serial for d in fleet.drones.values()))
        await moving.aclose()
        await until(lambda: fleet.drones["d0"].activity == "offline")
        await stack.enter_async_context(drones_at({f"{net}.7": serials[0]}))
        await until(lambda: fleet.drones["d0"].activity == "ground")
        assert fleet.address("d0") == f"{net}.7"
        assert fleet.drones["d1"].activity == "ground", "its shared ports were left alone"
        assert fleet.drones["d1"].telemetry is not None


@pytest.mark.slow
async def test_a_serial_number_nobody_has_is_told_in_one_line() -> None:
    net = block()
    fleet_config = FleetConfig(
        (
            DroneConfig(
                id="d0",
                link="station",
                address="",
                serial="0TQAAAAAAAAAA9",
                local_address=f"{net}.1",
            ),
        ),
        station=StationConfig(f"{net}.0/30", hosts_per_s=500.0),
    )
    async with Fleet(fleet_config) as fleet:
        failures = await fleet.connect(1.0)
    assert failures == {"d0": f"d0: no drone with the serial number 0TQAAAAAAAAAA9 in {net}.0/30"}


# Sockets ------------------------------------------------------------------------------------------


async def test_an_interface_that_does_not_exist_is_told_in_one_line() -> None:
    link = UdpDroneLink(DroneConfig(id="d0", interface="nowhere7", local_address="127.0.0.9"))
    with pytest.raises(LinkError) as caught:
        await link.open(lambda *_: None, lambda *_: None, lambda *_: None)
    assert "\n" not in str(caught.value)
    for words in ("d0", "8890", "no interface 'nowhere7'"):
        assert words in str(caught.value)


def test_a_local_address_of_somebody_else_is_told_in_one_line() -> None:
    with pytest.raises(LinkError, match=r"192\.0\.2\.1 is no address of this machine"):
        bound_socket(DroneConfig(local_address="192.0.2.1"), 0)


def test_a_missing_permission_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    class Refusing(socket.socket):
        def setsockopt(self, *arguments: object) -> None:
            raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr("server.swarm.ports.socket.socket", Refusing)
    with pytest.raises(LinkError, match="CAP_NET_RAW"):
        bound_socket(DroneConfig(interface="lo"), 0)
