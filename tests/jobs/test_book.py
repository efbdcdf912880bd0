"""The book of jobs: what an earlier console left is in it, too; at the end nothing is begun."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from server.jobs.book import JobBook, _leave_last_word
from server.jobs.spec import JobSpec
from tests.api.fake_jobs import FakeRunner


class _LeftJob:
    async def events(self) -> AsyncIterator[dict[str, Any]]:
        yield {"event": "done", "psnr_db": 20.0}

    async def cancel(self) -> None:
        raise AssertionError("nobody asked for that")


class _OneLeft:
    """A runner that finds a job in one folder only."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    async def submit(self, spec: JobSpec, folder: Path) -> _LeftJob:
        raise AssertionError("nothing was handed in")

    async def adopt(self, folder: Path) -> _LeftJob | None:
        return _LeftJob() if folder == self._folder else None


async def test_a_job_that_was_left_is_in_the_book_until_its_end(tmp_path: Path) -> None:
    folder = tmp_path / "run-1" / "jobs" / "reconstruct"
    JobSpec("reconstruct", {}).write(folder)
    book = JobBook(_OneLeft(folder))
    assert await book.adopt(tmp_path / "elsewhere") is None
    assert book.jobs() == []
    job = await book.adopt(folder)
    assert job is not None
    (record,) = book.jobs()
    assert (record.kind, record.state, record.run) == (
        "reconstruct",
        "running",
        str(tmp_path / "run-1"),
    )
    assert [event["event"] async for event in job.events()] == ["done"]
    (record,) = book.jobs()
    assert (record.state, record.result) == ("succeeded", {"psnr_db": 20.0})


async def test_a_folder_without_a_job_has_none_to_adopt(tmp_path: Path) -> None:
    (tmp_path / "spec.json").write_text("no job")
    assert await JobBook(_OneLeft(tmp_path)).adopt(tmp_path) is None


@pytest.mark.parametrize("told", ["", '{"event": "progressed"}\n', '{"event": "prog'])
async def test_a_worker_that_was_killed_gets_its_last_word_written(
    tmp_path: Path, told: str
) -> None:
    runner = FakeRunner()
    book = JobBook(runner)
    book.request(JobSpec("reconstruct", {}), tmp_path, tmp_path)
    events, ended = tmp_path / "events.jsonl", asyncio.Event()
    book.on_end = lambda _: ended.set()
    async with asyncio.timeout(10.0):
        for _ in range(20):  # It gets its turn.
            await asyncio.sleep(0)
        events.write_text(told)
        runner.jobs[0].news.put_nowait({"event": "failed", "error": "exit code -9"})
        await ended.wait()
    assert events.read_text().startswith(told)
    assert json.loads(events.read_text().splitlines()[-1]) == {
        "event": "failed",
        "error": "exit code -9",
        "bad_input": False,
    }
    # One that could say it itself has said it.
    said = events.read_text()
    _leave_last_word(tmp_path, "once more")
    assert events.read_text() == said


async def test_closing_ends_the_job_that_runs_and_begins_none_of_those_that_wait(
    tmp_path: Path,
) -> None:
    runner = FakeRunner()
    book = JobBook(runner)
    for number in range(3):
        folder = tmp_path / str(number)
        book.request(JobSpec("reconstruct", {}), folder, folder)
    async with asyncio.timeout(10.0):
        for _ in range(20):  # The first one gets its turn.
            await asyncio.sleep(0)
        assert len(runner.jobs) == 1
        assert [book.ahead_of(record.id) for record in book.jobs()] == [2, 1, 0]
        await book.cancel(book.jobs()[1].id)
        assert book.ahead_of(book.jobs()[0].id) == 1
        await book.close()
    assert [job.cancelled for job in runner.jobs] == [1]
    assert [record.state for record in book.jobs()] == ["cancelled"] * 3
