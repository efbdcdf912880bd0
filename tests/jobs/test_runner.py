"""Real worker processes; the jobs are small planning jobs or made to fail."""

import asyncio
import os
import signal
from dataclasses import asdict

import pytest

from server.geometry.cameras import TELLO_INTRINSICS
from server.jobs.local import LocalRunner
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec

pytestmark = pytest.mark.slow


def _plan(**changes) -> JobSpec:
    parameters = {
        "outer": ([-0.3, -0.2, 0.0], [0.3, 0.2, 0.4]),
        "boxes": [([-0.3, -0.2, 0.0], [0.3, 0.2, 0.2]), ([-0.2, -0.2, 0.2], [0.3, 0.2, 0.4])],
        "views": 4,
        "intrinsics": asdict(TELLO_INTRINSICS),
        "tilt_rad": 0.2,
        "drones": {"a": (1.8, 0.0, 0.8, 3.1), "b": (-1.8, 0.0, 0.8, 0.0)},
        "rounds": 2,
        "config": {},
    }
    return JobSpec("plan", parameters | changes, seed=1)


async def _events(spec: JobSpec, folder) -> list[dict]:
    job = await LocalRunner().submit(spec, folder)
    return [event async for event in job.events()]


async def test_a_plan_gives_every_drone_a_viewpoint_in_every_round(tmp_path):
    events = await _events(_plan(), tmp_path / "job")
    done = events[-1]
    assert done["event"] == "done"
    assert [sorted(entry) for entry in done["rounds"]] == [["a", "b"], ["a", "b"]]
    assert len(done["viewpoints"]) == 4
    assert (tmp_path / "job" / "events.jsonl").read_text().count("\n") == len(events)


async def test_bad_input_is_told_from_a_fault_of_the_worker(tmp_path):
    with pytest.raises(JobFailedError) as caught:
        await _events(_plan(tilt_rad="steep"), tmp_path / "job")
    assert caught.value.bad_input


async def test_a_killed_worker_is_a_failure(tmp_path):
    job = await LocalRunner().submit(_plan(), tmp_path / "job")
    os.killpg(job._process.pid, signal.SIGKILL)
    with pytest.raises(JobFailedError, match="exit code"):
        async for _ in job.events():
            pass


async def test_cancel_ends_the_worker_and_twice_is_harmless(tmp_path):
    job = await LocalRunner().submit(_plan(), tmp_path / "job")
    await asyncio.gather(job.cancel(), job.cancel())
    await job.cancel()
    assert job._process.returncode is not None
