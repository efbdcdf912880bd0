"""Jobs that an earlier console left are in the book like those handed in here."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from server.jobs.book import JobBook
from server.jobs.spec import JobSpec


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
