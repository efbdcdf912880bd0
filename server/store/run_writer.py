"""Writes a run's record and log in a thread, so that a slow disk never holds up the event loop."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from server.store.runs import RunFolder

logger = logging.getLogger(__name__)


class RunWriter:
    """Puts ``capture.json`` and ``log.jsonl`` of one run on disk; lives on the event loop.

    At most one writing is under way. What comes meanwhile waits for it: of the record only the
    newest, of the log every line. What cannot be written is told in the program's log and nowhere
    else: a flight matters more than its record, and the next writing may succeed.
    """

    def __init__(self, run: RunFolder) -> None:
        self._run = run
        self._state: dict[str, Any] | None = None
        self._lines: list[dict[str, Any]] = []
        self._writing: asyncio.Task[None] | None = None

    def write_state(self, state: dict[str, Any]) -> None:
        """Replace ``capture.json`` soon; ``state`` must not change afterwards."""
        self._state = state
        self._begin()

    def log(self, fields: dict[str, Any]) -> None:
        """Append one line to ``log.jsonl`` soon."""
        self._lines.append(fields)
        self._begin()

    async def settled(self, timeout_s: float) -> None:
        """Wait until everything is on disk, but no longer than ``timeout_s``."""
        if self._writing is not None:
            await asyncio.wait([self._writing], timeout=timeout_s)

    def _begin(self) -> None:
        if self._writing is None or self._writing.done():
            self._writing = asyncio.create_task(self._write_all(), name=f"write {self._run.id}")

    async def _write_all(self) -> None:
        loop = asyncio.get_running_loop()
        while self._state is not None or self._lines:
            state, self._state = self._state, None
            lines, self._lines = self._lines, []
            try:
                await loop.run_in_executor(None, self._write, state, lines)
            except OSError:
                logger.exception("the record of %s could not be written", self._run.path)

    def _write(self, state: dict[str, Any] | None, lines: list[dict[str, Any]]) -> None:
        try:
            self._run.log(lines)
        finally:
            if state is not None:
                self._run.write_state(state)
