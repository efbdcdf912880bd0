"""Workers on this machine: followed by the console that started them, or by the next one.

Both are ended in the same way: the file ``stop`` asks, SIGTERM insists, SIGKILL ends the process
group.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import signal
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

from server.jobs.heartbeat import Listener, worker_in
from server.jobs.runner import JobFailedError
from server.jobs.spec import EVENTS, STOP

logger = logging.getLogger(__name__)

_STOP_S = 5.0
_TERM_S = 5.0
_LOOK_S = 2.0
_POLL_S = 0.2
# A worker that beats no more for so long has been stopped, or waits for a disk that is gone.
_SILENCE_S = 60.0


class LocalJob:
    """A running worker process that we started; a ``Job``.

    Attributes:
        folder: The job's folder, with ``spec.json``, ``events.jsonl`` and ``worker.log``.
    """

    def __init__(
        self, folder: Path, process: asyncio.subprocess.Process, silence_s: float = _SILENCE_S
    ) -> None:
        self.folder = folder
        self._process = process
        self._silence_s = silence_s

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the worker's events until it is done.

        Raises:
            JobFailedError: If the worker failed, died or fell silent.
        """
        assert self._process.stdout is not None
        listener = Listener(self.folder, _now_s())
        last: dict[str, Any] = {}
        while True:
            try:
                line = await asyncio.wait_for(
                    self._process.stdout.readline(), min(_LOOK_S, self._silence_s)
                )
            except TimeoutError:
                # Its own thread: a disk that hangs must not hold up the event loop.
                silent_s = await asyncio.to_thread(listener.silent_s, _now_s())
                if silent_s >= self._silence_s:
                    _signal(self._process.pid, signal.SIGKILL)
                    await self._process.wait()
                    raise JobFailedError(f"the worker was silent for {silent_s:.0f} s") from None
                continue
            if not line:
                break
            if (event := _parsed(line, self.folder)) is not None:
                last = event
                if event.get("event") not in ("done", "failed"):
                    yield event
        code = await self._process.wait()
        if last.get("event") == "done" and code == 0:
            yield last
            return
        raise _failure(last, f"the worker ended with exit code {code}")

    async def cancel(self) -> None:
        """End the worker: ask, then TERM, then KILL. Does nothing when it has already ended."""
        if self._process.returncode is None:
            await _end(self.folder, self._process.pid, self._process.wait)


class AdoptedJob:
    """A worker that an earlier console started; a ``Job``. It may have ended meanwhile.

    Of what it told before, the newest event of each kind is told again.

    Attributes:
        folder: The job's folder.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    async def events(self) -> AsyncIterator[dict[str, Any]]:
        """Yield the worker's events until it is done; raises JobFailedError as ``LocalJob`` does.

        A worker that is stopped is not ended here: it is nobody's child.
        """
        last: dict[str, Any] = {}
        place, first = 0, True
        while True:
            # Asked before reading: what is read after the end is all there will be.
            ended = await asyncio.to_thread(worker_in, self.folder) is None
            lines, place = await asyncio.to_thread(_lines_from, self.folder / EVENTS, place)
            told = [event for line in lines if (event := _parsed(line, self.folder)) is not None]
            if first:
                told = list({event["event"]: event for event in told}.values())
            for event in told:
                last = event
                if event["event"] not in ("done", "failed"):
                    yield event
            if ended:
                break
            first = False
            await asyncio.sleep(_POLL_S)
        if last.get("event") != "done":
            raise _failure(last, "the worker ended without a word")
        yield last

    async def cancel(self) -> None:
        """End the worker: ask, then TERM, then KILL. Does nothing when it has already ended."""
        number = await asyncio.to_thread(worker_in, self.folder)
        if number is not None:
            await _end(self.folder, number, self._gone)

    async def _gone(self) -> None:
        # It is nobody's child, so nothing tells of its end.
        while await asyncio.to_thread(worker_in, self.folder) is not None:  # noqa: ASYNC110
            await asyncio.sleep(_POLL_S)


def left_behind(folder: Path) -> AdoptedJob | None:
    """Return the job of an earlier console in ``folder``, None without one worth following.

    That is a worker at work, or one that was done while nobody followed it.
    """
    if worker_in(folder) is None:
        lines, _ = _lines_from(folder / EVENTS, 0)
        last = _parsed(lines[-1], folder) if lines else None
        if last is None or last["event"] != "done":
            return None
    return AdoptedJob(folder)


async def _end(folder: Path, number: int, gone: Callable[[], Awaitable[object]]) -> None:
    (folder / STOP).touch()
    for wait_s, escalation in ((_STOP_S, signal.SIGTERM), (_TERM_S, signal.SIGKILL)):
        try:
            await asyncio.wait_for(gone(), wait_s)
            return
        except TimeoutError:
            _signal(number, escalation)
    await gone()


def _signal(number: int, escalation: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError):  # It ended before the signal.
        os.killpg(number, escalation)


def _lines_from(path: Path, place: int) -> tuple[list[bytes], int]:
    """Return the whole lines of a file from byte ``place`` on, and where they end."""
    try:
        with path.open("rb") as stream:
            stream.seek(place)
            content = stream.read()
    except OSError:
        return [], place
    whole = content.rfind(b"\n") + 1
    return content[:whole].splitlines(), place + whole


def _parsed(line: bytes, folder: Path) -> dict[str, Any] | None:
    with contextlib.suppress(ValueError):
        event = json.loads(line)
        if isinstance(event, dict) and "event" in event:
            return event
    logger.warning("job %s told a line that is no event", folder.name)
    return None


def _failure(last: dict[str, Any], otherwise: str) -> JobFailedError:
    return JobFailedError(last.get("error") or otherwise, bad_input=bool(last.get("bad_input")))


def _now_s() -> float:
    return asyncio.get_running_loop().time()
