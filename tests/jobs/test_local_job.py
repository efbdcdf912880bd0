"""Workers that outlive whoever started them, fall silent, or do not want to end."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import pytest

from server.jobs import local_job
from server.jobs.heartbeat import Heartbeat, worker_in
from server.jobs.local import LocalRunner
from server.jobs.local_job import LocalJob, left_behind
from server.jobs.runner import JobFailedError
from server.jobs.spec import EVENTS, JobSpec
from server.jobs.unfinished import unfinished
from tests.nerf.tiny_scene import write_cut_out_scene

# A console that starts a job and waits for its death.
CONSOLE = """
import asyncio, json, sys
from pathlib import Path
from server.jobs.local import LocalRunner
from server.jobs.spec import JobSpec

async def main():
    job = await LocalRunner().submit(JobSpec(**json.loads(sys.argv[2])), Path(sys.argv[1]))
    async for event in job.events():
        print(event["event"], event.get("stage", ""), flush=True)

asyncio.run(main())
"""
# A worker that takes its folder and then does what it is told to.
STUBBORN = """
import signal, sys, time
from pathlib import Path
from server.jobs.heartbeat import Heartbeat
signal.signal(signal.SIGTERM, signal.SIG_IGN)
Heartbeat(Path(sys.argv[1]))
print('{"event": "progressed"}', flush=True)
while True:
    time.sleep(1)
"""


def training(tmp_path: Path, *, steps: int, attached: bool) -> JobSpec:
    dataset = write_cut_out_scene(tmp_path / "data")
    parameters = {
        "source": "dataset",
        "dataset": str(dataset),
        "out": str(tmp_path / "run"),
        "steps": steps,
        "results": False,
    }
    return JobSpec("reconstruct", parameters, seed=3, niceness=0, attached=attached)


def kill_a_console_that_trains(spec: JobSpec, folder: Path) -> None:
    command = [sys.executable, "-c", CONSOLE, str(folder), json.dumps(asdict(spec))]
    console = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert console.stdout is not None
    for line in console.stdout:
        if line.startswith("progressed train"):
            break
    console.kill()
    console.wait()
    console.stdout.close()


@pytest.mark.slow
async def test_a_worker_outlives_its_console_and_the_next_one_follows_it(tmp_path: Path) -> None:
    folder = tmp_path / "job"
    kill_a_console_that_trains(training(tmp_path, steps=60, attached=False), folder)
    job = await LocalRunner().adopt(folder)
    assert job is not None
    events = [event async for event in job.events()]
    assert events[-1]["event"] == "done"
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())["images"] > 0
    # Done while nobody looked is done, too, but there is nobody to end any more.
    late = await LocalRunner().adopt(folder)
    assert late is not None
    assert [event async for event in late.events()][-1] == events[-1]
    await late.cancel()


@pytest.mark.slow
async def test_an_adopted_worker_is_stopped_and_can_go_on(tmp_path: Path) -> None:
    folder = tmp_path / "job"
    kill_a_console_that_trains(training(tmp_path, steps=100_000, attached=False), folder)
    job = await LocalRunner().adopt(folder)
    assert job is not None
    await asyncio.gather(job.cancel(), job.cancel())
    assert worker_in(folder) is None
    with pytest.raises(JobFailedError, match="stopped"):
        _ = [event async for event in job.events()]
    assert await LocalRunner().adopt(folder) is None
    parameters, seed = unfinished(tmp_path / "run")
    assert (parameters["resume"], seed) == (True, 3)


@pytest.mark.slow
def test_a_worker_whose_console_is_gone_leaves_no_half_trained_field(tmp_path: Path) -> None:
    folder = tmp_path / "job"
    kill_a_console_that_trains(training(tmp_path, steps=100_000, attached=True), folder)
    while worker_in(folder) is not None:
        time.sleep(0.05)
    assert not (tmp_path / "run" / "checkpoint.npz").exists()
    assert unfinished(tmp_path / "run")[0]["steps"] == 100_000


async def stubborn(folder: Path, silence_s: float = 600.0) -> tuple[LocalJob, int]:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        STUBBORN,
        str(folder),
        stdout=asyncio.subprocess.PIPE,
        process_group=0,
    )
    return LocalJob(folder, process, silence_s), process.pid


async def test_a_worker_that_ignores_stop_and_term_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_job, "_STOP_S", 0.1)
    monkeypatch.setattr(local_job, "_TERM_S", 0.1)
    job, _ = await stubborn(tmp_path)
    events = job.events()
    assert (await anext(events))["event"] == "progressed"
    await job.cancel()
    with pytest.raises(JobFailedError, match="exit code -9"):
        await anext(events)


async def test_a_worker_that_stands_still_is_given_up(tmp_path: Path) -> None:
    job, number = await stubborn(tmp_path, silence_s=0.5)
    events = job.events()
    assert (await anext(events))["event"] == "progressed"
    os.killpg(number, signal.SIGSTOP)
    with pytest.raises(JobFailedError, match="silent"):
        await anext(events)
    assert worker_in(tmp_path) is None


def test_a_folder_has_one_worker(tmp_path: Path) -> None:
    assert worker_in(tmp_path) is None
    command = [sys.executable, "-c", STUBBORN, str(tmp_path)]
    first = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert first.stdout is not None
        first.stdout.readline()
        assert worker_in(tmp_path) == first.pid
        with pytest.raises(ValueError, match="another worker"):
            Heartbeat(tmp_path)
    finally:
        first.kill()
        first.communicate()
    assert worker_in(tmp_path) is None


@pytest.mark.parametrize(
    "told", ["", '{"event": "failed"}\n', '{"event": "progressed"}\n{"event": "do', "[]\n"]
)
def test_what_ended_without_being_done_is_not_adopted(tmp_path: Path, told: str) -> None:
    (tmp_path / EVENTS).write_text(told)
    assert left_behind(tmp_path) is None
