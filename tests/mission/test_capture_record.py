"""What a capture tells about itself."""

from __future__ import annotations

import json
from pathlib import Path

from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import _records_on_disk  # pyright: ignore[reportPrivateUsage]
from server.mission.events import CaptureChanged
from server.mission.phases import Phase, Progress
from server.mission.record import CaptureRecorder
from server.planner.config import PlannerConfig
from server.store.runs import RunFolder
from server.swarm.config import SafetyConfig
from server.vision.config import VisionConfig


def status(recorder: CaptureRecorder) -> CaptureChanged:
    return recorder.status(Progress.start(2), 0, 8, 0, 60.0, 60.0)


async def test_it_says_when_each_phase_was_entered_first_also_after_a_restart(
    tmp_path: Path,
) -> None:
    config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
    run = RunFolder.create(tmp_path, "bin")
    recorder = CaptureRecorder(CaptureRequest(), run, config)
    assert status(recorder).entered == {}
    for phase in (Phase.PREFLIGHT, Phase.FLY, Phase.TUNE):
        recorder.enter(phase)
    first = status(recorder).entered
    assert list(first) == ["preflight", "fly", "tune"]
    assert list(first.values()) == sorted(first.values())
    recorder.enter(Phase.FLY)
    assert status(recorder).entered == first
    recorder.save(status(recorder), Progress.start(2), None)
    await recorder.settled()
    assert json.loads((run.path / "capture.json").read_text())["status"]["entered"] == first
    assert _records_on_disk(tmp_path)[run.id].status.entered == first
