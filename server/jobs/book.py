"""The book of jobs: every job that was handed to a runner here, how far it is, how it ended.

``JobBook`` is itself a ``JobRunner``: the mission hands its jobs to it as to any other. Jobs that
nobody flies for are asked for by ``request``; they wait for each other, so that they do not take
the processor from the drones together. The book knows the jobs of this program's life only.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import secrets
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal

from server.jobs.runner import Job, JobFailedError, JobRunner
from server.jobs.spec import EVENTS, JobSpec, Kind

logger = logging.getLogger(__name__)

JobState = Literal["queued", "running", "succeeded", "failed", "cancelled"]
_MOST_KEPT = 1000
_MOST_WAITING = 20


@dataclass(frozen=True, slots=True)
class JobRecord:
    """A job as it stands.

    Attributes:
        id: Begins with the time it was handed in, so ids sort by age.
        spec: What was handed in.
        state: queued, running, succeeded, failed or cancelled.
        phase: What the worker is at, in its words; empty before it has told.
        progress: Share of that phase done, 0 to 1; 1 when the job has succeeded.
        run: The run folder that it works for.
        capture: Id of the capture whose pictures it trains on, None when it trains on none.
        error: What went wrong, None when nothing did.
        created_at: When it was handed in, aware UTC.
        updated_at: When anything here last changed.
        result: What the worker said at its end, None before.
    """

    id: str
    spec: JobSpec
    state: JobState
    phase: str
    progress: float
    run: str
    capture: str | None
    error: str | None
    created_at: datetime
    updated_at: datetime
    result: dict[str, Any] | None = None

    @property
    def kind(self) -> Kind:
        """Which program of the worker runs it."""
        return self.spec.kind

    @property
    def over(self) -> bool:
        """True once it neither runs nor waits."""
        return self.state not in ("queued", "running")


class JobBook:
    """Runs jobs by a runner and remembers them; a ``JobRunner``. All on the event loop.

    Attributes:
        on_end: Called with the record of every job that has ended.
    """

    def __init__(self, runner: JobRunner) -> None:
        self.on_end: Callable[[JobRecord], None] | None = None
        self._runner = runner
        self._records: dict[str, JobRecord] = {}
        self._jobs: dict[str, Job] = {}
        self._cancelled: set[str] = set()
        self._waiting: dict[str, asyncio.Task[None]] = {}
        self._turn = asyncio.Lock()

    def jobs(self) -> list[JobRecord]:
        """Return all jobs that are kept, newest first."""
        return sorted(self._records.values(), key=lambda record: record.id, reverse=True)

    def at_work(self) -> frozenset[str]:
        """Return the ids of the runs that jobs which are not over work for or train on."""
        busy = [record for record in self._records.values() if not record.over]
        names = {Path(record.run).name for record in busy}
        return frozenset(names | {record.capture for record in busy if record.capture is not None})

    def trainings_on(self, capture_id: str) -> dict[str, JobRecord]:
        """Return the newest job of each training anew on a capture's pictures, by its run's id."""
        found: dict[str, JobRecord] = {}
        for job in self.jobs():
            run_id = Path(job.run).name
            # The capture's own training works for the capture's own run.
            if job.kind == "reconstruct" and job.capture == capture_id != run_id:
                found.setdefault(run_id, job)
        return found

    def ahead_of(self, job_id: str) -> int:
        """Return how many jobs that were asked for come before this one."""
        earlier = takewhile(lambda other: other != job_id, self._waiting)
        return sum(not self._records[other].over for other in earlier)

    def job(self, job_id: str) -> JobRecord:
        """Return one job; raises KeyError."""
        return self._records[job_id]

    async def submit(self, spec: JobSpec, folder: Path) -> Job:
        """Start ``spec`` in ``folder`` at once and return the running job."""
        return await self._start(self._enter(spec, _run_of(folder)), spec, folder)

    async def adopt(self, folder: Path) -> Job | None:
        """Return the job that an earlier console left in ``folder``, None when there is none."""
        try:
            spec = JobSpec.read(folder)
        except ValueError:
            return None  # Nothing was ever handed in here.
        job = await self._runner.adopt(folder)
        if job is None:
            return None
        job_id = self._enter(spec, _run_of(folder))
        self._jobs[job_id] = job
        self._change(job_id, state="running")
        return _Kept(self, job_id, job, folder)

    def request(self, spec: JobSpec, folder: Path, run: Path) -> JobRecord:
        """Have ``spec`` done in ``folder`` when its turn comes.

        Raises:
            ValueError: If too many wait already.
        """
        if len(self._waiting) >= _MOST_WAITING:
            raise ValueError(f"{_MOST_WAITING} jobs wait or run already")
        job_id = self._enter(spec, run)
        task = asyncio.create_task(self._work_off(job_id, spec, folder), name=f"job {job_id}")
        self._waiting[job_id] = task
        task.add_done_callback(lambda _: self._waiting.pop(job_id, None))
        return self._records[job_id]

    async def cancel(self, job_id: str) -> JobRecord:
        """End a job, if it is not over: ask, then TERM, then KILL; raises KeyError."""
        if not self._records[job_id].over:
            self._cancelled.add(job_id)
            job = self._jobs.get(job_id)
            if job is not None:
                await job.cancel()
            self._change(job_id, state="cancelled")
        return self._records[job_id]

    async def close(self) -> None:
        """End all jobs that were asked for; those of a mission are the mission's own to end."""
        tasks = list(self._waiting.values())
        # The one that runs comes last, or its end would let the next one begin.
        for job_id in reversed(list(self._waiting)):
            await self.cancel(job_id)
        await asyncio.gather(*tasks)

    async def _start(self, job_id: str, spec: JobSpec, folder: Path) -> _Kept:
        try:
            job = await self._runner.submit(spec, folder)
        except OSError as error:
            self._change(job_id, state="failed", error=str(error))
            raise
        self._jobs[job_id] = job
        self._change(job_id, state="running")
        return _Kept(self, job_id, job, folder)

    async def _work_off(self, job_id: str, spec: JobSpec, folder: Path) -> None:
        async with self._turn:
            record = self._records.get(job_id)
            if record is None or record.over:
                return  # It was cancelled while it waited.
            try:
                job = await self._start(job_id, spec, folder)
                async for _ in job.events():
                    pass
            except (JobFailedError, OSError) as error:
                logger.warning("job %s failed: %s", job_id, error)

    def note(self, job_id: str, event: dict[str, Any]) -> None:
        """Take down what a worker told."""
        match event:
            case {"event": "progressed", "stage": str(phase)}:
                total_s = event.get("seconds_total")
                share = min(1.0, event["seconds"] / total_s) if total_s else 0.0
                self._change(job_id, phase=phase, progress=share)
            case {"event": "progressed", "iteration": int(step), "iterations": int(steps)}:
                self._change(job_id, phase="anneal", progress=step / max(1, steps))
            case {"event": "done"}:
                result = {k: v for k, v in event.items() if k not in ("event", "at_s")}
                self._change(job_id, state="succeeded", progress=1.0, result=result)

    def note_failure(self, job_id: str, reason: str) -> None:
        """Take down that a worker failed, or was made to end."""
        self._change(job_id, state="failed", error=reason)

    def _enter(self, spec: JobSpec, run: Path) -> str:
        now = datetime.now(UTC)
        job_id = f"{now.strftime('%Y%m%d-%H%M%S-%f')}-{spec.kind}-{secrets.token_hex(2)}"
        dataset = spec.parameters.get("dataset")
        capture = None if dataset is None else Path(dataset).name
        self._records[job_id] = JobRecord(
            job_id, spec, "queued", "", 0.0, str(run), capture, None, now, now
        )
        for old in [r.id for r in self._records.values() if r.over][:-_MOST_KEPT]:
            del self._records[old]
        return job_id

    def _change(self, job_id: str, **changes: Any) -> None:
        before = self._records.get(job_id)
        if before is None or before.over:
            return  # A word that comes after the end changes nothing.
        if job_id in self._cancelled and changes.get("state") not in (None, "running"):
            changes = {"state": "cancelled"}
        record = replace(before, updated_at=datetime.now(UTC), **changes)
        self._records[job_id] = record
        if record.over:
            self._jobs.pop(job_id, None)
            self._cancelled.discard(job_id)
            if self.on_end is not None:
                self.on_end(record)


def _run_of(folder: Path) -> Path:
    """Return the run folder that a job's folder belongs to."""
    return folder.parent.parent if folder.parent.name == "jobs" else folder


def _leave_last_word(folder: Path, reason: str) -> None:
    """Say in a job's folder that it failed, where its worker could not: killed, or far away."""
    file = folder / EVENTS
    with contextlib.suppress(OSError):  # The folder went with its run, or the disk is full.
        told = file.read_bytes() if file.exists() else b""
        if b'"event": "failed"' not in told[told.rstrip().rfind(b"\n") + 1 :]:
            word = {"event": "failed", "error": reason, "bad_input": False}
            with file.open("ab") as stream:
                # A worker that was killed may have left half a line.
                gap = b"" if told.endswith(b"\n") or not told else b"\n"
                stream.write(gap + json.dumps(word).encode() + b"\n")


class _Kept:
    """A running job whose events are also taken down in the book; a ``Job``."""

    def __init__(self, book: JobBook, job_id: str, job: Job, folder: Path) -> None:
        self._book, self._id, self._job, self._folder = book, job_id, job, folder

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the worker's events; raises JobFailedError."""
        try:
            async for event in self._job.events():
                # Who follows the job may take the event apart.
                self._book.note(self._id, dict(event))
                yield event
        except JobFailedError as error:
            await asyncio.to_thread(_leave_last_word, self._folder, str(error))
            self._book.note_failure(self._id, str(error))
            raise

    async def cancel(self) -> None:
        """End the job; does nothing when it has already ended."""
        await self._book.cancel(self._id)
