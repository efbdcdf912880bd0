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
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from server.bench.hovering_fleet import hold_figures, hovering_fleet
from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import look_at
from server.jobs.local import LocalRunner
from server.jobs.spec import JobSpec
from server.nerf.dataset import PosedFile, write_transforms


def measure_hold(presses: int) -> dict[str, Any]:
    """Return figures over ``presses``: percentiles in milliseconds, and what else was running."""
    with tempfile.TemporaryDirectory(prefix="dronerf-hold-") as folder:
        return asyncio.run(_measure(presses, Path(folder)))


async def _measure(presses: int, folder: Path) -> dict[str, Any]:
    async with hovering_fleet(folder) as fleet, _load(folder):
        took_ms = [await fleet.press_hold() for _ in range(presses)]
        load = os.getloadavg()[0]
    return hold_figures(took_ms) | {"load_1min": round(load, 1)}


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
