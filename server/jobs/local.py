"""Runs jobs as child processes of this machine.

Each worker gets its own process group, a nice value and a thread limit, so that it yields to
flight and a crash of it (a CUDA fault, no memory) reaches nobody else.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from pathlib import Path

from server.jobs.local_job import AdoptedJob, LocalJob, left_behind
from server.jobs.spec import EVENTS, STOP, VIEW, JobSpec

logger = logging.getLogger(__name__)

_LINE_LIMIT = 1 << 20


class LocalRunner:
    """Starts workers on this machine; a ``JobRunner``."""

    async def submit(self, spec: JobSpec, folder: Path) -> LocalJob:
        """Start ``spec`` in ``folder`` and return the running job."""
        spec.write(folder)
        for left in (STOP, EVENTS, VIEW):
            (folder / left).unlink(missing_ok=True)
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

    async def adopt(self, folder: Path) -> AdoptedJob | None:
        """Return the job that an earlier console left in ``folder``, None when there is none."""
        return await asyncio.to_thread(left_behind, folder)
