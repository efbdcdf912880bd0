"""One job on a Ray cluster, from its submission to its results."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from server.drafts import drafted
from server.jobs.callback import CallbackServer, Channel
from server.jobs.config import RayConfig
from server.jobs.ray_api import RayApi, RayError
from server.jobs.remote import last_word
from server.jobs.runner import JobFailedError
from server.jobs.spec import EVENTS, STOP, JobSpec
from server.jobs.staging import Staging
from server.jobs.unfinished import WANTED

logger = logging.getLogger(__name__)

_LOOK_S = 2.0
_POLL_S = 0.5
_STOP_S = 10.0
_SPEC = "spec.json"


@dataclass(frozen=True, slots=True)
class Ticket:
    """What a console needs to know a job again.

    Attributes:
        job: Its name on the cluster.
        token: What its worker shows when it tells something.
    """

    job: str
    token: str


class RayJob:
    """A job that a cluster runs; a ``Job``.

    Attributes:
        folder: The job's folder.
    """

    def __init__(
        self,
        spec: JobSpec,
        folder: Path,
        ticket: Ticket,
        api: RayApi,
        callbacks: CallbackServer,
        *,
        entrypoint: str,
        variables: dict[str, str],
        place: str | None,
        config: RayConfig,
        submitted: bool,
    ) -> None:
        """Build it.

        Args:
            spec: What is to be done.
            folder: The job's folder.
            ticket: Its name and token.
            api: The cluster.
            callbacks: Hears the worker.
            entrypoint: The command to run there.
            variables: That command's environment.
            place: Its place in the store, None where nodes see our files.
            config: Processors, GPUs and patience.
            submitted: An earlier console has submitted it.
        """
        self.folder = folder
        self._spec = spec
        self._ticket = ticket
        self._api = api
        self._callbacks = callbacks
        self._entrypoint = entrypoint
        self._variables = variables
        self._place = place
        self._config = config
        self._submitted = submitted
        self._cancelled = asyncio.Event()
        self._over = asyncio.Event()
        self._ended = False
        self._given_up = False

    async def worth_following(self) -> bool:
        """Return whether the job goes on, or was done while nobody followed it."""
        with contextlib.suppress(RayError):
            found = await self._api.status(self._ticket.job)
            return found is not None and (not found.ended or found.status == "SUCCEEDED")
        return False

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the worker's events until it is done.

        Raises:
            JobFailedError: If the worker failed, or the cluster did.
        """
        last: dict[str, Any] = {}
        try:
            with self._callbacks.channel(self._ticket.job, self._ticket.token) as channel:
                if not self._submitted:
                    await self._submit()
                    channel.take(0, [])  # Its patience begins now.
                async for event in self._heard(channel):
                    last = event
                    self._ended = event["event"] in ("done", "failed")
                    if not self._ended:
                        if "file" in event and self._place is not None:
                            await self._fetch(str(event["file"]))
                        yield event
            if not self._ended:  # The cluster says so, and the worker's last word was not heard.
                self._ended = True
                last = await asyncio.to_thread(self._last_word) or last
            await asyncio.to_thread(self._bring_home)
        except RayError as error:
            raise JobFailedError(str(error)) from error
        except OSError as error:
            raise JobFailedError(f"the store cannot be used: {error}") from error
        finally:
            self._over.set()
        if last.get("event") != "done":
            reason = last.get("error") or "the worker ended without a word"
            raise JobFailedError(reason, bad_input=bool(last.get("bad_input")))
        yield last | self._own_paths() if self._place is not None else last

    async def cancel(self) -> None:
        """End the job, queued or running: ask, then have it killed. Nothing if it has ended."""
        self._cancelled.set()
        if self._ended or not self._submitted:
            return
        (self.folder / STOP).touch()
        with contextlib.suppress(RayError):
            found = await self._api.status(self._ticket.job)
            if found is None or found.ended:
                return
            if found.status == "RUNNING" and await self._is_over():
                return
            # A queued one Ray stops only once it has begun; whoever follows it need not wait.
            self._given_up = found.status == "PENDING"
            self._callbacks.dismiss(self._ticket.job)
            await self._api.stop(self._ticket.job)
        await self._is_over()

    async def _is_over(self) -> bool:
        """Wait a little until whoever follows the job has seen its end; nobody may follow it."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._over.wait(), _STOP_S)
        return self._ended

    # -- the way there and back ---------------------------------------------------------------

    async def _submit(self) -> None:
        if self._place is not None:
            await self._until_complete()
            await asyncio.to_thread(self._send)
        if self._cancelled.is_set():
            raise JobFailedError("stopped before it began")
        self._submitted = True
        await self._api.submit(
            self._ticket.job,
            self._entrypoint,
            self._variables,
            cpus=self._config.cpus,
            gpus=self._config.gpus,
        )
        logger.info("job %s submitted as %s", self.folder.name, self._ticket.job)

    async def _until_complete(self) -> None:
        """Wait until the pictures of a flight are all there: the store has them only once."""
        parameters = self._spec.parameters
        if parameters.get("source") != "flight" or parameters.get("resume"):
            return
        record = Path(parameters["dataset"]) / "capture.json"
        while not self._cancelled.is_set():
            with contextlib.suppress(OSError, ValueError, KeyError):
                if json.loads(await asyncio.to_thread(record.read_text))["complete"]:
                    return
            await asyncio.sleep(_POLL_S)

    def _send(self) -> None:
        incoming = Staging(f"{self._place}/in")
        parameters = self._spec.parameters
        incoming.push_file(self.folder / _SPEC, _SPEC)
        if "dataset" in parameters:
            incoming.push(Path(parameters["dataset"]), "run")
            out = self._out()
            if parameters.get("resume") and out.is_dir():
                incoming.push(out, "run")

    async def _fetch(self, name: str) -> None:
        with contextlib.suppress(OSError):  # A preview is no reason to end a training.
            await asyncio.to_thread(Staging(f"{self._place}/out").pull, self._out(), name)

    def _bring_home(self) -> None:
        """Fetch the results, tell them where they are now, and clear the store."""
        if self._place is None:
            return
        if "dataset" in self._spec.parameters:
            out = self._out()
            Staging(f"{self._place}/out").pull(out)
            (out / EVENTS).unlink(missing_ok=True)
            paths = self._own_paths()
            _amend(out / "metrics.json", lambda told: told | paths)
            here = {"dataset": paths["dataset"], "out": self._spec.parameters.get("out")}
            _amend(out / WANTED, lambda told: told | {"parameters": told["parameters"] | here})
        Staging(self._place).clear()

    def _last_word(self) -> dict[str, Any] | None:
        if self._place is None:
            return last_word(self.folder / EVENTS)
        with contextlib.suppress(OSError):
            Staging(f"{self._place}/out").pull(self.folder, EVENTS)
        return last_word(self.folder / EVENTS)

    def _out(self) -> Path:
        parameters = self._spec.parameters
        return Path(parameters.get("out") or parameters["dataset"])

    def _own_paths(self) -> dict[str, str]:
        if "dataset" not in self._spec.parameters:
            return {}
        return {"run": str(self._out()), "dataset": str(self._spec.parameters["dataset"])}

    # -- meanwhile ----------------------------------------------------------------------------

    async def _heard(self, channel: Channel) -> AsyncIterator[dict[str, Any]]:
        """Yield what the worker tells until it or the cluster says that it is over."""
        loop = asyncio.get_running_loop()
        looked_s = answered_s = loop.time()
        while True:
            channel.stop = self._cancelled.is_set()
            event = await channel.next_event(_POLL_S)
            if event is not None:
                yield event
                if event["event"] in ("done", "failed"):
                    return
                continue
            if self._given_up:
                yield {"event": "failed", "error": "stopped before it began"}
                return
            if loop.time() - looked_s < _LOOK_S:
                continue
            looked_s = loop.time()
            try:
                found = await self._api.status(self._ticket.job)
            except RayError as error:
                silent_s = loop.time() - max(answered_s, channel.heard_s)
                if silent_s > self._config.silence_s:
                    raise RayError(
                        f"{error}; the worker was not heard for {silent_s:.0f} s"
                    ) from error
                continue
            answered_s = loop.time()
            if found is None:
                raise RayError("the cluster does not know the job any more")
            if found.ended:
                # Its last words may be on their way.
                while (event := await channel.next_event(_POLL_S)) is not None:
                    yield event
                if found.status != "SUCCEEDED":
                    yield {"event": "failed", "error": f"Ray: {found.message or found.status}"}
                return


def _amend(path: Path, change: Any) -> None:
    """Replace a JSON file by what ``change`` makes of it; a missing or strange one is left."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        text = json.dumps(change(json.loads(path.read_text())), indent=1)
        with drafted(path) as draft:
            draft.write_text(text)
