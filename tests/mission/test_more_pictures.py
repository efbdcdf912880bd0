"""More pictures than were asked for, wanted while the capture flies; in virtual time."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_console import REQUEST, in_phase, tell

from server.bench.missions.virtual_flight import VirtualFlight
from server.mission.commands import RefusedError
from server.mission.control import Control
from server.mission.events import CaptureTaken, EventStream, Noted, PlanFound
from server.swarm.fleet import Fleet

pytestmark = pytest.mark.slow

News = PlanFound | CaptureTaken | Noted


async def listen(events: EventStream, news: list[News]) -> None:
    with events.subscribe(4096) as subscription:
        news.extend([event async for event in subscription if isinstance(event, News)])


def test_pictures_wanted_in_the_last_round_are_planned_beside_those_taken(tmp_path: Path) -> None:
    news: list[News] = []

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        listening = asyncio.create_task(listen(control.events, news))
        record = await control.start_capture(replace(REQUEST, pictures=4))
        await in_phase(control, "tune")
        told = await control.add_pictures(record.status.id, 4)
        assert told.status.images_total == 8
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "succeeded"
        assert record.status.images == 8
        with pytest.raises(RefusedError, match="not running"):
            await control.add_pictures(record.status.id, 4)
        listening.cancel()

    tell(story, tmp_path)
    _, later = (event for event in news if isinstance(event, PlanFound))
    taken = [event.capture.pose for event in news if isinstance(event, CaptureTaken)]
    assert len(later.placement.viewpoints) == 4
    # None goes where a picture was taken already.
    for view in later.placement.viewpoints:
        apart_m = [np.linalg.norm(view.position_world - p.position_world) for p in taken[:4]]
        assert min(apart_m) > 0.3
    lines = [event.text for event in news if isinstance(event, Noted) and event.level == "info"]
    assert "4 pictures more are wanted, 8 in all." in lines
    assert lines.index("Round 1 of 2: 4 of 8 pictures.") < lines.index("Landing.")


def test_what_cannot_be_had_is_refused(tmp_path: Path) -> None:
    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        ring = await control.start_capture(replace(REQUEST, mode="standard"))
        with pytest.raises(RefusedError, match="standard ring"):
            await control.add_pictures(ring.status.id, 4)
        await control.abort_capture(ring.status.id)
        await control.wait_for_capture(ring.status.id)
        record = await control.start_capture(REQUEST)
        with pytest.raises(RefusedError, match="at most 400"):
            await control.add_pictures(record.status.id, 393)
        await in_phase(control, "land")
        with pytest.raises(RefusedError, match="way down"):
            await control.add_pictures(record.status.id, 4)
        assert control.capture(record.status.id).status.images_total == 8

    tell(story, tmp_path)
