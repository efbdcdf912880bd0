"""The worker program: ``python -m server.jobs.worker JOB_FOLDER``, the same wherever it runs.

It prints JSON lines on stdout (see ``server.jobs.spec``), logs to stderr, and ends with exit code 0
after ``done`` or 1 after ``failed``. It stops at its next step when the file ``stop`` appears or,
if the job is attached to it, the process that started it is gone.
"""

from __future__ import annotations

import importlib
import json
import logging
import os
import signal
import sys
import time
from pathlib import Path
from types import FrameType
from typing import Any

from server.jobs.heartbeat import Heartbeat
from server.jobs.spec import EVENTS, STOP, JobSpec, JobStoppedError

# By name, so that planning does not wait for torch to load.
_PROGRAMS = {
    "plan": "server.jobs.plan",
    "reconstruct": "server.jobs.reconstruct",
    "render": "server.jobs.render",
    "export": "server.jobs.export",
}


class Reporter:
    """The worker's ``Reporting``: JSON lines out, a file or a signal in.

    Attributes:
        folder: The job's folder.

    Args:
        folder: The job's folder.
        attached: Stop when the process that started this one is gone.
    """

    def __init__(self, folder: Path, *, attached: bool = True) -> None:
        self.folder = folder
        self._events = (folder / EVENTS).open("a")
        self._parent = os.getppid()
        self._attached = attached
        self._terminated = False
        signal.signal(signal.SIGTERM, self._on_term)

    def _on_term(self, number: int, frame: FrameType | None) -> None:
        self._terminated = True

    def emit(self, event: str, **fields: Any) -> None:
        """Print one event and keep a copy."""
        line = json.dumps({"event": event, "at_s": time.time()} | fields)
        # The copy first: whoever adopts this job finds all that was told.
        self._events.write(line + "\n")
        self._events.flush()
        try:
            print(line, flush=True)
        except BrokenPipeError:
            # Whoever listened is gone; from here on nobody is told but the file.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())

    def orphaned(self) -> bool:
        """Return whether the process that started this one is gone."""
        return os.getppid() != self._parent

    def should_stop(self) -> bool:
        """Return True once somebody asked for the end, or nobody is left who could."""
        gone = self._attached and self.orphaned()
        return self._terminated or gone or (self.folder / STOP).exists()


def main() -> int:
    """Run the job in the folder given as the only argument."""
    if len(sys.argv) != 2:
        print("usage: python -m server.jobs.worker JOB_FOLDER", file=sys.stderr)
        return 2
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s %(message)s")
    folder = Path(sys.argv[1])
    try:
        spec = JobSpec.read(folder)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    try:
        Heartbeat(folder)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    os.nice(spec.niceness)
    reporter = Reporter(folder, attached=spec.attached)
    return work(spec, reporter)


def work(spec: JobSpec, reporter: Reporter) -> int:
    """Do a job, tell how it ended, and return the exit code."""
    try:
        result = importlib.import_module(_PROGRAMS[spec.kind]).run(spec, reporter)
    except JobStoppedError as stopped:
        reporter.emit("failed", error=str(stopped), bad_input=False, stopped=True)
        return 1
    except Exception as error:
        logging.getLogger(__name__).exception("job failed")
        bad_input = isinstance(error, ValueError)
        reporter.emit("failed", error=str(error) if bad_input else repr(error), bad_input=bad_input)
        return 1
    reporter.emit("done", **result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
