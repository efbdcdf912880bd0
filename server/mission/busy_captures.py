"""The captures whose run folders are being changed as a whole: scaled, deleted or taken up again.

Each of these takes seconds and must have the capture, and the trainings on it, for itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from server.mission.commands import RefusedError


class BusyCaptures:
    """Who changes which capture at the moment. All on the event loop."""

    def __init__(self) -> None:
        self._busy: dict[str, str] = {}

    def ids(self) -> frozenset[str]:
        """Return the captures that are being changed."""
        return frozenset(self._busy)

    def refuse(self, capture_id: str) -> None:
        """Raise RefusedError while a capture is being changed."""
        if capture_id in self._busy:
            raise RefusedError(f"{capture_id} {self._busy[capture_id]}; wait until that is done")

    @contextmanager
    def hold(self, capture_id: str, doing: str) -> Iterator[None]:
        """Have a capture for oneself within the ``with`` block.

        Args:
            capture_id: The capture.
            doing: What is done to it, as others are told: ``is being scaled``.

        Raises:
            RefusedError: If it is being changed already.
        """
        self.refuse(capture_id)
        self._busy[capture_id] = doing
        try:
            yield
        finally:
            del self._busy[capture_id]
