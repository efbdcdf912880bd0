import asyncio
import json
import shutil
from datetime import datetime

import pytest

from server.mission.checklist import problems
from server.mission.commands import RefusedError, UnknownError
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control, _records_on_disk
from server.mission.events import EventStream
from server.planner.config import PlannerConfig
from server.sim.config import SimConfig, fleet_config
from server.store.runs import RunFolder
from server.swarm.config import SafetyConfig
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig


def running_capture(runs):
    run = RunFolder.create(runs, "bin")
    run.write_state(
        {
            "request": {"mode": "standard", "pictures": 8},
            "started_at": "2026-01-02T03:04:05+00:00",
            "status": {
                "id": run.id,
                "state": "running",
                "phase": "fly",
                "progress": 0.4,
                "eta_s": 60.0,
                "run": "/elsewhere",
                "error": None,
                "mode": "standard",
                "round_index": 1,
                "rounds": 2,
                "images": 4,
                "images_total": 8,
                "at": "2026-01-02T03:05:05+00:00",
            },
        }
    )
    return run


def test_a_capture_that_was_running_when_the_console_ended_is_interrupted(tmp_path):
    run = running_capture(tmp_path)
    (run.path / "metrics.json").write_text(json.dumps({"psnr_db": 21.0}))
    record = _records_on_disk(tmp_path)[run.id]
    assert record.status.state == "interrupted"
    assert record.status.run == str(run.path)
    assert isinstance(record.status.at, datetime)
    assert record.request.pictures == 8
    assert record.metrics == {"psnr_db": 21.0}


def test_a_strange_run_does_not_keep_the_console_from_starting(tmp_path):
    good = running_capture(tmp_path)
    for name, content in {
        "list": b'{"status": []}',
        "later": b'{"status": {"state": "done", "at": "soon"}, "request": {}}',
        "bytes": b"\xff\xfe\x00",
        "number": b"3",
    }.items():
        strange = tmp_path / f"20260101-000000-{name}"
        strange.mkdir()
        (strange / "capture.json").write_bytes(content)
    assert list(_records_on_disk(tmp_path)) == [good.id]


def test_a_standing_task_that_ended_keeps_every_capture_on_the_ground(tmp_path):
    async def story():
        config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
        fleet = Fleet(fleet_config(SimConfig(drones=1)), config.safety)
        control = Control(fleet, tmp_path, config, EventStream())
        console = {check.item: check for check in control.preflight()}["console"]
        assert console.passed

        async def fails():
            raise ZeroDivisionError

        task = asyncio.create_task(fails(), name="reports")
        task.add_done_callback(control._on_task_end)
        await asyncio.wait([task])
        await asyncio.sleep(0)
        console = {check.item: check for check in control.preflight()}["console"]
        assert not console.passed
        assert console.final
        assert "reports" in console.found
        assert problems([console], {"console": "it will be fine"}) == [console]

    asyncio.run(story())


def test_a_capture_that_cannot_be_deleted_stays_in_the_list(tmp_path, monkeypatch):
    async def story():
        run = running_capture(tmp_path)
        config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
        fleet = Fleet(fleet_config(SimConfig(drones=1)), config.safety)
        control = Control(fleet, tmp_path, config, EventStream())

        def busy(_path):
            raise OSError(16, "Device or resource busy")

        with monkeypatch.context() as patched:
            patched.setattr("server.mission.control.delete_with_trainings", busy)
            with pytest.raises(RefusedError, match="busy"):
                await control.delete_capture(run.id)
        assert control.capture(run.id).status.state == "interrupted"
        with monkeypatch.context() as patched:
            # The run is out of the library already when its files turn out to be stuck.
            patched.setattr(shutil, "rmtree", busy)
            with pytest.raises(RefusedError, match="busy"):
                await control.delete_capture(run.id)
        with pytest.raises(UnknownError):
            control.capture(run.id)

    asyncio.run(story())


def test_a_capture_takes_its_fields_trained_anew_along_and_is_not_one_of_them(tmp_path):
    async def story():
        run = running_capture(tmp_path)
        training = tmp_path / "20260501-120000-train-it"
        training.mkdir()
        (training / "metrics.json").write_text(json.dumps({"dataset": str(run.path)}))
        config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
        fleet = Fleet(fleet_config(SimConfig(drones=1)), config.safety)
        control = Control(fleet, tmp_path, config, EventStream())
        assert control.run_folder(training.name) == training
        with pytest.raises(UnknownError):
            await control.delete_capture(training.name)
        await control.delete_capture(run.id)
        assert not run.path.exists()
        assert not training.exists()

    asyncio.run(story())
