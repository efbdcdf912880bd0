"""Plans made anew while the capture flies, for more pictures or for what is known by then."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_console import REQUEST, in_phase, tell

from server.bench.missions import virtual_flight
from server.bench.missions.inline_jobs import InlineRunner
from server.bench.missions.virtual_flight import VirtualFlight
from server.jobs.plan import KnownPlaces
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec
from server.mission.commands import RefusedError
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import CaptureTaken, EventStream, Noted, PlanFound
from server.mission.planning import Planning
from server.planner.config import PlannerConfig
from server.swarm.fleet import Fleet

pytestmark = pytest.mark.slow

News = PlanFound | CaptureTaken | Noted


async def listen(events: EventStream, news: list[News]) -> None:
    with events.subscribe(4096) as subscription:
        async for event in subscription:
            if isinstance(event, News):
                news.append(event)  # noqa: PERF401 - one by one, for it never ends.


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


def test_a_plan_that_fails_at_the_end_leaves_the_capture_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        record = await control.start_capture(replace(REQUEST, pictures=4))
        await in_phase(control, "tune")

        async def fail(*_: object) -> None:
            raise JobFailedError("no room")

        monkeypatch.setattr(Planning, "_ask_worker", fail)
        await control.add_pictures(record.status.id, 4)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "succeeded"
        assert (record.status.images, record.status.images_total) == (4, 4)

    tell(story, tmp_path)


def test_nothing_is_added_once_all_pictures_are_taken(tmp_path: Path) -> None:
    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        record = await control.start_capture(replace(REQUEST, pictures=4))
        await in_phase(control, "capture")
        await control.pause_capture(record.status.id)
        await asyncio.sleep(10.0)
        with pytest.raises(RefusedError, match="taken already"):
            await control.add_pictures(record.status.id, 4)
        await control.resume_capture(record.status.id)
        record = await control.wait_for_capture(record.status.id)
        assert (record.status.state, record.status.images) == ("succeeded", 4)

    tell(story, tmp_path)


def test_a_single_picture_more_is_the_one_that_was_planned(tmp_path: Path) -> None:
    news: list[News] = []

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        listening = asyncio.create_task(listen(control.events, news))
        record = await control.start_capture(replace(REQUEST, pictures=4))
        await in_phase(control, "tune")
        await control.add_pictures(record.status.id, 1)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.images == 5
        listening.cancel()

    tell(story, tmp_path)
    _, later = (event for event in news if isinstance(event, PlanFound))
    (wanted,) = later.placement.viewpoints
    *_, last = (event for event in news if isinstance(event, CaptureTaken))
    off_m = np.linalg.norm(wanted.position_world - last.capture.pose.position_world)
    assert off_m < 0.5


def test_every_round_may_have_a_plan_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    news: list[News] = []
    usual = virtual_flight.FlightConfig

    def replanning(mission: MissionConfig, *rest: Any) -> FlightConfig:
        return usual(replace(mission, replan_every_round=True), *rest)

    monkeypatch.setattr(virtual_flight, "FlightConfig", replanning)

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        listening = asyncio.create_task(listen(control.events, news))
        record = await control.start_capture(replace(REQUEST, pictures=12))
        record = await control.wait_for_capture(record.status.id)
        assert (record.status.state, record.status.images) == ("succeeded", 12)
        listening.cancel()

    tell(story, tmp_path)
    plans = [len(event.placement.viewpoints) for event in news if isinstance(event, PlanFound)]
    assert plans == [12, 8, 4]


class _LiveTraining:
    """A training that tells once what it knows, and is at work until it is cancelled; a ``Job``."""

    def __init__(self, known: dict[str, Any]) -> None:
        self._known = known
        self._cancelled = asyncio.Event()

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        yield {"event": "known", "at_s": 0.0} | self._known
        await self._cancelled.wait()
        raise JobFailedError("cancelled")

    async def cancel(self) -> None:
        self._cancelled.set()


def test_what_the_field_does_not_know_reaches_the_plan_of_the_next_round(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = {"points": [[0.0, 0.0, 0.4]], "normals": [[0.0, 0.0, 1.0]], "uncertainty": [0.25]}
    asked: list[Any] = []
    informed = asyncio.Event()
    usual, submit_plan = virtual_flight.FlightConfig, InlineRunner.submit

    def uncertain(mission: MissionConfig, planner: PlannerConfig, *rest: Any) -> FlightConfig:
        return usual(mission, replace(planner, policy="uncertain"), *rest)

    async def submit(runner: InlineRunner, spec: JobSpec, folder: Path) -> Any:
        if spec.kind == "plan":
            asked.append(spec.parameters["known"])
            if asked[-1] is not None:
                informed.set()
            return await submit_plan(runner, spec, folder)
        assert spec.parameters["tell_known"]
        return _LiveTraining(told)

    monkeypatch.setattr(virtual_flight, "FlightConfig", uncertain)
    monkeypatch.setattr(InlineRunner, "submit", submit)

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        record = await control.start_capture(replace(REQUEST, pictures=12, train_seconds=5.0))
        await asyncio.wait_for(informed.wait(), 600.0)
        await control.abort_capture(record.status.id)
        await control.wait_for_capture(record.status.id)

    tell(story, tmp_path)
    # The first plan is made before there is a picture to train on.
    assert asked[0] is None
    # What was learned once is planned by once.
    assert [known for known in asked if known is not None] == [
        KnownPlaces.model_validate(told).model_dump()
    ]


def test_a_training_that_cannot_begin_ends_no_flight(tmp_path: Path) -> None:
    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        # In virtual time nothing is trained.
        record = await control.start_capture(replace(REQUEST, train_seconds=5.0))
        record = await control.wait_for_capture(record.status.id)
        assert record.status.images == 8
        assert record.status.error == (
            "the reconstruction failed: no reconstruct jobs in virtual time"
        )

    tell(story, tmp_path)


def test_a_plan_is_flown_although_nobody_can_say_what_it_will_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    news: list[News] = []
    monkeypatch.setattr("server.mission.planning.surface_seen", lambda *_: 1 / 0)

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        listening = asyncio.create_task(listen(control.events, news))
        record = await control.start_capture(replace(REQUEST, pictures=4))
        record = await control.wait_for_capture(record.status.id)
        assert (record.status.state, record.status.images) == ("succeeded", 4)
        listening.cancel()

    tell(story, tmp_path)
    (plan,) = (event for event in news if isinstance(event, PlanFound))
    assert plan.expected is None
