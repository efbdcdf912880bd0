"""Runs jobs on a Ray cluster: the same worker, submitted and stopped by Ray's Jobs API.

The worker tells its progress by callback (``server.jobs.callback``); what the cluster says decides
only whether it is still there. ``submit`` waits for nothing, since drones may hover meanwhile: the
job begins when its events are asked for.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import shlex
import socket
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path

import httpx

from server.jobs.callback import CallbackServer
from server.jobs.config import RayConfig
from server.jobs.local import LocalRunner
from server.jobs.ray_api import RayApi
from server.jobs.ray_job import RayJob, Ticket
from server.jobs.runner import Job
from server.jobs.spec import EVENTS, STOP, VIEW, JobSpec

_TICKET = "ray.json"


class RayRunner:
    """Starts workers on a cluster; a ``JobRunner`` and an async context manager.

    Planning stays on this machine: a job takes seconds to begin there, and drones hover meanwhile.

    Args:
        config: The cluster.
        plan_too: Let the cluster plan, too, as sweeps want it.

    Raises:
        OSError: When it is entered, if the callback address cannot be had.
    """

    def __init__(self, config: RayConfig, *, plan_too: bool = False) -> None:
        self._config = config
        self._here = None if plan_too else LocalRunner()
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> RayRunner:
        config = self._config
        async with AsyncExitStack() as stack:
            http = await stack.enter_async_context(httpx.AsyncClient())
            self._api = RayApi(http, config.address)
            sock = stack.enter_context(
                socket.create_server((config.callback_host, config.callback_port))
            )
            self._callbacks = await stack.enter_async_context(CallbackServer(sock))
            host, port = sock.getsockname()[:2]
            self._url = (config.callback_url or f"http://{host}:{port}").rstrip("/")
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._stack.aclose()

    async def submit(self, spec: JobSpec, folder: Path) -> Job:
        """Return the job of ``spec`` in ``folder``; it begins when its events are asked for."""
        if spec.kind == "plan" and self._here is not None:
            return await self._here.submit(spec, folder)
        spec = replace(spec, threads=self._config.cpus, niceness=0)
        spec.write(folder)
        for left in (STOP, EVENTS, VIEW):
            (folder / left).unlink(missing_ok=True)
        words = re.sub(r"[^A-Za-z0-9]+", "-", f"{folder.parent.parent.name}-{spec.kind}").strip("-")
        ticket = Ticket(f"dronerf-{words}-{secrets.token_hex(4)}", secrets.token_urlsafe(24))
        _keep(folder / _TICKET, ticket)
        return self._job(spec, folder, ticket, submitted=False)

    async def adopt(self, folder: Path) -> Job | None:
        """Return the job that an earlier console submitted from ``folder``, None without one."""
        try:
            ticket = Ticket(**json.loads((folder / _TICKET).read_text()))
            spec = JobSpec.read(folder)
        except (OSError, TypeError, ValueError):
            return None if self._here is None else await self._here.adopt(folder)
        job = self._job(spec, folder, ticket, submitted=True)
        return job if await job.worth_following() else None

    def entrypoint(self, place: str) -> str:
        """Return the command that runs the job at ``place`` on a node."""
        return shlex.join([self._config.python, "-P", "-m", "server.jobs.remote", place])

    def _job(self, spec: JobSpec, folder: Path, ticket: Ticket, *, submitted: bool) -> RayJob:
        threads = str(spec.threads)
        store = self._config.store
        place = None if store is None else f"{store.rstrip('/')}/{ticket.job}"
        return RayJob(
            spec,
            folder,
            ticket,
            self._api,
            self._callbacks,
            entrypoint=self.entrypoint(place or str(folder.resolve())),
            variables={
                "DRONERF_JOB_CALLBACK": f"{self._url}/jobs/{ticket.job}/events",
                "DRONERF_JOB_TOKEN": ticket.token,
                "OMP_NUM_THREADS": threads,
                "MKL_NUM_THREADS": threads,
                "OPENBLAS_NUM_THREADS": threads,
            },
            place=place,
            config=self._config,
            submitted=submitted,
        )


def _keep(path: Path, ticket: Ticket) -> None:
    """Write a ticket, readable by its owner alone: it holds a secret."""
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    with os.fdopen(file, "w") as stream:
        json.dump({"job": ticket.job, "token": ticket.token}, stream)
