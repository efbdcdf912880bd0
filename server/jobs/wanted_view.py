"""Where somebody wants to see a field from while it is trained: the file ``view.json`` of its job.

The console writes what was asked for last, the worker looks for it between two steps; what was
asked for in between is nobody's wish any more. An empty object asks for the orbit again.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from server.drafts import drafted
from server.jobs.spec import VIEW
from server.nerf.orbit_view import OrbitView


def want_view(folder: Path, view: OrbitView | None) -> None:
    """Ask the worker in the job's ``folder`` for previews from ``view``, None: from the orbit.

    Raises:
        OSError: If it cannot be written.
    """
    with drafted(folder / VIEW) as draft:
        draft.write_text(json.dumps({} if view is None else asdict(view)))


class WantedView:
    """The worker's side.

    Attributes:
        view: Where to look from, None for the orbit.
    """

    def __init__(self, folder: Path) -> None:
        self.view: OrbitView | None = None
        self._file = folder / VIEW
        self._read: tuple[int, int] | None = None

    def changed(self) -> bool:
        """Look whether something else is wanted; what is no view changes nothing."""
        try:
            stat = self._file.stat()
            # A file that was replaced is another one, however fast that went.
            seen = (stat.st_mtime_ns, stat.st_ino)
            if seen == self._read:
                return False
            self._read = seen
            told = json.loads(self._file.read_bytes())
            view = OrbitView(**told) if told else None
        except (OSError, ValueError, TypeError):
            return False
        before, self.view = self.view, view
        return view != before
