"""Jobs without workers: each waits until the test lets it end."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec


class FakeJob:
    """A job that tells what it is given, and ends when it is told to."""

    def __init__(self, spec: JobSpec, folder: Path) -> None:
        self.spec, self.folder = spec, folder
        self.news: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.cancelled = 0

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        while True:
            event = await self.news.get()
            if event["event"] == "failed":
                raise JobFailedError(event["error"])
            yield event
            if event["event"] == "done":
                return

    async def cancel(self) -> None:
        self.cancelled += 1
        self.news.put_nowait({"event": "failed", "error": "the worker was ended"})


class FakeRunner:
    """Keeps the jobs that were handed in."""

    def __init__(self) -> None:
        self.jobs: list[FakeJob] = []

    async def submit(self, spec: JobSpec, folder: Path) -> FakeJob:
        spec.write(folder)
        self.jobs.append(FakeJob(spec, folder))
        return self.jobs[-1]

    async def adopt(self, folder: Path) -> FakeJob | None:
        """Return the job that was begun in ``folder`` before, None when there is none."""
        return next((job for job in self.jobs if job.folder == folder), None)
