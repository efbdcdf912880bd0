"""Knows how much room the disk of the runs has, without ever waiting for it on the event loop."""

from __future__ import annotations

import asyncio
import math
import shutil
from pathlib import Path

_PERIOD_S = 5.0


class DiskWatch:
    """Measures a disk's free room again and again.

    Attributes:
        free_mb: Free room when last measured, megabytes.
        measured_s: When that was, seconds of the loop's clock; minus infinity before the first.
    """

    def __init__(self, folder: Path) -> None:
        """Build it; ``folder`` need not exist yet."""
        self.free_mb = 0.0
        self.measured_s = -math.inf
        self._folder = folder.absolute()

    async def run(self) -> None:
        """Measure for ever."""
        while True:
            await self.measure()
            await asyncio.sleep(_PERIOD_S)

    async def measure(self) -> None:
        """Measure once; a disk that cannot be asked is not measured."""
        try:
            self.free_mb = await asyncio.to_thread(free_mb, self._folder)
        except OSError:
            return
        self.measured_s = asyncio.get_running_loop().time()


def free_mb(folder: Path) -> float:
    """Return the room on the disk that ``folder`` is or will be on; raises OSError."""
    while not folder.exists():
        folder = folder.parent
    return shutil.disk_usage(folder).free / 1e6
