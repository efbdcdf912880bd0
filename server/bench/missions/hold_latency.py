"""How long HOLD takes from the press to the drones, while planner and trainer use all cores.

A console runs as its own process with four drones that this process simulates, video included. The
press is the REST call of the dashboard's button; the time is taken when the last of the four drones
has the ``stop`` that only a stop sends. Scheduling and loopback at both ends count.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np

from server.app import free_loopback_block
from server.bench.console_process import command, served_console, until_activity
from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import look_at
from server.jobs.local import LocalRunner
from server.jobs.spec import JobSpec
from server.nerf.dataset import PosedFile, write_transforms
from server.sim.config import SimConfig
from server.sim.drone import SimulatedDrone
from server.sim.encoder import VideoEncoder
from server.sim.tello import Outgoing, Sender, Tello

_FPS = 10.0
_LATEST_S = 5.0
# The drones hover before pictures of no object: not seeing it must not land them here.
_WITHOUT_OBJECT = "[safety.failsafes]\nobject_age_s = {}\npose_sigma_m = {}\n"


class _HoldHearing(Tello):
    """A drone that notes when it is told to stop."""

    def __init__(self, config: SimConfig, index: int) -> None:
        super().__init__(config, index)
        self.stopped_s = -math.inf

    def receive(self, datagram: bytes, sender: Sender, now_s: float) -> list[Outgoing]:
        """Take one datagram."""
        if datagram == b"stop":
            self.stopped_s = max(self.stopped_s, time.monotonic())
        return super().receive(datagram, sender, now_s)


def measure_hold(presses: int) -> dict[str, Any]:
    """Return figures over ``presses``: percentiles in milliseconds, and what else was running."""
    with tempfile.TemporaryDirectory(prefix="dronerf-hold-") as folder:
        return asyncio.run(_measure(presses, Path(folder)))


async def _measure(presses: int, folder: Path) -> dict[str, Any]:
    config = SimConfig(base_address=free_loopback_block(4))
    tellos = [_HoldHearing(config, index) for index in range(config.drones)]
    async with AsyncExitStack() as stack:
        drones = [SimulatedDrone(config, index) for index in range(config.drones)]
        for drone, tello in zip(drones, tellos, strict=True):
            drone.tello = tello
            await stack.enter_async_context(drone)
        served = served_console(config, folder, _WITHOUT_OBJECT)
        client = (await stack.enter_async_context(served)).client
        await until_activity(client, "ground", len(drones))
        video = asyncio.create_task(_stream(drones))
        stack.callback(video.cancel)
        for drone in drones:
            await command(client, drone.drone_id, "takeoff")
        await until_activity(client, "flying", len(drones))
        await stack.enter_async_context(_load(folder))
        took_ms = [await _press(client, tellos) for _ in range(presses)]
        load = os.getloadavg()[0]
        await client.post("/api/v1/fleet/land")
    late = sum(math.isinf(ms) for ms in took_ms)
    arrived = [ms for ms in took_ms if math.isfinite(ms)]
    return {
        "presses": presses,
        "never_arrived": late,
        "p50": round(float(np.percentile(arrived, 50)), 1),
        "p99": round(float(np.percentile(arrived, 99)), 1),
        "max": round(max(arrived), 1),
        "load_1min": round(load, 1),
    }


async def _press(client: httpx.AsyncClient, tellos: list[_HoldHearing]) -> float:
    """Press HOLD, wait for the last drone to hear of it, re-arm; returns milliseconds."""
    pressed_s = time.monotonic()
    await client.post("/api/v1/fleet/hold")
    while min(tello.stopped_s for tello in tellos) < pressed_s:
        if time.monotonic() - pressed_s > _LATEST_S:
            return math.inf
        await asyncio.sleep(0.001)
    # The first ``stop`` of each burst counts, so it is looked for before the repeats are over.
    heard_s = max(tello.stopped_s for tello in tellos)
    await asyncio.sleep(0.5)
    for tello in tellos:
        await command(client, tello.drone_id, "rearm")
    await asyncio.sleep(0.05)
    return 1000.0 * (heard_s - pressed_s)


async def _stream(drones: list[SimulatedDrone]) -> None:
    """Send every drone the same video: a blob that moves over a floor."""
    camera = TELLO_INTRINSICS
    encoder = VideoEncoder(camera.width, camera.height, _FPS, 4000)
    noise = np.random.default_rng(0).integers(0, 255, (camera.height, camera.width, 3), np.uint8)
    floor = cv2.GaussianBlur(noise, (0, 0), 6.0)
    begun_s, count = time.monotonic(), 0
    while True:
        picture = floor.copy()
        cv2.circle(picture, (480 + round(200 * math.sin(0.1 * count)), 380), 130, (40, 40, 220), -1)
        image = np.asarray(picture, np.uint8)
        coded = await asyncio.to_thread(encoder.encode, image, count / _FPS)
        for drone in drones:
            if drone.wants_pictures:
                drone.send_video(coded)
        count += 1
        await asyncio.sleep(max(0.0, begun_s + count / _FPS - time.monotonic()))


@asynccontextmanager
async def _load(folder: Path) -> AsyncIterator[None]:
    """Keep a planner and a trainer busy, as niced as in flight."""
    threads = os.cpu_count() or 1
    dataset = _noise_dataset(folder / "dataset")
    training = JobSpec(
        "reconstruct",
        {
            "source": "dataset",
            "dataset": str(dataset),
            "out": str(folder / "field"),
            "train_seconds": 3600.0,
            "steps": None,
            "downscale": None,
            "test_every": 8,
            "backend": "numba",
        },
        threads=threads,
    )
    trainer = await LocalRunner().submit(training, folder / "trainer")
    planning = asyncio.create_task(_plan_on_and_on(folder))
    watching = asyncio.create_task(_drain(trainer.events()))
    await asyncio.sleep(15.0)  # Until both have compiled their kernels and are at it.
    try:
        yield
    finally:
        planning.cancel()
        await asyncio.gather(planning, return_exceptions=True)
        await trainer.cancel()
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)


async def _plan_on_and_on(folder: Path) -> None:
    """Plan again and again: a planner is over in seconds."""
    parameters = {
        "outer": ([-0.4, -0.3, 0.0], [0.4, 0.3, 1.0]),
        "boxes": [([-0.4, -0.3, 0.0], [0.4, 0.3, 1.0])],
        "views": 4,
        "intrinsics": json.loads(json.dumps(_intrinsics())),
        "tilt_rad": 0.21,
        "drones": {f"drone-{n}": (2.0, float(n), 1.0, 3.14) for n in range(4)},
        "rounds": 6,
        "config": {},
    }
    job = None
    try:
        while True:
            job = await LocalRunner().submit(JobSpec("plan", parameters), folder / "planner")
            await _drain(job.events())
    finally:
        if job is not None:
            await job.cancel()


def _intrinsics() -> dict[str, Any]:
    camera = TELLO_INTRINSICS
    return {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")} | {
        "distortion": list(camera.distortion)
    }


async def _drain(events: AsyncIterator[dict[str, Any]]) -> None:
    async for _ in events:
        pass


def _noise_dataset(folder: Path) -> Path:
    """Write twelve posed pictures of nothing: training on them takes as long as on any others."""
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(0)
    files = []
    for number in range(12):
        angle = 2.0 * math.pi * number / 12
        place = np.array([2.0 * math.cos(angle), 2.0 * math.sin(angle), 1.0])
        name = f"images/{number:04d}.jpg"
        small = rng.integers(0, 255, (90, 120, 3), np.uint8)
        picture = cv2.resize(small, (TELLO_INTRINSICS.width, TELLO_INTRINSICS.height))
        cv2.imwrite(str(folder / name), picture)
        files.append(PosedFile(name, look_at(place, np.array([0.0, 0.0, 0.4])), None))
    write_transforms(folder, files, TELLO_INTRINSICS, None)
    return folder
