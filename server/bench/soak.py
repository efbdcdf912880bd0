"""``dronerf bench soak``: an hour of missions back to back by one console, in virtual time.

Driver, safety, pilot, mission, planner and store are those that fly real drones and stay up from
the first mission to the last; drones, network and pictures are simulated, and the clock runs as
fast as it can. After each mission the batteries are changed and the process is looked at:
resident memory, open descriptors, tasks of the event loop and objects that the collector follows.

What a process needs while it warms up is no leak: growth counts from the fourth mission on.
"""

from __future__ import annotations

import asyncio
import ctypes
import gc
import os
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from server.bench.missions.cases import Case
from server.bench.missions.virtual_flight import VirtualFlight
from server.bench.options import Figures, Options, each_scene
from server.mission.commands import CaptureRequest
from server.mission.control import Control
from server.sim.virtual_time import in_virtual_time

SCENES = QUICK_SCENES = ("robot_dog",)

_FLOWN_S, _QUICK_FLOWN_S = 3600.0, 900.0
_PICTURES = 8
_WARM_UP = 3
_PAUSE_S = 5.0
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True)
class _Reading:
    """The process after a mission."""

    at_s: float
    memory_mb: float
    descriptors: int
    tasks: int
    objects: int


def run(options: Options) -> Figures:
    """Fly the scenes that are asked for, each for an hour."""
    flown_s = _QUICK_FLOWN_S if options.quick else _FLOWN_S
    scenes = each_scene("soak", options, lambda scene: measure(scene, options.seed, flown_s))
    first = next(iter(scenes.values()))
    overall = {key: first[key] for key in first if key != "readings"}
    return Figures(scenes, overall)


def measure(scene: str, seed: int, flown_s: float) -> dict[str, Any]:
    """Return the figures of so long a time on the drones' clock."""
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="dronerf-soak-") as runs:
        states, readings = in_virtual_time(_fly_on(scene, seed, flown_s, Path(runs)))
    warm = readings[_WARM_UP:] or readings
    at_h = np.array([reading.at_s for reading in warm]) / 3600.0
    memory_mb = np.array([reading.memory_mb for reading in warm])
    slope = np.polyfit(at_h, memory_mb, 1)[0] if len(warm) > 1 else 0.0
    return {
        "missions": len(states),
        "succeeded": states.count("succeeded"),
        "flown_s": round(readings[-1].at_s, 1),
        "memory_mb_first": round(warm[0].memory_mb, 1),
        "memory_mb_last": round(warm[-1].memory_mb, 1),
        "memory_mb_per_h": round(float(slope), 2),
        "descriptors_first": warm[0].descriptors,
        "descriptors_last": warm[-1].descriptors,
        "tasks_first": warm[0].tasks,
        "tasks_last": warm[-1].tasks,
        "objects_first": warm[0].objects,
        "objects_last": warm[-1].objects,
        "readings": [asdict(reading) for reading in readings],
        "wall_s": round(time.monotonic() - begun_s, 1),
    }


async def _fly_on(
    scene: str, seed: int, flown_s: float, runs: Path
) -> tuple[list[str], list[_Reading]]:
    case = Case(scene, seed, 0.0, "", "", pictures=_PICTURES)
    flight = VirtualFlight(case, runs)
    loop, states, readings = asyncio.get_running_loop(), list[str](), list[_Reading]()
    async with flight.opened() as (control, _):
        begun_s = loop.time()
        while loop.time() - begun_s < flown_s:
            states.append(await _fly_one(control, seed + len(states)))
            await asyncio.sleep(_PAUSE_S)
            for tello in flight.tellos.values():
                tello.airframe.battery_pct = 100.0
            readings.append(_reading(loop.time() - begun_s))
    return states, readings


async def _fly_one(control: Control, seed: int) -> str:
    request = CaptureRequest(pictures=_PICTURES, train_seconds=0.0, seed=seed, name=f"soak {seed}")
    record = await control.start_capture(request)
    record = await control.wait_for_capture(record.status.id)
    return record.status.state


def _reading(at_s: float) -> _Reading:
    gc.collect()
    # What the allocator only keeps for later is no memory in use; the planner, in flight a process
    # of its own and here a part of this one, leaves it 100 MB.
    ctypes.CDLL(None).malloc_trim(0)
    resident = int(Path("/proc/self/statm").read_text().split()[1])
    return _Reading(
        at_s=round(at_s, 1),
        memory_mb=round(resident * _PAGE / 2**20, 2),
        descriptors=len(os.listdir("/proc/self/fd")),
        tasks=len(asyncio.all_tasks()),
        objects=len(gc.get_objects()),
    )
