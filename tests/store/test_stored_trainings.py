"""Trainings anew, as their run folders tell of them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from server.store.catalogue import Catalogue
from server.store.config import RetentionConfig
from server.store.deletion import StillTrainedError, delete_with_trainings, doom_training
from server.store.row import read_row
from server.store.runs import clear_deleted
from server.store.trainings import read_training, trainings_on

CAPTURE = "20260501-120000-bin"


def keep_capture(runs: Path, name: str = CAPTURE) -> Path:
    folder = runs / name
    folder.mkdir(parents=True)
    about = {
        "request": {"name": "bin", "mode": "optimized"},
        "started_at": "2026-05-01T12:00:00+00:00",
        "status": {"state": "succeeded", "at": "2026-05-01T12:03:00+00:00"},
    }
    (folder / "capture.json").write_text(json.dumps(about))
    (folder / "metrics.json").write_text(json.dumps({"dataset": str(folder), "psnr_db": 20.0}))
    return folder


def begin_training(
    dataset: Path, name: str = "20260501-130000-train-bin", runs: Path | None = None
) -> Path:
    """Make the folder of a training that has just begun."""
    folder = (runs or dataset.parent) / name
    (folder / "jobs/reconstruct").mkdir(parents=True)
    parameters = {
        "source": "dataset",
        "dataset": str(dataset.resolve()),
        "train_seconds": 30.0,
        "object_only": True,
    }
    asked = {"parameters": parameters, "seed": 7}
    (folder / "jobs/reconstruct/spec.json").write_text(json.dumps(asked))
    (folder / "training.json").write_text(json.dumps(asked))
    return folder


def end_training(folder: Path, **metrics: Any) -> Path:
    told = read_training(folder)
    assert told is not None
    about = {"dataset": told.dataset, "psnr_db": 22.5, "object_only": told.object_only} | metrics
    (folder / "metrics.json").write_text(json.dumps(about))
    (folder / "training.json").unlink()
    return folder


def state_of(folder: Path) -> str:
    row = read_row(folder)
    assert row is not None
    return row.state


def age(folder: Path, seconds: float) -> None:
    for path in folder.rglob("*"):
        os.utime(path, (time.time() - seconds, time.time() - seconds))


def tell(folder: Path, **event: Any) -> None:
    (folder / "jobs/reconstruct/events.jsonl").write_text(json.dumps(event) + "\n")


def test_settings_figures_and_state_are_read_from_the_folder(tmp_path: Path) -> None:
    folder = begin_training(keep_capture(tmp_path))
    training = read_training(folder)
    assert training is not None
    assert (training.seconds, training.seed, training.object_only) == (30.0, 7, True)
    assert training.metrics is None
    assert not training.finished
    assert state_of(folder) == "running"
    end_training(folder)
    training = read_training(folder)
    assert training is not None
    assert training.finished
    # Also once nothing but the judgement tells of them.
    assert (training.seconds, training.seed) == (30.0, 7)
    assert training.metrics is not None
    row = read_row(folder)
    assert row is not None
    assert (row.kind, row.subject, row.state) == ("training", CAPTURE, "succeeded")
    assert row.begun_unix_s == 1777640400.0  # As its name says.
    shutil.rmtree(folder / "jobs")
    told = json.loads((folder / "metrics.json").read_text())
    (folder / "metrics.json").write_text(json.dumps(told | {"train_seconds": 30.0, "seed": 7}))
    again = read_training(folder)
    assert again is not None
    assert (again.seconds, again.seed) == (30.0, 7)


def test_one_that_did_not_end_well_says_how(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path)
    failed = begin_training(capture, "20260501-130001-train-bin")
    tell(failed, event="failed", error="no memory", bad_input=False)
    cancelled = begin_training(capture, "20260501-130002-train-bin")
    tell(cancelled, event="failed", error="stopped", bad_input=False, stopped=True)
    (cancelled / "jobs/reconstruct/stop").touch()
    orphan = begin_training(capture, "20260501-130003-train-bin")
    tell(orphan, event="failed", error="stopped", bad_input=False, stopped=True)
    assert (state_of(failed), state_of(cancelled)) == ("failed", "cancelled")
    told = read_training(failed)
    assert told is not None
    assert told.error == "no memory"
    age(orphan, 900.0)
    assert state_of(orphan) == "interrupted"
    # One that somebody goes on with runs again, whatever was said before.
    for folder in (failed, cancelled):
        age(folder, 300.0)
        (folder / "training.npz").touch()
        assert state_of(folder) == "running"


WORKER = """
import sys, time
from pathlib import Path
from server.jobs.heartbeat import Heartbeat
Heartbeat(Path(sys.argv[1]))
print(flush=True)
time.sleep(60)
"""


def test_a_worker_s_lock_tells_whether_it_is_at_work(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path)
    folder = begin_training(capture)
    job = folder / "jobs/reconstruct"
    command = [sys.executable, "-c", WORKER, str(job)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as worker:
        assert worker.stdout is not None
        try:
            worker.stdout.readline()
            worker.send_signal(signal.SIGSTOP)  # It trains on, however long it writes nothing.
            age(folder, 3000.0)
            assert state_of(folder) == "running"
            with pytest.raises(StillTrainedError):
                doom_training(folder)
            with Catalogue(tmp_path) as catalogue:
                catalogue.rescan()
                assert folder.name not in catalogue.retain(RetentionConfig(quota_bytes=0))
        finally:
            worker.kill()
    age(folder, 1.0)
    # Killed without a last word, a second ago.
    assert state_of(folder) == "interrupted"
    # Somebody goes on with it from a shell, whose worker has its lock elsewhere.
    age(folder, 500.0)
    os.utime(folder / "training.json", (time.time() - 400.0, time.time() - 400.0))
    assert state_of(folder) == "running"
    age(folder, 1.0)
    doom_training(folder)


def test_what_waits_for_a_cluster_is_not_over(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path)
    folder = begin_training(capture)
    (folder / "jobs/reconstruct/ray.json").write_text("{}")
    age(folder, 86_400.0)
    assert state_of(folder) == "running"
    with pytest.raises(StillTrainedError):
        delete_with_trainings(capture)
    # Where its nodes see our files, its worker's beats are seen.
    (folder / "jobs/reconstruct/heartbeat").touch()
    assert state_of(folder) == "running"
    age(folder, 900.0)
    assert state_of(folder) == "interrupted"
    # Told to be over, it is.
    tell(folder, event="failed", error="Ray: no such node", bad_input=False)
    assert state_of(folder) == "failed"
    delete_with_trainings(capture)
    assert list(tmp_path.iterdir()) == []


def test_a_run_s_own_field_is_no_training_on_it(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path / "runs")
    first = end_training(begin_training(capture, "20260501-130000-train-bin"))
    second = begin_training(capture, "20260501-140000-train-bin")
    begin_training(keep_capture(tmp_path / "runs", "20260501-125959-bin"), "20260501-150000-train")
    # Another library's capture of the same name is another one.
    begin_training(keep_capture(tmp_path / "other"), "elsewhere", runs=tmp_path / "runs")
    (tmp_path / "runs/broken").mkdir()
    (tmp_path / "runs/broken/metrics.json").write_text("[")
    (tmp_path / "runs/link").symlink_to(first)
    assert trainings_on(capture) == [second, first]
    assert trainings_on(tmp_path / "nowhere/run") == []


def test_a_library_that_was_moved_keeps_them_together(tmp_path: Path) -> None:
    end_training(begin_training(keep_capture(tmp_path / "runs")))
    (tmp_path / "runs").rename(tmp_path / "moved")
    names = [folder.name for folder in trainings_on(tmp_path / "moved" / CAPTURE)]
    assert names == ["20260501-130000-train-bin"]


def test_a_capture_takes_the_fields_trained_on_it_along(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path)
    other = keep_capture(tmp_path, "20260501-125959-bin")
    training = end_training(begin_training(capture))
    busy = begin_training(capture, "20260501-140000-train-bin")
    with pytest.raises(StillTrainedError, match="not over"):
        delete_with_trainings(capture)
    with pytest.raises(StillTrainedError, match="not over"):
        doom_training(busy)
    assert {capture, training, busy} <= set(tmp_path.iterdir())
    age(busy, 900.0)
    shutil.rmtree(doom_training(busy))
    assert not busy.exists()
    delete_with_trainings(capture)
    assert set(tmp_path.iterdir()) == {other}


def test_all_are_out_of_the_library_before_a_file_is_deleted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = keep_capture(tmp_path)
    training = end_training(begin_training(capture))

    def stuck(folder: Path) -> None:
        raise OSError(16, "Device or resource busy")

    with monkeypatch.context() as patched:
        patched.setattr(shutil, "rmtree", stuck)
        with pytest.raises(OSError, match="busy"):
            delete_with_trainings(capture)
    doomed = {f".deleting-{name}" for name in (capture.name, training.name)}
    assert {path.name for path in tmp_path.iterdir()} == doomed
    clear_deleted(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_retention_keeps_the_pictures_of_a_field_that_it_keeps(tmp_path: Path) -> None:
    capture = keep_capture(tmp_path)
    between = keep_capture(tmp_path, "20260501-123000-bin")
    about = (between / "capture.json").read_text().replace("12:0", "12:3")
    (between / "capture.json").write_text(about)
    training = end_training(begin_training(capture))
    (training / "starred").touch()
    with Catalogue(tmp_path) as catalogue:
        catalogue.rescan()
        assert catalogue.retain(RetentionConfig(quota_bytes=0)) == [between.name]
        (training / "starred").unlink()
        catalogue.rescan()
        # What was begun last goes last, the pictures after the field.
        late = keep_capture(tmp_path, "20260501-123000-bin")
        (late / "capture.json").write_text(about)
        catalogue.rescan()
        # Not from under whoever changes the capture.
        busy = frozenset({late.name, capture.name})
        assert catalogue.retain(RetentionConfig(quota_bytes=0), busy) == []
        gone = catalogue.retain(RetentionConfig(quota_bytes=0))
        assert gone == [late.name, training.name, capture.name]


def test_what_failed_is_listed_and_goes_with_the_others(tmp_path: Path) -> None:
    failed = begin_training(keep_capture(tmp_path))
    tell(failed, event="failed", error="no memory", bad_input=False)
    running = begin_training(tmp_path / CAPTURE, "20260501-140000-train-bin")
    with Catalogue(tmp_path) as catalogue:
        catalogue.rescan()
        page = catalogue.page(kind="training")
        assert [row.state for row in page.rows] == ["running", "failed"]
        assert catalogue.retain(RetentionConfig(quota_bytes=0)) == [failed.name]
        assert running.exists()
