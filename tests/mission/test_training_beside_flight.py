"""The worker beside a flight: when it begins, and that it ends with its capture."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from virtual_console import REQUEST, in_phase, tell

from server.bench.missions.inline_jobs import InlineRunner
from server.bench.missions.virtual_flight import VirtualFlight
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec
from server.mission.control import Control
from server.swarm.fleet import Fleet


class _Training:
    """A worker that waits for pictures."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        await self.ended.wait()
        raise JobFailedError("cancelled")
        yield {}

    async def cancel(self) -> None:
        self.ended.set()


def test_the_worker_is_there_before_the_first_picture_and_ends_with_an_abort(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workers: list[_Training] = []
    submit_plan = InlineRunner.submit

    async def submit(runner: InlineRunner, spec: JobSpec, folder: Path) -> Any:
        if spec.kind == "plan":
            return await submit_plan(runner, spec, folder)
        workers.append(_Training())
        return workers[-1]

    monkeypatch.setattr(InlineRunner, "submit", submit)

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        await control.start_capture(replace(REQUEST, train_seconds=5.0))
        record = await in_phase(control, "fly")
        assert record.status.images == 0
        assert len(workers) == 1
        await control.abort_capture(record.status.id)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.images == 0

    tell(story, tmp_path)
    assert [worker.ended.is_set() for worker in workers] == [True]


def test_a_capture_that_trains_nothing_has_no_worker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kinds: list[str] = []
    submit_plan = InlineRunner.submit

    async def submit(runner: InlineRunner, spec: JobSpec, folder: Path) -> Any:
        kinds.append(spec.kind)
        return await submit_plan(runner, spec, folder)

    monkeypatch.setattr(InlineRunner, "submit", submit)

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        record = await control.start_capture(replace(REQUEST, pictures=4))
        await control.wait_for_capture(record.status.id)

    tell(story, tmp_path)
    assert set(kinds) == {"plan"}
