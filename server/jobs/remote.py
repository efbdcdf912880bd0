"""The worker on another machine: ``python -m server.jobs.remote FOLDER``, as a Ray job starts it.

It runs the same programs as ``server.jobs.worker``. FOLDER is the job's folder where console and
node share their files; else it is the fsspec URL of the job's place in a store, and pictures and
results travel through that. Events go to the console at ``DRONERF_JOB_CALLBACK`` with the token
``DRONERF_JOB_TOKEN``; a console that is away for a while ends nothing.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx

from server.jobs.heartbeat import Heartbeat
from server.jobs.spec import EVENTS, JobSpec
from server.jobs.staging import Staging
from server.jobs.worker import Reporter, work

logger = logging.getLogger(__name__)

_TELL_S = 1.0
_PUSH_S = 30.0
_TIMEOUT_S = 10.0
_KEPT = 2000
# The last word also lies in the folder: nobody waits for it long.
_LAST_TRIES = 5
# Whoever was silent for so long is gone; a training goes on, waiting for pictures does not.
_GONE_S = 120.0


class CallbackReporter(Reporter):
    """Tells the console over HTTP, and the folder.

    Args:
        folder: The job's folder.
        url: Where to post events.
        token: The job's own.
        before: Called before an event with a file is told, to send the file ahead.
    """

    def __init__(
        self, folder: Path, url: str, token: str, before: Callable[[], None] | None = None
    ) -> None:
        super().__init__(folder, attached=False)
        headers = {"Authorization": f"Bearer {token}"}
        self._http = httpx.Client(headers=headers, timeout=_TIMEOUT_S)
        self._url = url
        self._before = before
        self._untold: list[dict[str, Any]] = []
        self._first = 0
        self._lock = threading.Lock()
        self._stop = False
        self._answered_s = time.monotonic()
        threading.Thread(target=self._keep_telling, name="callback", daemon=True).start()

    def emit(self, event: str, **fields: Any) -> None:
        """Keep one event and have it told soon."""
        if "file" in fields and self._before is not None:
            self._before()
        super().emit(event, **fields)
        with self._lock:
            self._untold.append({"event": event, "at_s": time.time()} | fields)
            if len(self._untold) > _KEPT:
                # The console is away; the oldest news is worth least.
                del self._untold[0]
                self._first += 1

    def orphaned(self) -> bool:
        """Return whether the console has not answered for long."""
        return time.monotonic() - self._answered_s > _GONE_S

    def should_stop(self) -> bool:
        """Return True once the console, the folder or the cluster asked for the end."""
        return self._stop or super().should_stop()

    def unwanted(self) -> bool:
        """Ask the console; returns whether the job was cancelled before it began."""
        self._tell()
        return self.should_stop()

    def tell_all(self) -> None:
        """Tell what is left; gives up after some tries."""
        for _ in range(_LAST_TRIES):
            if self._tell():
                return
            time.sleep(_TELL_S)

    def _keep_telling(self) -> None:
        while True:
            time.sleep(_TELL_S)
            self._tell()

    def _tell(self) -> bool:
        with self._lock:
            first, told = self._first, list(self._untold)
        try:
            answer = self._http.post(self._url, json={"first": first, "events": told})
            if answer.status_code == httpx.codes.GONE:
                self._stop = True
            answer.raise_for_status()
            self._stop = self._stop or answer.json()["stop"] is True
        except (httpx.HTTPError, ValueError, KeyError, TypeError) as error:
            logger.warning("the console cannot be told: %s", error)
            return False
        self._answered_s = time.monotonic()
        with self._lock:
            # Others may have come, and old ones gone, meanwhile.
            del self._untold[: max(0, first + len(told) - self._first)]
            self._first = max(self._first, first + len(told))
        return True


def main() -> int:
    """Run the job at the place given as the only argument."""
    if len(sys.argv) != 2:
        sys.exit("usage: python -m server.jobs.remote FOLDER")
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    logging.getLogger("httpx").setLevel(logging.WARNING)
    place = sys.argv[1]
    url, token = os.environ["DRONERF_JOB_CALLBACK"], os.environ["DRONERF_JOB_TOKEN"]
    if "://" in place:
        with tempfile.TemporaryDirectory(prefix="dronerf-job-") as folder:
            return _from_store(place, Path(folder), url, token)
    folder = Path(place)
    reporter = CallbackReporter(folder, url, token)
    if reporter.unwanted():
        return 1
    Heartbeat(folder)
    code = work(JobSpec.read(folder), reporter)
    reporter.tell_all()
    return code


def _from_store(place: str, folder: Path, url: str, token: str) -> int:
    """Fetch the job's files, work on them here, and send back what came of it."""
    Staging(f"{place}/in").pull(folder)
    run = folder / "run"
    outgoing = Staging(f"{place}/out")
    outgoing.skip(run)
    sending = threading.Lock()

    def push() -> None:
        with sending:
            outgoing.push(run)

    def keep_pushing() -> None:
        # What a training keeps must outlive this machine.
        while True:
            time.sleep(_PUSH_S)
            try:
                push()
            except OSError as error:
                logger.warning("the store cannot be written: %s", error)

    threading.Thread(target=keep_pushing, name="store", daemon=True).start()
    spec = JobSpec.read(folder)
    here = {"dataset": str(run), "out": str(run)}
    spec = replace(spec, parameters=spec.parameters | here)
    reporter = CallbackReporter(folder, url, token, push)
    if reporter.unwanted():
        return 1
    code = work(spec, reporter)
    run.mkdir(exist_ok=True)  # A plan makes none.
    (run / EVENTS).write_text((folder / EVENTS).read_text())
    push()
    reporter.tell_all()
    return code


def last_word(events: Path) -> dict[str, Any] | None:
    """Return the event that ended a job, as its folder has it; None when there is none."""
    try:
        lines = events.read_text().splitlines()
        last = json.loads(lines[-1])
    except (OSError, ValueError, IndexError):
        return None
    return last if isinstance(last, dict) and last.get("event") in ("done", "failed") else None


if __name__ == "__main__":
    sys.exit(main())
