"""A console with four simulated drones in virtual time, and stories told on it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

from server.bench.missions.cases import Case
from server.bench.missions.virtual_flight import VirtualFlight
from server.mission.commands import CaptureRecord, CaptureRequest
from server.mission.control import Control
from server.sim.virtual_time import in_virtual_time
from server.swarm.fleet import Fleet

CASE = Case("robot_dog", 5, 0.0, "", "", pictures=8)
REQUEST = CaptureRequest(pictures=8, train_seconds=0.0, seed=5)

Story = Callable[[VirtualFlight, Control, Fleet], Awaitable[None]]


def tell(story: Story, runs: Path) -> None:
    async def told() -> None:
        flight = VirtualFlight(CASE, runs)
        async with flight.opened() as (control, fleet):
            await story(flight, control, fleet)

    in_virtual_time(told())


async def until(holds: Callable[[], bool], patience_s: float = 120.0) -> None:
    async with asyncio.timeout(patience_s):
        while not holds():  # noqa: ASYNC110 - Virtual time, and the truth raises no events.
            await asyncio.sleep(0.02)


async def in_phase(control: Control, phase: str) -> CaptureRecord:
    await until(lambda: control.captures()[0].status.phase == phase)
    return control.captures()[0]
