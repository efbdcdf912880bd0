"""Who works in a job folder: its worker holds a lock on a file there and touches it every second.

The lock goes with the process however that ends, so a dead worker is never taken for a living one,
nor another program that got its number. The touch tells a worker that works from one that is
stopped or starved.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
from pathlib import Path

_FILE = "heartbeat"
_BEAT_S = 1.0
# Whoever looks holds the lock for a moment, too.
_TRIES, _TRY_AGAIN_S = 20, 0.1


class Heartbeat:
    """The worker's side: takes the folder and beats until the process ends.

    Raises:
        ValueError: If another worker has the folder.
    """

    def __init__(self, folder: Path) -> None:
        # The descriptor stays open: closing it would give the folder away.
        self._file = os.open(folder / _FILE, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        for _ in range(_TRIES):
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(_TRY_AGAIN_S)
        else:
            os.close(self._file)
            raise ValueError(f"another worker is at work in {folder}")
        os.ftruncate(self._file, 0)
        os.pwrite(self._file, str(os.getpid()).encode(), 0)
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()

    def _beat(self) -> None:
        while True:
            time.sleep(_BEAT_S)
            with contextlib.suppress(OSError):  # A disk that is away for a while ends no training.
                os.utime(self._file)


def worker_in(folder: Path) -> int | None:
    """Return the process number of the worker at work in ``folder``, None when there is none."""
    try:
        file = os.open(folder / _FILE, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        number = os.pread(file, 20, 0)
        return int(number) if number.isdigit() else None
    finally:
        os.close(file)
    return None


class Listener:
    """The watcher's side: how long ago the last new beat was heard.

    Counted from when this one first listened, on the clock of whoever asks: a computer that slept
    has heard nothing either.
    """

    def __init__(self, folder: Path, now_s: float) -> None:
        self._path = folder / _FILE
        self._beat_ns = -1
        self._heard_s = now_s

    def silent_s(self, now_s: float) -> float:
        """Return the seconds since the last new beat."""
        with contextlib.suppress(OSError):
            beat_ns = self._path.stat().st_mtime_ns
            if beat_ns != self._beat_ns:
                self._beat_ns, self._heard_s = beat_ns, now_s
        return now_s - self._heard_s
