"""The planning job inside this process, without a clock: it takes as long as it takes."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from server.jobs import plan
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec


class _Silent:
    """Keeps nothing of what a job reports on its way."""

    def emit(self, event: str, **fields: Any) -> None:
        """Drop a report."""

    def should_stop(self) -> bool:
        """Nobody asks."""
        return False


class PromptJob:
    """One planning; a ``Job``."""

    def __init__(self, spec: JobSpec) -> None:
        self._spec = spec

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the result, at once; raises JobFailedError as a worker's job does."""
        try:
            result = plan.run(self._spec, _Silent())
        except ValueError as error:
            raise JobFailedError(str(error), bad_input=True) from error
        yield {"event": "done"} | result

    async def cancel(self) -> None:
        """Do nothing: it is over before anybody could ask."""


class PromptRunner:
    """Runs planning jobs in this process; a ``JobRunner``."""

    async def submit(self, spec: JobSpec, folder: Path) -> PromptJob:
        """Return the job."""
        return PromptJob(spec)

    async def adopt(self, folder: Path) -> None:
        """Return None: nothing outlives this process."""
        return None
