"""Jobs on a real Ray head on loopback: trained, told, cancelled, killed."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from server.jobs.config import RayConfig
from server.jobs.heartbeat import worker_in
from server.jobs.ray_runner import RayRunner
from server.jobs.runner import Job, JobFailedError
from server.jobs.spec import JobSpec
from server.jobs.unfinished import unfinished
from tests.jobs.ray_head import RayHead, free_ports, ray_head
from tests.nerf.tiny_scene import write_cut_out_scene

pytestmark = [pytest.mark.slow, pytest.mark.loopback]


@pytest.fixture(scope="module")
def head() -> Iterator[RayHead]:
    with ray_head(cpus=2) as running:
        yield running


def config(head: RayHead, **changes: Any) -> RayConfig:
    changes = {"address": head.address, "python": sys.executable, "cpus": 1} | changes
    return RayConfig(**changes)


def training(tmp_path: Path, steps: int, out: str = "run") -> JobSpec:
    dataset = tmp_path / "data"
    if not dataset.exists():
        write_cut_out_scene(dataset)
    parameters = {
        "source": "dataset",
        "dataset": str(dataset),
        "out": str(tmp_path / out),
        "steps": steps,
        "results": False,
    }
    return JobSpec("reconstruct", parameters, seed=3)


async def until_trains(job: Job) -> Any:
    """Return the job's events, read up to where it trains."""
    events = job.events()
    async for event in events:
        if event["event"] == "progressed" and event["stage"] == "train":
            return events
    pytest.fail("it never trained")


async def test_trainings_run_side_by_side_and_tell_how_they_go(
    head: RayHead, tmp_path: Path
) -> None:
    async def train(runner: RayRunner, out: str) -> list[dict[str, Any]]:
        job = await runner.submit(training(tmp_path, 60, out), tmp_path / "jobs" / out)
        events = [event async for event in job.events()]
        await job.cancel()  # Of a job that is done: nothing happens.
        return events

    async with RayRunner(config(head)) as runner:
        for events in await asyncio.gather(train(runner, "one"), train(runner, "two")):
            assert events[-1]["event"] == "done"
            assert {"progressed", "preview", "metrics"} <= {event["event"] for event in events}
    for out in ("one", "two"):
        assert (tmp_path / out / "checkpoint.npz").exists()
        assert json.loads((tmp_path / out / "metrics.json").read_text())["psnr_db"] > 10.0


async def test_pictures_and_results_travel_through_a_store(head: RayHead, tmp_path: Path) -> None:
    store = tmp_path / "store"
    async with RayRunner(config(head, store=f"file://{store}")) as runner:
        job = await runner.submit(training(tmp_path, 30), tmp_path / "job")
        events = [event async for event in job.events()]
    run = tmp_path / "run"
    assert events[-1]["run"] == str(run)
    metrics = json.loads((run / "metrics.json").read_text())
    assert (metrics["run"], metrics["dataset"]) == (str(run), str(tmp_path / "data"))
    assert {"checkpoint.npz", "metrics.json", "preview.jpg"} <= {f.name for f in run.iterdir()}
    assert list(store.iterdir()) == [], "the store is left as it was found"


async def in_shell(head: RayHead, folder: Path, *command: str) -> dict[str, Any]:
    """Run a command as whoever sweeps would, and return its result."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *("-P", "-m", "server", *command, "--json"),
        cwd=folder,
        env=os.environ
        | {
            "DRONERF_RUNNER": "ray",
            "DRONERF_RUNS": str(folder / "runs"),
            "DRONERF_RAY__ADDRESS": head.address,
            "DRONERF_RAY__PYTHON": sys.executable,
            "DRONERF_RAY__CPUS": "1",
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    out, told = await process.communicate()
    assert process.returncode == 0, told.decode()
    result: dict[str, Any] = json.loads(out)
    return result


async def test_a_sweep_of_placements_gives_what_this_machine_gives(
    head: RayHead, tmp_path: Path
) -> None:
    command = ("plan", "--size", "0.4x0.4x0.8", "--pictures", "8", "--seed")
    one, two = await asyncio.gather(
        *(in_shell(head, tmp_path, *command, seed) for seed in ("1", "2"))
    )
    for plan in (one, two):
        assert len(plan["viewpoints"]) == 8
        assert plan["fitness"] <= plan["bound"] + 1e-9
    here = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-m", "server", *command, "1", "--json", stdout=subprocess.PIPE
    )
    out, _ = await here.communicate()
    assert json.loads(out) == one
    # Each left its job on the cluster, and no file.
    assert list((tmp_path / "runs").iterdir()) == []


async def test_a_sweep_from_the_shell_is_commands_side_by_side(
    head: RayHead, tmp_path: Path
) -> None:
    write_cut_out_scene(tmp_path / "data")
    command = ("train", "data", "--steps", "20", "--field-only", "--seed")
    one, two = await asyncio.gather(
        *(in_shell(head, tmp_path, *command, seed) for seed in ("1", "2"))
    )
    # Nothing but the runs is left.
    assert {str(run) for run in (tmp_path / "runs").iterdir()} == {one["run"], two["run"]}
    for result in (one, two):
        assert (Path(result["run"]) / "checkpoint.npz").exists()


async def test_a_running_job_is_cancelled_and_a_queued_one(head: RayHead, tmp_path: Path) -> None:
    async with RayRunner(config(head, cpus=2)) as runner:
        running = await runner.submit(training(tmp_path, 100_000), tmp_path / "job-1")
        events = await until_trains(running)
        queued = await runner.submit(training(tmp_path, 100_000, "never"), tmp_path / "job-2")
        waiting = asyncio.ensure_future(anext(queued.events()))
        await asyncio.sleep(1.0)  # It is queued, or about to be: either way it must end.
        await asyncio.gather(queued.cancel(), queued.cancel())
        with pytest.raises(JobFailedError):
            await waiting
        rest = asyncio.create_task(drain(events))
        await asyncio.gather(running.cancel(), running.cancel())
        with pytest.raises(JobFailedError, match="stopped"):
            await rest
        await running.cancel()
    assert not (tmp_path / "never").exists()
    assert unfinished(tmp_path / "run")[1] == 3


async def drain(events: Any) -> None:
    async for _ in events:
        pass


async def test_a_worker_that_is_killed_is_told_and_can_go_on(head: RayHead, tmp_path: Path) -> None:
    async with RayRunner(config(head)) as runner:
        job = await runner.submit(training(tmp_path, 100_000), tmp_path / "job")
        events = await until_trains(job)
        number = worker_in(tmp_path / "job")
        assert number is not None
        os.kill(number, signal.SIGKILL)
        with pytest.raises(JobFailedError, match="Ray"):
            await drain(events)
    assert unfinished(tmp_path / "run")[0]["resume"] is True


CONSOLE = """
import asyncio, json, sys
from pathlib import Path
from server.jobs.config import RayConfig
from server.jobs.ray_runner import RayRunner
from server.jobs.spec import JobSpec

async def main():
    folder, config, spec = sys.argv[1:]
    async with RayRunner(RayConfig(**json.loads(config))) as runner:
        job = await runner.submit(JobSpec(**json.loads(spec)), Path(folder))
        async for event in job.events():
            print(event["event"], event.get("stage", ""), flush=True)

asyncio.run(main())
"""


async def test_the_next_console_follows_the_job_of_one_that_was_killed(
    head: RayHead, tmp_path: Path
) -> None:
    (port,) = free_ports(1)
    spec = training(tmp_path, 150)
    wanted = {"address": head.address, "python": sys.executable, "cpus": 1, "callback_port": port}
    told = {"kind": spec.kind, "parameters": spec.parameters, "seed": spec.seed}
    arguments = [str(tmp_path / "job"), json.dumps(wanted), json.dumps(told)]
    console = await asyncio.create_subprocess_exec(
        sys.executable, "-c", CONSOLE, *arguments, stdout=subprocess.PIPE
    )
    assert console.stdout is not None
    while not (await console.stdout.readline()).startswith(b"progressed train"):
        assert console.returncode is None
    console.kill()
    await console.wait()
    async with RayRunner(RayConfig(**wanted)) as runner:
        job = await runner.adopt(tmp_path / "job")
        assert job is not None
        assert [event async for event in job.events()][-1]["event"] == "done"


async def test_when_the_cluster_dies_the_job_fails_and_can_go_on(tmp_path: Path) -> None:
    with ray_head(cpus=1) as doomed:
        async with RayRunner(config(doomed, silence_s=1.0)) as runner:
            job = await runner.submit(training(tmp_path, 100_000), tmp_path / "job")
            events = await until_trains(job)
            doomed.kill()
            with pytest.raises(JobFailedError, match="cannot be reached"):
                await drain(events)
            await job.cancel()
            assert await runner.adopt(tmp_path / "job") is None
    assert unfinished(tmp_path / "run")[0]["resume"] is True
