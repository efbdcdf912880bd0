"""Jobs in the bench's own process: the planner with a virtual duration, or one that hangs."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from server.jobs import plan
from server.jobs.runner import JobFailedError
from server.jobs.spec import JobSpec

# What planning takes a worker on two busy cores; here it passes in virtual time.
_PLAN_S = 4.0


class _Collected:
    """Keeps a job's events."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def emit(self, event: str, **fields: Any) -> None:
        """Keep one event."""
        self.events.append({"event": event} | fields)

    def should_stop(self) -> bool:
        """Nobody asks."""
        return False


class InlineJob:
    """One planning; a ``Job``."""

    def __init__(self, spec: JobSpec, hangs: bool) -> None:
        self._spec = spec
        self._hangs = hangs
        self._cancelled = asyncio.Event()

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield what the planner says, after the time it takes."""
        if self._hangs:
            await self._cancelled.wait()
            raise JobFailedError("cancelled")
        await asyncio.sleep(_PLAN_S)
        collected = _Collected()
        result = await asyncio.to_thread(plan.run, self._spec, collected)
        for event in collected.events:
            yield event
        yield {"event": "done"} | result

    async def cancel(self) -> None:
        """End a planner that hangs."""
        self._cancelled.set()


class InlineRunner:
    """Runs planning jobs inside the process; a ``JobRunner``."""

    def __init__(self, *, hangs: bool) -> None:
        """Build it; a planner that ``hangs`` never answers."""
        self._hangs = hangs

    async def submit(self, spec: JobSpec, folder: Path) -> InlineJob:
        """Return the job; it is run when its events are asked for."""
        if spec.kind != "plan":
            raise JobFailedError(f"no {spec.kind} jobs in virtual time")
        return InlineJob(spec, self._hangs)

    async def adopt(self, folder: Path) -> None:
        """Return None: nothing outlives this process."""
        return None
