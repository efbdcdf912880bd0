"""Captures whose console is gone: their training is followed, taken up again, stopped."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from server.jobs.runner import Job, JobFailedError
from server.jobs.spec import JobSpec
from server.mission.commands import CaptureRequest, RefusedError
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import CaptureChanged, EventStream
from server.planner.config import PlannerConfig
from server.sim.config import SimConfig, fleet_config
from server.store.runs import RunFolder
from server.swarm.config import SafetyConfig
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig

DONE = {"psnr_db": 22.0, "seconds": {"train": 9.0}}


class FakeJob:
    """Is done, or fails, when told to."""

    def __init__(self) -> None:
        self.ended: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        # A worker of an earlier version does not say where its previews were seen from.
        yield {"event": "preview", "at_s": 0.0, "file": "preview.jpg", "T_world_cam": []}
        yield {"event": "done", "at_s": 0.0} | await self.ended

    async def cancel(self) -> None:
        if not self.ended.done():
            self.ended.set_exception(JobFailedError("stopped; it can go on where it was"))


class FakeRunner:
    """Hands out one job and keeps what was submitted."""

    def __init__(self, left: FakeJob | None) -> None:
        self.left = left
        self.job = FakeJob()
        self.submitted: list[JobSpec] = []

    async def submit(self, spec: JobSpec, folder: Path) -> Job:
        self.submitted.append(spec)
        return self.job

    async def adopt(self, folder: Path) -> Job | None:
        return self.left


def cut_off_capture(runs: Path) -> RunFolder:
    run = RunFolder.create(runs, "bin")
    request = CaptureRequest(mode="standard", pictures=8, train_seconds=20, seed=4)
    status = CaptureChanged(
        run.id, "running", "train", 0.7, 60.0, str(run.path), None, "standard", 2, 2, 8, 8
    )
    run.write_state(
        {
            "request": asdict(request),
            "started_at": "2026-01-02T03:04:05+00:00",
            "status": asdict(status) | {"at": status.at.isoformat()},
            "seconds": {"fly": 31.0},
        }
    )
    (run.path / "transforms.json").touch()
    return run


def control_of(runs: Path, runner: FakeRunner) -> Control:
    config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
    fleet = Fleet(fleet_config(SimConfig(drones=1)), config.safety)
    return Control(fleet, runs, config, EventStream(), runner=runner)


async def test_a_training_that_outlived_its_console_is_followed_to_its_end(tmp_path: Path) -> None:
    run = cut_off_capture(tmp_path)
    job = FakeJob()
    control = control_of(tmp_path, FakeRunner(job))
    with control.events.subscribe() as news:
        async with control:
            async for event in news:
                if isinstance(event, CaptureChanged):
                    break
            assert control.capture(run.id).status.state == "running"
            with pytest.raises(RefusedError, match="being trained"):
                await control.start_capture(CaptureRequest(pictures=4))
            with pytest.raises(RefusedError, match="not over"):
                await control.delete_capture(run.id)
            job.ended.set_result(dict(DONE))
            await control.wait_for_capture(run.id)
    assert (run.state() or {})["status"]["state"] == "succeeded"
    metrics = json.loads((run.path / "metrics.json").read_text())
    assert metrics["seconds"] == {"fly": 31.0, "train": 9.0}


async def test_a_cut_off_capture_is_resumed_stopped_and_resumed(tmp_path: Path) -> None:
    run = cut_off_capture(tmp_path)
    runner = FakeRunner(None)
    control = control_of(tmp_path, runner)
    async with control:
        assert control.capture(run.id).status.state == "interrupted"
        assert (await control.resume_capture(run.id)).status.state == "running"
        (spec,) = runner.submitted
        assert (spec.parameters["resume"], spec.seed, spec.attached) == (True, 4, False)
        with pytest.raises(RefusedError, match="being trained"):
            await control.resume_capture(run.id)
        assert (await control.abort_capture(run.id)).status.state == "interrupted"
        assert (run.state() or {})["status"]["state"] == "interrupted"
        runner.job = FakeJob()
        await control.resume_capture(run.id)
        runner.job.ended.set_result(dict(DONE))
        record = await control.wait_for_capture(run.id)
        assert (run.state() or {})["status"]["state"] == "succeeded"
    assert record.status.phase == "done"
    assert len(runner.submitted) == 2


async def test_the_end_of_the_console_stops_what_it_took_up(tmp_path: Path) -> None:
    run = cut_off_capture(tmp_path)
    async with control_of(tmp_path, FakeRunner(None)) as control:
        await control.resume_capture(run.id)
    assert (run.state() or {})["status"]["state"] == "interrupted"


async def test_what_left_nothing_to_go_on_with_is_refused(tmp_path: Path) -> None:
    run = cut_off_capture(tmp_path)
    (run.path / "checkpoint.npz").touch()
    async with control_of(tmp_path, FakeRunner(None)) as control:
        with pytest.raises(RefusedError, match="finished"):
            await control.resume_capture(run.id)
        assert control.capture(run.id).status.state == "interrupted"
