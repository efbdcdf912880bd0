"""What runs jobs, and what a job under way can be asked."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Protocol

from server.jobs.spec import JobSpec


class JobFailedError(Exception):
    """The worker ended without finishing; the text is its own last word.

    Attributes:
        bad_input: True when what it was given is at fault, not the worker.
    """

    def __init__(self, message: str, *, bad_input: bool = False) -> None:
        super().__init__(message)
        self.bad_input = bad_input


class Job(Protocol):
    """A job under way."""

    def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the job's events until it is done; raises JobFailedError if it fails."""
        ...

    async def cancel(self) -> None:
        """End the job; does nothing when it has already ended."""
        ...


class JobRunner(Protocol):
    """Starts jobs."""

    async def submit(self, spec: JobSpec, folder: Path) -> Job:
        """Start ``spec`` in ``folder`` and return the running job."""
        ...

    async def adopt(self, folder: Path) -> Job | None:
        """Return the job that an earlier console left in ``folder``, None when there is none."""
        ...
