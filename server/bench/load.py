"""``dronerf bench load``: many watch a flight, the library is full, and somebody presses HOLD.

The console runs as its own process with four drones that hover, video included, and with a thousand
captures in its library. Fifty viewers, in a process of their own, take its events and every picture
that they can show. Meanwhile HOLD is pressed again and again (from the press until the last drone
has heard of it), and the first page of the library is asked for. Memory and descriptors are read
before the viewers come and after they have gone.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import AsyncExitStack
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from server.bench.console_process import ServedConsole
from server.bench.hovering_fleet import (
    HoveringFleet,
    hold_figures,
    hovering_fleet,
    percentiles,
)
from server.bench.options import Figures, Options, each_scene
from server.bench.viewer import Viewer
from server.mission.commands import CaptureRequest
from server.mission.events import CaptureChanged
from server.store.runs import RunFolder

# Nothing is rendered: the scene's name only stands for the one part that there is.
SCENES = QUICK_SCENES = ("robot_dog",)

_VIEWERS = 50
_CAPTURES = 1000
_SECONDS, _QUICK_SECONDS = 600.0, 60.0
# One press every so often: each holds the drones, and somebody has to re-arm them.
_PRESS_S, _LIST_S = 2.0, 0.5
_SETTLE_S = 5.0


def run(options: Options) -> Figures:
    """Measure once."""
    seconds = _QUICK_SECONDS if options.quick else _SECONDS
    whole = replace(options, scenes=("viewers",))
    figures = each_scene("load", whole, lambda _: measure(_VIEWERS, _CAPTURES, seconds))["viewers"]
    return Figures(scenes={}, overall=figures)


def measure(viewers: int, captures: int, seconds: float) -> dict[str, Any]:
    """Return the figures of ``seconds`` with so many viewers and so many captures."""
    with tempfile.TemporaryDirectory(prefix="dronerf-load-") as folder:
        fill_library(Path(folder) / "runs", captures)
        return asyncio.run(_measure(viewers, captures, seconds, Path(folder)))


def fill_library(runs: Path, captures: int) -> None:
    """Make run folders of so many captures that are over, as a console leaves them."""
    begun = datetime.now(UTC) - timedelta(days=captures)
    for number in range(captures):
        at = begun + timedelta(days=number)
        run = RunFolder.create(runs, f"capture {number}")
        request = CaptureRequest(name=f"capture {number}", seed=number)
        status = CaptureChanged(
            id=run.id,
            state="succeeded",
            phase="done",
            progress=1.0,
            eta_s=0.0,
            run=str(run.path),
            error=None,
            mode=request.mode,
            round_index=5,
            rounds=6,
            images=request.pictures,
            images_total=request.pictures,
        )
        run.write_state(
            {
                "id": run.id,
                "request": asdict(request),
                "started_at": at.isoformat(),
                "complete": True,
                "status": asdict(status) | {"at": at.isoformat()},
            }
        )
        (run.path / "metrics.json").write_text(json.dumps({"psnr_db": 25.0, "ssim": 0.9}))


async def _measure(viewers: int, captures: int, seconds: float, folder: Path) -> dict[str, Any]:
    async with AsyncExitStack() as stack:
        fleet = await stack.enter_async_context(hovering_fleet(folder))
        console = fleet.console
        await asyncio.sleep(_SETTLE_S)
        before, begun_s = await _readings(console), time.monotonic()
        spawn = multiprocessing.get_context("spawn")
        pool = stack.enter_context(ProcessPoolExecutor(1, mp_context=spawn))
        watching = asyncio.get_running_loop().run_in_executor(
            pool, watch, console.address, console.headers, viewers, seconds
        )
        async with asyncio.TaskGroup() as tasks:
            pressing = tasks.create_task(_press_on(fleet, seconds))
            listing = tasks.create_task(_list_on(console.client, seconds))
        hold_ms, list_ms = pressing.result(), listing.result()
        seen = await watching
        elapsed_s = time.monotonic() - begun_s
        load = os.getloadavg()[0]
        await asyncio.sleep(_SETTLE_S)
        after = await _readings(console)
    spent_s = after["process_cpu_seconds_total"] - before["process_cpu_seconds_total"]
    return {
        "viewers": viewers,
        "captures": captures,
        "seconds": round(elapsed_s, 1),
        "hold_ms": hold_figures(hold_ms),
        "list_ms": percentiles(list_ms),
        **_viewing_figures(seen, seconds),
        "cpu_cores": round(spent_s / elapsed_s, 2),
        "memory_mb": [round(r["process_resident_memory_bytes"] / 1e6) for r in (before, after)],
        "descriptors": [round(r["process_open_fds"]) for r in (before, after)],
        "load_1min": round(load, 1),
    }


def _viewing_figures(seen: Sequence[dict[str, float]], seconds: float) -> dict[str, Any]:
    tiles = np.array([viewer["tiles"] for viewer in seen])
    return {
        "viewers_lost": sum(not viewer["connected"] for viewer in seen),
        "tiles_per_s_min": round(float(tiles.min()) / seconds, 2),
        "tiles_per_s_mean": round(float(tiles.mean()) / seconds, 2),
        "longest_gap_s": round(max(viewer["longest_gap_s"] for viewer in seen), 2),
        "messages_per_viewer": round(float(np.mean([viewer["messages"] for viewer in seen]))),
        "messages_missed": int(sum(viewer["missed"] for viewer in seen)),
    }


def watch(
    address: str, headers: dict[str, str], viewers: int, seconds: float
) -> list[dict[str, float]]:
    """Watch with so many viewers, in a process of its own; returns what each saw."""
    return asyncio.run(_watch(address, headers, viewers, seconds))


async def _watch(
    address: str, headers: dict[str, str], viewers: int, seconds: float
) -> list[dict[str, float]]:
    async with AsyncExitStack() as stack:
        watchers = [
            await stack.enter_async_context(Viewer(address, headers)) for _ in range(viewers)
        ]
        for viewer in watchers:
            viewer.begin_anew()
        await asyncio.sleep(seconds)
        return [
            {
                "tiles": viewer.tiles,
                "longest_gap_s": viewer.longest_gap_s,
                "messages": viewer.messages,
                "missed": viewer.missed,
                "connected": viewer.connected,
            }
            for viewer in watchers
        ]


async def _press_on(fleet: HoveringFleet, seconds: float) -> list[float]:
    took_ms: list[float] = []
    due_s = time.monotonic()
    until_s = due_s + seconds
    while time.monotonic() < until_s:
        took_ms.append(await fleet.press_hold())
        due_s += _PRESS_S
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))
    return took_ms


async def _list_on(client: httpx.AsyncClient, seconds: float) -> list[float]:
    took_ms: list[float] = []
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        begun_s = time.perf_counter()
        answer = await client.get("/api/v1/captures")
        answer.raise_for_status()
        took_ms.append(1e3 * (time.perf_counter() - begun_s))
        await asyncio.sleep(_LIST_S)
    return took_ms


async def _readings(console: ServedConsole) -> dict[str, float]:
    answer = await console.client.get("/metrics")
    answer.raise_for_status()
    series = (line.rsplit(" ", 1) for line in answer.text.splitlines() if line[0] != "#")
    return {name: float(value) for name, value in series}
