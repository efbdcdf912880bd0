"""The log of a service: one JSON object a line on stderr, written by a thread of its own.

``request_id`` in a line names the request that led to it, see ``server.api.request_ids``.
"""

from __future__ import annotations

import json
import logging
import logging.handlers
import queue
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import IO

from server.api.request_ids import REQUEST_ID

# So many lines wait for a slow reader; then new ones are dropped, and counted in the next that is
# not: no flight waits for its log.
_QUEUE = 10_000
_PLAIN = frozenset({*vars(logging.makeLogRecord({})), "message", "asctime", "taskName"})
_CHATTY = ("httpx", "httpcore", "alembic")


class JsonLines(logging.Formatter):
    """Formats a record as one line of JSON; what was given as ``extra`` becomes fields."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        line: dict[str, object] = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        extra = {name: value for name, value in vars(record).items() if name not in _PLAIN}
        line |= {name: value for name, value in extra.items() if value is not None}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class _Hand(logging.handlers.QueueHandler):
    """Hands records to the writing thread and never waits."""

    def __init__(self, waiting: queue.Queue[logging.LogRecord], form: logging.Formatter) -> None:
        super().__init__(waiting)
        self.setFormatter(form)
        self._dropped = 0

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        """Return a record that says all: its arguments, and the request, may be gone later."""
        record.request_id = REQUEST_ID.get()
        record.dropped = self._dropped or None
        # Formatted here, where a traceback's objects still are as they were.
        return logging.makeLogRecord({"msg": self.format(record)})

    def enqueue(self, record: logging.LogRecord) -> None:
        """Queue a record, or count it as dropped."""
        try:
            self.queue.put_nowait(record)
            self._dropped = 0
        except queue.Full:
            self._dropped += 1


@contextmanager
def json_log(level: int, stream: IO[str] = sys.stderr) -> Iterator[None]:
    """Write the program's log as JSON lines to ``stream`` until the ``with`` block ends."""
    root = logging.getLogger()
    before, level_before = root.handlers[:], root.level
    waiting: queue.Queue[logging.LogRecord] = queue.Queue(_QUEUE)
    writer = logging.handlers.QueueListener(waiting, logging.StreamHandler(stream))
    writer.start()
    root.handlers[:] = [_Hand(waiting, JsonLines())]
    root.setLevel(level)
    for name in _CHATTY:
        logging.getLogger(name).setLevel(logging.WARNING)
    try:
        yield
    finally:
        root.handlers[:] = before
        root.setLevel(level_before)
        writer.stop()
