"""A driver and a simulated Tello joined without sockets, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any

import numpy as np

from server.sim import air
from server.sim.config import DynamicsConfig, SimConfig
from server.sim.dynamics import Airframe
from server.sim.faults import parse_fault
from server.sim.sdk import TextSdk
from server.sim.tello import STEP_S, Tello
from server.sim.virtual_time import in_virtual_time
from server.stages import Setpoint
from server.swarm.config import DroneConfig, FleetConfig, SafetyConfig, TimingConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.protocol import split_label

__all__ = [
    "CALM",
    "AirLink",
    "fleet_on",
    "flying_drone",
    "flying_fleet",
    "in_virtual_time",
    "now_s",
    "plain",
    "setpoint",
    "steer",
    "sunk_to",
]

# A drone without whims: what a test sees is what it ordered.
CALM = DynamicsConfig.calm()


def now_s() -> float:
    return asyncio.get_running_loop().time()


def plain(datagram: bytes) -> bytes:
    """Return a command without its loss-proof head."""
    return split_label(datagram)[1]


class AirLink(air.AirLink):
    """A ``DroneLink`` to a simulated drone in the same process, with a few more ways to meddle.

    Attributes:
        sent: What the driver sent, with its time.
        loses: Says which datagrams to the drone are lost, by their text without a loss-proof
            head; may be replaced at any time.
        deaf: Says which datagrams from the drone are lost.
        broken: When True, sending raises, as no link should.
    """

    def __init__(
        self,
        dynamics: DynamicsConfig = CALM,
        seed: int = 0,
        faults: tuple[str, ...] = (),
        camera: air.Camera | None = None,
        **more: Any,
    ) -> None:
        config = SimConfig(
            seed=seed,
            dynamics=dynamics,
            start_sigma_m=0.0,
            start_sigma_deg=0.0,
            faults=tuple(map(parse_fault, faults)),
            **more,
        )
        super().__init__(Tello(config, 0), camera=camera)
        self.airframe.position = (0.0, 0.0, 0.0)
        self.airframe.yaw_rad = 0.0
        self.airframe.power_on()
        self.sent: list[tuple[float, bytes]] = []
        self.loses: Callable[[bytes], bool] = lambda datagram: False
        self.deaf: Callable[[bytes], bool] = lambda datagram: False
        self.broken = False

    @property
    def airframe(self) -> Airframe:
        """The drone's body: the truth."""
        return self.tello.airframe

    @property
    def sdk(self) -> TextSdk:
        """The drone's side of the protocol."""
        return self.tello.sdk

    def send(self, datagram: bytes) -> None:
        if self.broken:
            raise RuntimeError("this link is broken")
        self.sent.append((now_s(), datagram))
        if not self.loses(plain(datagram)):
            super().send(datagram)

    def since(self, begun_s: float) -> list[bytes]:
        """Return what the driver sent from ``begun_s`` on, without loss-proof heads."""
        return [plain(datagram) for at_s, datagram in self.sent if at_s >= begun_s]

    def reach_drone(self, datagram: bytes) -> None:
        """Let a datagram arrive at the drone out of the blue."""
        self._reach_drone((datagram, air.DRIVER))

    def reach_driver(self, kind: str, datagram: bytes) -> None:
        """Let a datagram (``reply``, ``state`` or ``video``) arrive at the driver."""
        assert self._receivers is not None
        take = self._receivers[("reply", "state", "video").index(kind)]
        take(datagram, now_s())

    def _reach_driver(self, arrived: Any) -> None:
        if not self.deaf(arrived.datagram):
            super()._reach_driver(arrived)


@asynccontextmanager
async def flying_drone(
    link: AirLink,
    *,
    up: bool = True,
    safety: SafetyConfig | None = None,
    config: DroneConfig | None = None,
    **more: Any,
) -> AsyncIterator[Drone]:
    """A connected drone, in the air unless ``up`` is False."""
    config = config if config is not None else DroneConfig()
    drone = Drone(config, link, safety, TimingConfig(), clock=now_s, **more)
    async with drone:
        await drone.connect()
        if up:
            await drone.take_off()
        yield drone


def fleet_on(
    links: Mapping[str, AirLink], *, serials: Sequence[str] | None = None, **more: Any
) -> Fleet:
    """A fleet on these links, by drone id."""
    drones = tuple(
        DroneConfig(
            id=drone_id,
            address=f"127.9.9.{number + 1}",
            serial=serials[number] if serials is not None else "",
        )
        for number, drone_id in enumerate(links)
    )
    return Fleet(FleetConfig(drones), links=dict(links), clock=now_s, **more)


@asynccontextmanager
async def flying_fleet(links: Mapping[str, AirLink]) -> AsyncIterator[Fleet]:
    """A connected fleet in the air."""
    async with fleet_on(links) as fleet:
        assert await fleet.connect() == {}
        await asyncio.gather(*(drone.take_off() for drone in fleet.drones.values()))
        yield fleet


def setpoint(
    forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0
) -> Setpoint:
    """A setpoint in body axes, m/s and rad/s."""
    return Setpoint(np.array([forward, left, up]), turn)


async def steer(drone: Drone, wanted: Setpoint, seconds: float) -> None:
    """Renew a setpoint ten times a second, as the pilot does."""
    until_s = now_s() + seconds
    while now_s() < until_s:
        drone.set_setpoint(wanted, now_s())
        await asyncio.sleep(0.1)


async def sunk_to(link: AirLink, height_m: float) -> None:
    """Wait until the drone is truly this low."""
    while link.airframe.position[2] > height_m:  # noqa: ASYNC110 - The truth raises no events.
        await asyncio.sleep(STEP_S)
