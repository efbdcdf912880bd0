"""Four drones that hover, with video, before a console that runs as its own process.

The drones are simulated in this process, which also knows when each is told to stop.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from server.app import free_loopback_block
from server.bench.console_process import (
    ServedConsole,
    command,
    served_console,
    until_activity,
)
from server.geometry.cameras import TELLO_INTRINSICS
from server.sim.config import DynamicsConfig, SimConfig
from server.sim.drone import SimulatedDrone
from server.sim.encoder import VideoEncoder
from server.sim.tello import Outgoing, Sender, Tello

_FPS = 10.0
_BITRATE_KBIT_S = 4000
_LATEST_S = 5.0
_FLIGHT_S = 7200.0
# The drones hover before pictures of no object: not seeing it must not land them here.
_WITHOUT_OBJECT = "[safety.failsafes]\nobject_age_s = {}\npose_sigma_m = {}\n"


class HoldHearing(Tello):
    """A drone that notes when it is told to stop."""

    def __init__(self, config: SimConfig, index: int) -> None:
        super().__init__(config, index)
        self.stopped_s = -math.inf

    def receive(self, datagram: bytes, sender: Sender, now_s: float) -> list[Outgoing]:
        """Take one datagram."""
        if datagram == b"stop":
            self.stopped_s = max(self.stopped_s, time.monotonic())
        return super().receive(datagram, sender, now_s)


@dataclass(frozen=True, slots=True)
class HoveringFleet:
    """What hovers, and who looks after it.

    Attributes:
        console: The console.
        tellos: The drones.
    """

    console: ServedConsole
    tellos: list[HoldHearing]

    async def press_hold(self) -> float:
        """Press HOLD, wait for the last drone to hear of it, re-arm; returns milliseconds."""
        client = self.console.client
        pressed_s = time.monotonic()
        await client.post("/api/v1/fleet/hold")
        while min(tello.stopped_s for tello in self.tellos) < pressed_s:
            if time.monotonic() - pressed_s > _LATEST_S:
                return math.inf
            await asyncio.sleep(0.001)
        # The first ``stop`` of each burst counts, so it is looked for before the repeats are over.
        heard_s = max(tello.stopped_s for tello in self.tellos)
        await asyncio.sleep(0.5)
        for tello in self.tellos:
            await command(client, tello.drone_id, "rearm")
        await asyncio.sleep(0.05)
        return 1000.0 * (heard_s - pressed_s)


# Draws the picture of a number, BGR; called when it is about to be coded and sent.
Painter = Callable[[int], NDArray[np.uint8]]


@asynccontextmanager
async def hovering_fleet(
    folder: Path, paint: Painter | None = None, fps: float = _FPS
) -> AsyncIterator[HoveringFleet]:
    """Have four drones hover; they land at the end. Files go to ``folder``, runs to ``runs`` in it.

    Their batteries last longer than real ones. All send the same pictures, ``fps`` a second: those
    of ``paint``, or of a blob that moves over a floor.
    """
    config = SimConfig(
        base_address=free_loopback_block(4), dynamics=DynamicsConfig(flight_time_s=_FLIGHT_S)
    )
    tellos = [HoldHearing(config, index) for index in range(config.drones)]
    async with AsyncExitStack() as stack:
        drones = [SimulatedDrone(config, index) for index in range(config.drones)]
        for drone, tello in zip(drones, tellos, strict=True):
            drone.tello = tello
            await stack.enter_async_context(drone)
        console = await stack.enter_async_context(served_console(config, folder, _WITHOUT_OBJECT))
        await until_activity(console.client, "ground", len(drones))
        video = asyncio.create_task(_stream(drones, paint or blob_on_floor(), fps))
        stack.callback(video.cancel)
        for drone in drones:
            await command(console.client, drone.drone_id, "takeoff")
        await until_activity(console.client, "flying", len(drones))
        try:
            yield HoveringFleet(console, tellos)
        finally:
            await console.client.post("/api/v1/fleet/land")


def blob_on_floor() -> Painter:
    """Return the painter of a blob that moves over a floor."""
    camera = TELLO_INTRINSICS
    noise = np.random.default_rng(0).integers(0, 255, (camera.height, camera.width, 3), np.uint8)
    floor = np.asarray(cv2.GaussianBlur(noise, (0, 0), 6.0), np.uint8)

    def paint(count: int) -> NDArray[np.uint8]:
        picture = floor.copy()
        cv2.circle(picture, (480 + round(200 * math.sin(0.1 * count)), 380), 130, (40, 40, 220), -1)
        return picture

    return paint


async def _stream(drones: list[SimulatedDrone], paint: Painter, fps: float) -> None:
    """Send every drone the same video."""
    encoder = VideoEncoder(TELLO_INTRINSICS.width, TELLO_INTRINSICS.height, fps, _BITRATE_KBIT_S)
    begun_s, count = time.monotonic(), 0
    while True:
        coded = await asyncio.to_thread(
            lambda number: encoder.encode(paint(number), number / fps), count
        )
        for drone in drones:
            if drone.wants_pictures:
                drone.send_video(coded)
        count += 1
        await asyncio.sleep(max(0.0, begun_s + count / fps - time.monotonic()))


def hold_figures(took_ms: Sequence[float]) -> dict[str, Any]:
    """Return percentiles in milliseconds; a press that never arrived is infinite."""
    return {
        "presses": len(took_ms),
        "never_arrived": sum(math.isinf(ms) for ms in took_ms),
        **percentiles([ms for ms in took_ms if math.isfinite(ms)]),
    }


def percentiles(took_ms: Sequence[float]) -> dict[str, float | None]:
    """Return median, 95th and 99th percentile and maximum, rounded; all None of nothing."""
    if not took_ms:
        return dict.fromkeys(("p50", "p95", "p99", "max"))
    found = np.percentile(took_ms, (50.0, 95.0, 99.0, 100.0))
    return {
        name: round(float(ms), 1)
        for name, ms in zip(("p50", "p95", "p99", "max"), found, strict=True)
    }
