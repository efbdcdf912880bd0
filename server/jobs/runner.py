"""Runs jobs as child processes of this machine.

Each worker gets its own process group, a nice value and a thread limit, so that it yields to
flight and a crash of it (a CUDA fault, no memory) reaches nobody else. Cancelling is cooperative
first: the file ``stop``, then SIGTERM, then SIGKILL to that group.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Protocol

from server.jobs.spec import JobSpec

logger = logging.getLogger(__name__)

_LINE_LIMIT = 1 << 20
_STOP_S = 5.0
_TERM_S = 5.0


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


class LocalJob:
    """A running worker process; a ``Job``.

    Attributes:
        folder: The job's folder, with ``spec.json``, ``events.jsonl`` and ``worker.log``.
    """

    def __init__(self, folder: Path, process: asyncio.subprocess.Process) -> None:
        self.folder = folder
        self._process = process

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the worker's events until it is done.

        Raises:
            JobFailedError: If the worker failed or died.
        """
        assert self._process.stdout is not None
        last: dict[str, Any] = {}
        async for line in self._process.stdout:
            try:
                last = json.loads(line)
            except json.JSONDecodeError:
                logger.warning("job %s printed a line that is not JSON", self.folder.name)
                continue
            if last.get("event") not in ("done", "failed"):
                yield last
        code = await self._process.wait()
        if last.get("event") == "done" and code == 0:
            yield last
            return
        reason = last.get("error") or f"the worker ended with exit code {code}"
        raise JobFailedError(reason, bad_input=bool(last.get("bad_input")))

    async def cancel(self) -> None:
        """End the worker: ask, then TERM, then KILL. Does nothing when it has already ended."""
        if self._process.returncode is not None:
            return
        (self.folder / "stop").touch()
        for wait_s, number in ((_STOP_S, signal.SIGTERM), (_TERM_S, signal.SIGKILL)):
            try:
                await asyncio.wait_for(self._process.wait(), wait_s)
                return
            except TimeoutError:
                self._signal(number)
        await self._process.wait()

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.killpg(self._process.pid, number)
        except ProcessLookupError:
            logger.debug("job %s ended before the signal", self.folder.name)


class LocalRunner:
    """Starts workers on this machine; a ``JobRunner``."""

    async def submit(self, spec: JobSpec, folder: Path) -> LocalJob:
        """Start ``spec`` in ``folder`` and return the running job."""
        spec.write(folder)
        (folder / "stop").unlink(missing_ok=True)
        threads = str(spec.threads)
        environment = os.environ | {
            "OMP_NUM_THREADS": threads,
            "MKL_NUM_THREADS": threads,
            "OPENBLAS_NUM_THREADS": threads,
            "PYTHONUNBUFFERED": "1",
        }
        with (folder / "worker.log").open("ab") as log:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                # A file of the folder we stand in must never shadow a module.
                "-P",
                "-m",
                "server.jobs.worker",
                str(folder),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                env=environment,
                limit=_LINE_LIMIT,
                # A group of its own, to be signalled as one and spared Ctrl-C, but no session of
                # its own: Linux weighs sessions against each other and nice values only within one.
                process_group=0,
            )
        logger.info("job %s started as process %d", folder.name, process.pid)
        return LocalJob(folder, process)
