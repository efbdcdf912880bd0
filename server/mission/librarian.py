"""Keeps the catalogue in step with the captures of a running console, and the runs within bounds.

The catalogue is an index over the run folders: while its database is away captures go on, and what
was missed is found in the folders afterwards.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from sqlalchemy.exc import SQLAlchemyError

from server.mission.events import CaptureChanged, EventStream
from server.store.catalogue import Catalogue
from server.store.config import RetentionConfig

logger = logging.getLogger(__name__)

_ENDED = ("succeeded", "failed", "aborted", "interrupted")
_AGAIN_S = 60.0


class Librarian:
    """Enters every capture that ends, and deletes what retention does not keep.

    Args:
        runs: Folder of the run folders.
        url: Database of the catalogue, None for SQLite in ``runs``.
        retention: When old runs are deleted.
        events: Tells when a capture ends.
        live: Returns the runs somebody works on.
        forget: Told which captures are gone.
    """

    def __init__(
        self,
        runs: Path,
        url: str | None,
        retention: RetentionConfig,
        events: EventStream,
        live: Callable[[], frozenset[str]],
        forget: Callable[[str], None],
    ) -> None:
        self._runs = runs
        self._url = url
        self._retention = retention
        self._events = events
        self._live = live
        self._forget = forget

    async def run(self) -> None:
        """Work until cancelled: at once, and whenever a capture has ended."""
        due = asyncio.Event()
        due.set()
        watching = asyncio.create_task(self._watch(due), name="librarian's news")
        try:
            while True:
                await due.wait()
                due.clear()
                try:
                    gone = await asyncio.to_thread(self._tidy, self._live())
                except (OSError, SQLAlchemyError) as error:
                    # SQLAlchemy's text goes on with the statement; the database's own words do not.
                    logger.warning("the catalogue is not up to date: %s", _words(error))
                    await asyncio.sleep(_AGAIN_S)
                    due.set()
                    continue
                for capture_id in gone:
                    self._forget(capture_id)
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)

    async def _watch(self, due: asyncio.Event) -> None:
        with self._events.subscribe() as news:
            async for event in news:
                if isinstance(event, CaptureChanged) and event.state in _ENDED:
                    due.set()

    def _tidy(self, live: frozenset[str]) -> list[str]:
        with Catalogue(self._runs, self._url) as catalogue:
            catalogue.rescan()
            bounded = self._retention.quota_bytes, self._retention.keep_days
            if bounded == (None, None):
                return []
            return catalogue.retain(self._retention, live)


@contextlib.asynccontextmanager
async def at_work(librarian: Librarian) -> AsyncIterator[None]:
    """Let a librarian work beside the console until the ``with`` block ends."""
    task = asyncio.create_task(librarian.run(), name="librarian")
    task.add_done_callback(_tell_failure)
    try:
        yield
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def _tell_failure(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and task.exception() is not None:
        # Nothing flies by it: the console goes on, and a rescan puts the catalogue right.
        logger.error("the librarian has gone", exc_info=task.exception())


def _words(error: Exception) -> str:
    lines = str(getattr(error, "orig", error)).strip().splitlines()
    return lines[0] if lines else type(error).__name__
