"""A simulated drone on loopback with a camera of ours, and a record of what it was told."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from server.sim.config import DynamicsConfig, SimConfig, fleet_config
from server.sim.drone import SimulatedDrone
from server.sim.encoder import VideoEncoder
from server.sim.words import SdkLevel
from server.swarm.config import DroneConfig, FleetConfig

FPS = 15.0

# What the doctor and a calibration may say to a drone.
HARMLESS = {
    *("command", "streamon", "streamoff"),
    *("sdk?", "sn?", "battery?", "wifi?", "speed?", "time?", "height?", "temp?"),
    *("attitude?", "baro?", "acceleration?", "tof?"),
}


@dataclass(slots=True)
class Rig:
    """The simulated drones, how they are reached, and everything they were told."""

    drones: list[SimulatedDrone]
    fleet: FleetConfig
    heard: list[str] = field(default_factory=list)

    @property
    def config(self) -> DroneConfig:
        return self.fleet.drones[0]

    def with_drone(self, **changes: object) -> FleetConfig:
        """Return the fleet of the first drone alone, described differently."""
        changed = replace(self.config, **changes)  # pyright: ignore[reportArgumentType]
        return FleetConfig((changed,))


def some_block() -> str:
    return f"127.{random.randint(16, 250)}.{random.randint(0, 255)}"


def still_pictures() -> list[NDArray[np.uint8]]:
    """Two pictures with something to see."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (2, 12, 16, 3), dtype=np.uint8)
    return [np.kron(image, np.ones((60, 60, 1), np.uint8)) for image in coarse]


@asynccontextmanager
async def rig(
    drones: int = 1,
    pictures: Sequence[NDArray[np.uint8]] | None = None,
    each: int = 1,
    dynamics: DynamicsConfig | None = None,
    lost: Callable[[int], bool] = lambda number: False,
    sdk: SdkLevel = "3.0",
    friendly_reads: bool = False,
    station: bool = False,
) -> AsyncIterator[Rig]:
    """Run simulated drones.

    Args:
        drones: How many.
        pictures: What their cameras see, over and over; None for two of no meaning.
        each: Every picture is sent so many times.
        dynamics: How they fly and how full they are.
        lost: Whether the video datagram with this number gets lost.
        sdk: Which protocol they speak.
        friendly_reads: Whether they answer reads with bare whole numbers.
        station: Whether they have joined a network.
    """
    config = SimConfig(
        drones=drones,
        base_address=f"{some_block()}.1",
        dynamics=dynamics if dynamics is not None else DynamicsConfig(),
        sdk=sdk,
        friendly_reads=friendly_reads,
        station=station,
    )
    made = Rig([], fleet_config(config))
    async with contextlib.AsyncExitStack() as stack:
        for index in range(drones):
            drone = await stack.enter_async_context(SimulatedDrone(config, index))
            _listen_in(drone, made.heard)
            made.drones.append(drone)
            seen = still_pictures() if pictures is None else pictures
            task = asyncio.create_task(_film(drone, seen, each, lost))
            stack.push_async_callback(_end, task)
        yield made


def _listen_in(drone: SimulatedDrone, heard: list[str]) -> None:
    receive = drone.tello.receive

    def recording(datagram: bytes, *rest: object) -> object:
        heard.append(datagram.decode("ascii", "replace"))
        return receive(datagram, *rest)  # pyright: ignore[reportArgumentType]

    drone.tello.receive = recording  # pyright: ignore[reportAttributeAccessIssue]


async def _film(
    drone: SimulatedDrone,
    pictures: Sequence[NDArray[np.uint8]],
    each: int,
    lost: Callable[[int], bool],
) -> None:
    encoder = VideoEncoder(960, 720, FPS, 4000)
    numbers = itertools.count()
    rng = np.random.default_rng(0)
    for image in itertools.cycle([image for image in pictures for _ in range(each)]):
        while not drone.wants_pictures:  # noqa: ASYNC110 - The truth raises no events.
            await asyncio.sleep(0.02)
        datagrams = await asyncio.to_thread(encoder.encode, _noisy(image, rng), time.monotonic())
        drone.send_video([piece for piece in datagrams if not lost(next(numbers))])
        await asyncio.sleep(1.0 / FPS)


def _noisy(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the picture as no camera gives it twice; datagrams alike would pass for copies."""
    noise = rng.integers(-2, 3, image.shape, dtype=np.int16)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


async def _end(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
