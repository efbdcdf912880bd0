"""Whether somebody trains in a run folder, by what can be seen from outside.

A worker of ``server.jobs`` holds a lock on a file of its job's folder and touches it every second
(``server.jobs.heartbeat``). One that was started from a shell has its job's folder elsewhere, and
one of a cluster beats on another machine: of those only silence tells.
"""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

# Nothing was written in a run folder for so long: whoever worked on it is gone.
SILENCE_S = 600.0
# A job may wait as long for its turn on a cluster, which writes nothing here.
_QUEUE_S = 7 * 86_400.0
# What a worker wrote at its end may be as much newer than its last beat.
_BEAT_S = 20.0


def is_trained_now(folder: Path, newest_unix_s: float) -> bool:
    """Return whether somebody may be at work on a training that is not over.

    Args:
        folder: The run folder of a training that has left no last word.
        newest_unix_s: When the newest of its files was changed, seconds since 1970 (UTC).
    """
    job = folder / "jobs" / "reconstruct"
    silent_s = time.time() - newest_unix_s
    beat_unix_s = _beat_unix_s(job / "heartbeat")
    if (job / "ray.json").is_file():
        return silent_s <= (_QUEUE_S if beat_unix_s is None else SILENCE_S)
    if beat_unix_s is not None:
        if _is_locked(job / "heartbeat"):
            return True
        if newest_unix_s <= beat_unix_s + _BEAT_S:
            return False  # It was killed, and nobody has gone on with it since.
    return silent_s <= SILENCE_S


def _beat_unix_s(heartbeat: Path) -> float | None:
    try:
        return heartbeat.stat().st_mtime
    except OSError:
        return None


def _is_locked(heartbeat: Path) -> bool:
    try:
        file = os.open(heartbeat, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(file)  # Which gives the lock back.
    return False
