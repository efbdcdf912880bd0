"""A client of Ray's Jobs API over HTTP; the console needs no Ray for it.

https://docs.ray.io/en/latest/cluster/running-applications/job-submission/rest.html
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import httpx

_TIMEOUT_S = 15.0
ENDED = frozenset({"STOPPED", "SUCCEEDED", "FAILED"})


class RayError(Exception):
    """The cluster cannot be reached or refuses; the text says which."""


@dataclass(frozen=True, slots=True)
class RayJobStatus:
    """What the cluster says about a job.

    Attributes:
        status: PENDING, RUNNING, or one of ``ENDED``.
        message: Its words about it.
    """

    status: str
    message: str

    @property
    def ended(self) -> bool:
        """True when nothing follows."""
        return self.status in ENDED


class RayApi:
    """The few calls that running jobs needs.

    Args:
        http: A client; whoever made it closes it.
        address: The cluster's address, ``http://HOST:8265``.
    """

    def __init__(self, http: httpx.AsyncClient, address: str) -> None:
        self._http = http
        self._address = address.rstrip("/")

    async def submit(
        self, job: str, entrypoint: str, variables: dict[str, str], *, cpus: float, gpus: float
    ) -> None:
        """Queue a job under the name ``job``.

        Submitting the same name again is no error: the answer to the first time may have been lost.

        Raises:
            RayError: If the cluster refuses or cannot be reached.
        """
        wanted = {
            "submission_id": job,
            "entrypoint": entrypoint,
            "entrypoint_num_cpus": cpus,
            "entrypoint_num_gpus": gpus,
            "runtime_env": {"env_vars": variables},
        }
        try:
            await self._ask("POST", "/api/jobs/", json=wanted)
        except RayError:
            if await self.status(job) is None:
                raise

    async def status(self, job: str) -> RayJobStatus | None:
        """Return what the cluster knows of a job, None when it knows none; raises RayError."""
        answer = await self._ask("GET", f"/api/jobs/{job}", missing=True)
        if answer is None:
            return None
        return RayJobStatus(str(answer.get("status")), str(answer.get("message") or ""))

    async def stop(self, job: str) -> None:
        """End a job: SIGTERM, then SIGKILL; nothing for one that has ended; raises RayError."""
        await self._ask("POST", f"/api/jobs/{job}/stop", missing=True)

    async def _ask(
        self, method: str, path: str, *, json: Any = None, missing: bool = False
    ) -> dict[str, Any] | None:
        try:
            answer = await self._http.request(
                method, f"{self._address}{path}", json=json, timeout=_TIMEOUT_S
            )
        except httpx.HTTPError as error:
            reason = str(error) or type(error).__name__
            raise RayError(f"Ray at {self._address} cannot be reached: {reason}") from error
        if missing and answer.status_code == httpx.codes.NOT_FOUND:
            return None
        if answer.is_error:
            words = answer.text.strip().splitlines() or [answer.reason_phrase]
            raise RayError(f"Ray at {self._address} says {answer.status_code}: {words[-1]}")
        try:
            told = answer.json()
        except ValueError as error:
            raise RayError(f"{self._address} does not answer as Ray does") from error
        if not isinstance(told, dict):
            raise RayError(f"{self._address} does not answer as Ray does")
        return told
