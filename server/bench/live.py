"""``dronerf bench live``: how soon the field is there while drones still fly, and after them.

Every scene is flown once in real time, over UDP, with the simulator on the same machine; the field
trains beside it as in every capture (``beside_simulator``). Then the simulator is gone, and the
flight's pictures are laid into a fresh run folder when they were taken in flight, in real time,
with the poses and masks believed then: the same worker follows them (``played``).

``first_preview_s`` counts from the fourth picture to the first preview of the field.
``psnr_90_s`` counts from the last picture until held-out pictures, small, are shown with 90 % of
the PSNR in dB they have at the training's end, ``train_end_psnr_db``; ``landing_s`` of them passed
until refinement began, ``refine_s`` with it.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from server.app import SimulatedFleet, flying, simulated_fleet
from server.bench.options import Figures, Options, each_scene
from server.jobs.local import LocalRunner
from server.jobs.spec import EVENTS, JobSpec
from server.mission.commands import CaptureRequest
from server.mission.events import CaptureChanged, Subscription
from server.mission.phases import Phase
from server.nerf.dataset import load_dataset
from server.nerf.flight import FlightPicture, append_picture, read_pictures
from server.settings import load_settings
from server.store.runs import RunFolder

QUICK_SCENES = ("robot_dog",)
_PICTURES, _FIRST = 24, 4
_TRAIN_S = 60.0
_FLIGHT_AND_TRAINING_S = 900.0
_SHARE = 0.9
_EVENTS = Path("jobs", "reconstruct", EVENTS)


def run(options: Options) -> Figures:
    """Measure every scene; ``overall`` has the means."""
    scenes = each_scene("live", options, lambda scene: _measure(scene, options.seed))
    parts = list(scenes.values())
    overall = {
        way: {
            name: round(float(np.mean([part[way][name] for part in parts])), 2)
            for name in parts[0][way]
        }
        for way in ("beside_simulator", "played")
    }
    return Figures(scenes, overall)


def _measure(scene: str, seed: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="dronerf-live-") as name:
        folder = Path(name)
        flown, kept, landing_s = asyncio.run(_fly(scene, seed, folder))
        played = asyncio.run(_play(kept, folder / "played", seed, _ahead_s(flown), landing_s))
        return {"beside_simulator": live_figures(flown), "played": live_figures(played)}


async def _fly(scene: str, seed: int, folder: Path) -> tuple[Path, Path, float]:
    """Fly and train; return the run, a copy made when the flight ended, and what landing took."""
    settings = load_settings(runs=folder / "runs")
    request = CaptureRequest(pictures=_PICTURES, train_seconds=_TRAIN_S, seed=seed)
    async with AsyncExitStack() as stack:
        simulator = await stack.enter_async_context(simulated_fleet(SimulatedFleet(scene)))
        control, _ = await stack.enter_async_context(flying(settings, simulator.fleet))
        news = stack.enter_context(control.events.subscribe(1024))
        record = await control.start_capture(request)
        async with asyncio.timeout(_FLIGHT_AND_TRAINING_S):
            await _until_training(news)
            landed_s = time.monotonic()
            run = Path(record.status.run)
            # What follows changes poses and masks, the first of it after half a minute.
            kept = await asyncio.to_thread(shutil.copytree, run, folder / "kept")
            record = await control.wait_for_capture(record.status.id)
        if record.status.state != "succeeded":
            raise RuntimeError(f"{scene}: the capture {record.status.state}: {record.status.error}")
    return run, kept, landed_s - read_pictures(kept)[-1].at_s


async def _until_training(news: Subscription) -> None:
    async for event in news:
        if isinstance(event, CaptureChanged):
            if event.phase == Phase.TRAIN:
                return
            if event.error is not None:
                raise RuntimeError(f"the capture {event.state}: {event.error}")


def _ahead_s(run: Path) -> float:
    """Return how long before its first picture a flight's worker was started."""
    of_day_s = time.time() - time.monotonic()
    started_s = (run / _EVENTS).with_name("spec.json").stat().st_mtime
    return read_pictures(run)[0].at_s + of_day_s - started_s


async def _play(kept: Path, root: Path, seed: int, ahead_s: float, landing_s: float) -> Path:
    """Lay the pictures of a flight into a new run as they came; return it when trained.

    Args:
        kept: The flight's run when it had landed.
        root: Where the new run goes.
        seed: Of the training.
        ahead_s: How long before the first picture the worker starts.
        landing_s: How long after the last picture the flight is over.
    """
    run = RunFolder.create(root, "played")
    run.write_state({"complete": False})
    pictures = read_pictures(kept)
    dataset = load_dataset(kept, downscale=1)
    parameters = {
        "source": "flight", "dataset": str(run.path), "train_seconds": _TRAIN_S, "mode": "optimized"
    }  # fmt: skip
    spec = JobSpec("reconstruct", parameters, seed=seed, threads=os.cpu_count() or 1)
    job = await LocalRunner().submit(spec, run.path / "jobs" / "reconstruct")
    telling = asyncio.create_task(_heard(job.events()))
    try:
        zero_s = time.monotonic() + ahead_s - pictures[0].at_s
        for picture in pictures:
            await asyncio.sleep(zero_s + picture.at_s - time.monotonic())
            _lay(kept, run, replace(picture, at_s=zero_s + picture.at_s))
            if picture.still:
                run.write_transforms(dataset.intrinsics[0], dataset.object_box)
        await asyncio.sleep(landing_s)
        run.write_state({"complete": True})
        await telling
    finally:
        telling.cancel()
        await job.cancel()
    return run.path


def _lay(kept: Path, run: RunFolder, picture: FlightPicture) -> None:
    for file in (picture.file, picture.mask):
        if file is not None:
            shutil.copy(kept / file, run.path / file)
    append_picture(run.path, picture)


async def _heard(events: AsyncIterator[dict[str, Any]]) -> None:
    async for _ in events:
        pass


def live_figures(run: Path) -> dict[str, float]:
    """Return the figures of a run that was trained beside its flight, on this machine.

    Raises:
        RuntimeError: If its worker told too little.
    """
    # Pictures go by the machine's clock since its start, a worker's news by the time of day.
    of_day_s = time.time() - time.monotonic()
    stills = [picture.at_s + of_day_s for picture in read_pictures(run) if picture.still]
    told = [json.loads(line) for line in (run / _EVENTS).read_text().splitlines()]
    shown = [event["at_s"] for event in told if event["event"] == "preview"]
    steps = [event for event in told if event["event"] == "progressed"]
    scored = [
        (event["at_s"], event["held_out_psnr_db"])
        for event in steps
        if event["stage"] == "train" and event["held_out_psnr_db"] is not None
    ]
    refined = [event["at_s"] for event in told if event["event"] == "refined"]
    if not (shown and scored and refined):
        raise RuntimeError(f"{run.name}: the worker told too little to judge it by")
    final_db = scored[-1][1]
    reached_s = next(at_s for at_s, psnr_db in scored if psnr_db >= _SHARE * final_db)
    begun = [event["at_s"] for event in steps if event["stage"] == "refine"]
    return {
        "first_preview_s": round(min(shown) - stills[_FIRST - 1], 2),
        "psnr_90_s": round(reached_s - stills[-1], 2),
        "refine_s": round(refined[0] - begun[0], 2),
        "train_end_psnr_db": final_db,
        "landing_s": round(begun[0] - stills[-1], 2),
    }
