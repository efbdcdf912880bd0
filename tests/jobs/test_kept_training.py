"""A training that is killed goes on where it was."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.jobs.kept_training import KeptTraining
from server.jobs.spec import JobSpec
from server.jobs.unfinished import STATE, WANTED, unfinished
from server.nerf.dataset import load_dataset
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import write_cut_out_scene

# The worker, keeping its state every few steps.
WORKER = """
import sys, server.jobs.kept_training as kept, server.jobs.worker as worker
kept._EVERY_S = 0.3
sys.exit(worker.main())
"""
STEPS = 120


def start(folder: Path, parameters: dict[str, Any], seed: int) -> subprocess.Popen[bytes]:
    JobSpec("reconstruct", parameters, seed=seed, threads=1, niceness=0).write(folder)
    return subprocess.Popen([sys.executable, "-c", WORKER, str(folder)], stdout=subprocess.DEVNULL)


def wanted(dataset: Path, out: Path) -> dict[str, Any]:
    return {
        "source": "dataset",
        "dataset": str(dataset),
        "out": str(out),
        "steps": STEPS,
        "results": False,
    }


@pytest.mark.slow
def test_a_killed_training_goes_on_and_ends_as_if_nothing_had_happened(tmp_path: Path) -> None:
    dataset = write_cut_out_scene(tmp_path / "data")
    whole = start(tmp_path / "job-1", wanted(dataset, tmp_path / "whole"), 3)
    assert whole.wait(300) == 0
    run = tmp_path / "killed"
    process = start(tmp_path / "job-2", wanted(dataset, run), 3)
    while not (run / STATE).exists():
        assert process.poll() is None, "it ended before anything was kept"
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (run / "checkpoint.npz").exists()
    assert (run / STATE).exists()
    parameters, seed = unfinished(run)
    assert start(tmp_path / "job-3", parameters, seed).wait(300) == 0
    result = json.loads((run / "metrics.json").read_text())
    assert 0.0 < result["resumed_at"] < 1.0
    expected = json.loads((tmp_path / "whole" / "metrics.json").read_text())
    assert expected["resumed_at"] == 0.0
    assert result["psnr_db"] == pytest.approx(expected["psnr_db"], abs=1e-3)
    assert sorted(file.name for file in run.iterdir()) == sorted(
        file.name for file in (tmp_path / "whole").iterdir()
    )
    with pytest.raises(ValueError, match="finished"):
        unfinished(run)


def test_a_capture_cut_off_before_its_training_is_taken_up_as_it_was_ordered(
    tmp_path: Path,
) -> None:
    request = {"train_seconds": 20.0, "mode": "standard", "seed": 4}
    (tmp_path / "capture.json").write_text(json.dumps({"request": request}))
    with pytest.raises(ValueError, match="no picture was taken"):
        unfinished(tmp_path)
    (tmp_path / "transforms.json").touch()
    parameters, seed = unfinished(tmp_path)
    assert (parameters["source"], parameters["train_seconds"], seed) == ("flight", 20.0, 4)
    request["train_seconds"] = 0.0
    (tmp_path / "capture.json").write_text(json.dumps({"request": request}))
    with pytest.raises(ValueError, match="none was ordered"):
        unfinished(tmp_path)


def test_where_there_is_nothing_to_go_on_with_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no training to go on with"):
        unfinished(tmp_path)
    with pytest.raises(ValueError, match="no folder"):
        unfinished(tmp_path / "nowhere")
    (tmp_path / WANTED).write_text("half a f")
    with pytest.raises(ValueError, match="no training to go on with"):
        unfinished(tmp_path)


def test_a_full_disk_does_not_end_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    dataset = load_dataset(write_cut_out_scene(tmp_path / "data"))

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Trainer, "save", full)
    kept = KeptTraining(tmp_path)
    kept.keep(object.__new__(Trainer), now=True)
    assert "No space left" in caplog.text
    assert kept.load(dataset, 1) is None


def test_a_broken_state_is_no_state(tmp_path: Path) -> None:
    dataset = load_dataset(write_cut_out_scene(tmp_path / "data"))
    np.savez(tmp_path / STATE, allow_pickle=False, about=np.array("{}"))
    assert KeptTraining(tmp_path).load(dataset, 1) is None
    shutil.copyfile(dataset.files[0], tmp_path / STATE)
    assert KeptTraining(tmp_path).load(dataset, 1) is None
