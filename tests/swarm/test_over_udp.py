"""The driver against the simulator over real sockets, in real time.

Everything that can be told without sockets is told in virtual time elsewhere; here waits are
generous and nothing is concluded from how long anything takes.
"""

from __future__ import annotations

import asyncio
import json
import random
import socket
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace

import numpy as np
import pytest
from ideal_camera import IDEAL_CAMERA
from numpy.typing import NDArray
from virtual_air import CALM, setpoint

from server.sim.config import SimConfig, fleet_config
from server.sim.drone import SimError, SimulatedDrone
from server.sim.simulator import run_simulator
from server.swarm.config import DroneConfig, FleetConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.link import UdpDroneLink
from server.swarm.ports import LinkError, PortBoard

pytestmark = pytest.mark.loopback

PATIENCE_S = 30.0


def some_simulation(drones: int) -> SimConfig:
    """Drones in a block of loopback addresses of this run's own."""
    block = f"127.{random.randint(16, 250)}.{random.randint(0, 255)}"
    return SimConfig(
        drones=drones,
        base_address=f"{block}.1",
        dynamics=CALM,
        camera=IDEAL_CAMERA,
        fps_cap=10.0,
    )


async def until(holds: Callable[[], bool]) -> None:
    """Wait for something that must come about."""
    async with asyncio.timeout(PATIENCE_S):
        while not holds():  # noqa: ASYNC110 - The truth raises no events.
            await asyncio.sleep(0.02)


async def steer_until(drone: Drone, forward: float, holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not holds():
            drone.set_setpoint(setpoint(forward=forward), time.monotonic())
            await asyncio.sleep(0.05)


@asynccontextmanager
async def simulated(config: SimConfig, pace: float = 1.0) -> AsyncIterator[list[SimulatedDrone]]:
    """Drones without pictures whose time runs ``pace`` times faster than ours."""
    async with AsyncExitStack() as stack:
        yield [
            await stack.enter_async_context(
                SimulatedDrone(config, index, clock=lambda: time.monotonic() * pace)
            )
            for index in range(config.drones)
        ]


@pytest.mark.slow
async def test_a_flight_of_two() -> None:
    config = some_simulation(2)
    async with simulated(config, pace=2.0) as bodies, Fleet(fleet_config(config)) as fleet:
        assert await fleet.connect(PATIENCE_S) == {}
        drones = list(fleet.drones.values())
        assert all(drone.telemetry is not None for drone in drones)
        await asyncio.gather(*(drone.take_off() for drone in drones))
        assert all(0.6 < body.airframe.position[2] < 1.0 for body in bodies)

        start = bodies[0].airframe.position.copy()
        ahead = np.array([np.cos(bodies[0].airframe.yaw_rad), np.sin(bodies[0].airframe.yaw_rad)])

        def gone_m() -> float:
            return float((bodies[0].airframe.position - start)[:2] @ ahead)

        await steer_until(drones[0], 0.4, lambda: gone_m() > 0.3)
        await until(lambda: bodies[0].airframe.sticks == (0, 0, 0, 0))  # Not renewed: hover.

        drones[0].set_setpoint(setpoint(forward=0.4), time.monotonic())
        fleet.hold(drones[0].config.id)
        assert not drones[0].set_setpoint(setpoint(forward=0.4), time.monotonic())
        await until(lambda: bodies[0].airframe.sticks == (0, 0, 0, 0))
        assert not drones[1].held

        fleet.land(drones[1].config.id)
        await until(lambda: bodies[1].airframe.phase == "standing")
        await until(lambda: drones[1].activity == "ground")
        assert bodies[0].airframe.phase == "flying"

        fleet.cut_motors()
        await until(lambda: bodies[0].airframe.phase == "standing")
        assert [drone.activity for drone in drones] == ["cut", "cut"]


@pytest.mark.slow
async def test_a_drone_that_dies_in_the_air_keeps_nobody_else_from_stopping() -> None:
    config = some_simulation(2)
    async with AsyncExitStack() as stack:
        dying = await stack.enter_async_context(AsyncExitStack())
        bodies = [SimulatedDrone(config, k, lambda: 2.0 * time.monotonic()) for k in range(2)]
        await dying.enter_async_context(bodies[0])
        await stack.enter_async_context(bodies[1])
        fleet = await stack.enter_async_context(Fleet(fleet_config(config)))
        assert await fleet.connect(PATIENCE_S) == {}
        await asyncio.gather(*(drone.take_off() for drone in fleet.drones.values()))
        await dying.aclose()
        first, second = fleet.drones.values()
        await until(lambda: first.activity == "landing")  # Its silence was noticed.
        assert second.activity == "flying"
        fleet.land()
        await until(lambda: bodies[1].airframe.phase == "standing")
        await until(lambda: second.activity == "ground")
        first.cut_motors()  # Leaving need not wait for its landing.


@pytest.mark.slow
async def test_a_driver_that_falls_silent_is_landed_by_its_drone() -> None:
    config = some_simulation(1)
    async with simulated(config, pace=6.0) as (body,):
        client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with client:
            client.setblocking(False)
            client.bind((config.address(0)[:-1] + "101", 0))
            loop = asyncio.get_running_loop()
            for word in (b"command", b"takeoff"):
                client.sendto(word, (config.address(0), 8889))
                async with asyncio.timeout(PATIENCE_S):
                    assert await loop.sock_recv(client, 100) == b"ok"
            assert body.airframe.phase == "flying"
            await until(lambda: body.sdk.auto_landing)
            await until(lambda: body.airframe.phase == "standing")


class PaintedWorld:
    """Pictures at constant cost: where the camera is, as a shade."""

    def __init__(self) -> None:
        self.closed = False

    def render(
        self,
        T_world_cam: NDArray[np.float64],
        other_drones: Sequence[tuple[NDArray[np.float64], float]] = (),
    ) -> NDArray[np.uint8]:
        image = np.full((720, 960, 3), 40, np.uint8)
        image[200:500, 300:600] = (200, 120, 90)
        image[:100] = round(min(max(60 * T_world_cam[2, 3], 0), 255))
        return image

    def close(self) -> None:
        self.closed = True


@pytest.mark.slow
async def test_pictures_come_through_the_whole_simulator() -> None:
    config = some_simulation(2)
    world, lines, stop = PaintedWorld(), asyncio.Queue[str](), asyncio.Event()
    running = asyncio.create_task(
        run_simulator(config, maker=lambda _: world, announce=lines.put_nowait, stop=stop)
    )
    async with asyncio.timeout(PATIENCE_S):
        ready = json.loads(await lines.get())
    assert ready["ready"] is True
    assert [drone["address"] for drone in ready["drones"]] == [config.address(0), config.address(1)]
    async with Fleet(fleet_config(config)) as fleet:
        assert await fleet.connect(PATIENCE_S) == {}
        for drone in fleet.drones.values():
            async with asyncio.timeout(PATIENCE_S):
                frame = await drone.next_frame(after=3)
            assert frame.image_bgr.shape == (720, 960, 3)
            assert not frame.damaged
            assert frame.drone_id == drone.config.id
            np.testing.assert_allclose(frame.image_bgr[350, 450], (200, 120, 90), atol=12)
        first, second = fleet.drones.values()
        first.set_video(False)
        await until(lambda: first.video_fps == 0.0)
        assert first.newest_frame is not None
        dark_at = first.newest_frame.sequence
        await second.next_frame(after=second.newest_frame.sequence if second.newest_frame else 0)
        first.set_video(True)
        async with asyncio.timeout(PATIENCE_S):
            frame = await first.next_frame(after=dark_at)
        assert not frame.damaged, "video begins anew with a key picture"
    stop.set()
    async with asyncio.timeout(PATIENCE_S):
        await running
    assert world.closed


# Sockets ------------------------------------------------------------------------------------------


async def test_an_address_in_use_is_told_in_one_line() -> None:
    config = some_simulation(1)
    async with simulated(config):
        with pytest.raises(SimError, match=f"{config.address(0)}:8889") as caught:
            async with simulated(config):
                pass
        assert "\n" not in str(caught.value)


async def test_a_port_in_use_is_told_in_one_line() -> None:
    local = some_simulation(1).address(0)
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with taken:
        taken.bind((local, 8890))
        link = UdpDroneLink(DroneConfig(address="127.0.0.9", local_address=local))
        with pytest.raises(LinkError, match="port 8890") as caught:
            await link.open(lambda *_: None, lambda *_: None, lambda *_: None)
        assert "\n" not in str(caught.value)


@asynccontextmanager
async def two_on_one_port() -> AsyncIterator[tuple[list[UdpDroneLink], dict[str, list[bytes]]]]:
    """Two links that share one local address, and what each drone's state port heard."""
    config = some_simulation(2)
    board = PortBoard()
    local = config.address(0)[:-1] + "150"
    drones = [replace(drone, local_address=local) for drone in fleet_config(config).drones]
    heard: dict[str, list[bytes]] = {drone.address: [] for drone in drones}
    links = [UdpDroneLink(drone, board) for drone in drones]
    for link, into in zip(links, heard.values(), strict=True):
        await link.open(
            lambda *_: None, lambda data, _, into=into: into.append(data), lambda *_: None
        )
    try:
        yield links, heard
    finally:
        for link in links:
            link.close()
            link.close()  # Closing twice is allowed.


def report_from(address: str, text: str) -> None:
    """Send a datagram to the state port that the drones of ``two_on_one_port`` share."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((address, 0))
        sender.sendto(text.encode(), (f"{address.rsplit('.', 1)[0]}.150", 8890))


async def test_drones_on_one_local_port_are_told_apart_by_their_address() -> None:
    async with two_on_one_port() as (links, heard):
        first, second = heard
        for address in (first, second, f"{first.rsplit('.', 1)[0]}.99"):
            report_from(address, address)
        await until(lambda: all(heard.values()))
        assert heard == {first: [first.encode()], second: [second.encode()]}
        links[0].close()
        report_from(second, "again")
        await until(lambda: len(heard[second]) == 2)


async def test_two_drones_that_exchange_their_addresses_are_both_heard() -> None:
    """As DHCP may have it: the second one's leaving must not deafen the first."""
    async with two_on_one_port() as (links, heard):
        first, second = heard
        await links[0].move_to(second)
        await links[1].move_to(first)
        report_from(second, "was first")
        report_from(first, "was second")
        await until(lambda: all(heard.values()))
        assert heard == {first: [b"was first"], second: [b"was second"]}


async def test_a_closed_link_counts_what_it_cannot_send() -> None:
    config = DroneConfig(address="127.0.0.9")
    link = UdpDroneLink(config)
    link.send(b"stop")
    assert Drone(config, link).unsent == link.unsent == 1


async def test_a_fleet_whose_ports_are_taken_leaves_nothing_open() -> None:
    config = some_simulation(2)
    drones = fleet_config(config).drones
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with taken:
        taken.bind((drones[1].local_address, 8890))
        with pytest.raises(LinkError, match=drones[1].id):
            async with Fleet(FleetConfig(drones)):
                pass
    await asyncio.sleep(0.1)  # Sockets are closed at the loop's next turn.
    async with Fleet(FleetConfig(drones)):
        pass
