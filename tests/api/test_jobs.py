"""Jobs over REST, and the book that keeps them."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fake_jobs import FakeRunner
from fake_mission import capture_changed
from served_console import Console, runner_of, until
from test_rest import is_problem

from server.jobs.book import JobBook, JobRecord
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec

PLAN = JobSpec("plan", {})


async def follow(book: JobBook, folder: Path) -> list[dict[str, object]]:
    job = await book.submit(PLAN, folder)
    return [event async for event in job.events()]


async def test_a_mission_s_job_is_kept_from_start_to_end(tmp_path: Path) -> None:
    runner = FakeRunner()
    book, ended = JobBook(runner), list[JobRecord]()
    book.on_end = ended.append
    following = asyncio.create_task(follow(book, tmp_path / "run-1" / "jobs" / "plan"))
    await until(lambda: len(runner.jobs) == 1)
    (record,) = book.jobs()
    assert (record.state, record.run) == ("running", str(tmp_path / "run-1"))
    tell = runner.jobs[0].news.put_nowait
    tell({"event": "progressed", "iteration": 5, "iterations": 20})
    await until(lambda: book.job(record.id).progress == 0.25)
    tell({"event": "done", "at_s": 1.0, "fitness": 0.5})
    assert (await following)[-1]["event"] == "done"
    assert book.job(record.id).state == "succeeded"
    assert book.job(record.id).result == {"fitness": 0.5}
    assert [each.id for each in ended] == [record.id]
    await book.cancel(record.id)  # Over is over.
    assert book.job(record.id).state == "succeeded"
    assert runner.jobs[0].cancelled == 0


async def test_a_job_that_fails_and_one_that_is_cancelled(tmp_path: Path) -> None:
    runner = FakeRunner()
    book = JobBook(runner)
    for end in ("fail", "cancel"):
        following = asyncio.create_task(follow(book, tmp_path))
        count = len(runner.jobs)
        await until(lambda count=count: len(runner.jobs) > count)
        newest = book.jobs()[0].id
        if end == "fail":
            runner.jobs[-1].news.put_nowait({"event": "failed", "error": "no memory"})
        else:
            await asyncio.gather(book.cancel(newest), book.cancel(newest))
        with pytest.raises(JobFailedError):
            await following
    cancelled, failed = book.jobs()
    assert (failed.state, failed.error) == ("failed", "no memory")
    assert (cancelled.state, cancelled.error) == ("cancelled", None)


async def train(console: Console, **changes: object) -> str:
    async with console.client() as client:
        made = await client.post("/api/v1/reconstructions", json={"capture": "run-1"} | changes)
        assert made.status_code == 202
        assert made.headers["location"] == f"/api/v1/jobs/{made.json()['id']}"
        return made.headers["location"]


def keep_capture(console: Console) -> None:
    folder = console.mission.runs / "run-1"
    folder.mkdir(parents=True)
    (folder / "transforms.json").write_text("{}")
    console.mission.keep(capture_changed("run-1", "succeeded"))


@pytest.mark.loopback
async def test_trainings_wait_for_each_other_and_are_cancelled_at_any_time(
    console: Console,
) -> None:
    keep_capture(console)
    runner = runner_of(console)
    first, second, third = [await train(console, seconds=30.0, seed=n) for n in range(3)]
    await until(lambda: len(runner.jobs) == 1)
    assert runner.jobs[0].spec.parameters["dataset"].endswith("run-1")
    assert runner.jobs[0].spec.parameters["train_seconds"] == 30.0
    async with console.client() as client:
        states = [(await client.get(job)).json()["state"] for job in (first, second, third)]
        assert states == ["running", "queued", "queued"]
        assert (await client.post(f"{second}/cancel")).json()["state"] == "cancelled"
        assert (await client.post(f"{first}/cancel")).json()["state"] == "cancelled"
        assert (await client.post(f"{first}/cancel")).json()["state"] == "cancelled"
        await until(lambda: len(runner.jobs) == 2)  # The second one never began.
        assert runner.jobs[1].spec.seed == 2
        news = {"event": "progressed", "stage": "train", "seconds": 6.0, "seconds_total": 24.0}
        runner.jobs[1].news.put_nowait(news)
        await until(lambda: console.book.jobs()[0].progress > 0)
        told = (await client.get(third)).json()
        assert (told["phase"], told["progress"]) == ("train", 0.25)
        assert told["capture"] == "run-1"
        assert Path(told["run"]).name != "run-1"
        runner.jobs[1].news.put_nowait({"event": "done", "psnr_db": float("nan")})
        await until(lambda: console.book.jobs()[0].over)
        told = (await client.get(third)).json()
        assert (told["state"], told["result"]) == ("succeeded", {"psnr_db": None})
        finished = (await client.get("/api/v1/jobs", params={"state": "succeeded"})).json()
        assert finished == [told]
        is_problem(await client.get("/api/v1/jobs/none"), 404)
        is_problem(await client.post("/api/v1/jobs/none/cancel"), 404)


@pytest.mark.loopback
async def test_what_cannot_be_trained_on_is_refused(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "running"))
    async with console.client() as client:

        async def ask(**body: object) -> int:
            return (await client.post("/api/v1/reconstructions", json=body)).status_code

        assert await ask(capture="run-1") == 409
        console.mission.keep(capture_changed("run-1", "failed"))
        console.mission.keep(capture_changed("run-2", "paused"))
        assert await ask(capture="run-1") == 409  # Another one flies.
        console.mission.keep(capture_changed("run-2", "aborted"))
        assert await ask(capture="run-1") == 409  # It has no pictures.
        assert await ask(capture="run-9") == 404
        assert await ask(capture="run-1", seconds=0) == 422
        assert await ask() == 422
    assert console.book.jobs() == []
