"""What a job is: plain JSON in, JSON lines out.

A job is a folder with ``spec.json``. The worker prints one JSON object per line on stdout and
copies it to ``events.jsonl``; each has ``event`` (``progressed``, ``found``, ``preview``,
``known``, ``refined``, ``metrics``, ``done`` or ``failed``) and what belongs to it. The file
``stop`` asks the worker to end at its next step, ``view.json`` says where its previews are to be
seen from. ``heartbeat`` says whether one is at work.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

# Files of a job's folder.
EVENTS, STOP, VIEW = "events.jsonl", "stop", "view.json"

# Every so many pictures one is held out, unless a reconstruction is told otherwise.
TEST_EVERY = 8

Kind = Literal["plan", "reconstruct", "render", "export"]


class Reporting(Protocol):
    """A job's way out (events) and in (the wish to stop)."""

    def emit(self, event: str, **fields: Any) -> None:
        """Tell one event."""
        ...

    def should_stop(self) -> bool:
        """Return True once somebody asked for the end."""
        ...


class JobStoppedError(Exception):
    """Somebody asked for the end before the job was done; the text says what is left."""


@dataclass(frozen=True, slots=True)
class JobSpec:
    """One piece of background work.

    Attributes:
        kind: Which program of the worker runs it.
        parameters: Its input, JSON values only.
        seed: Seed of everything random in it.
        threads: CPU threads it may use.
        niceness: Added to the process's nice value; higher yields more to flight.
        attached: It ends when whoever started it is gone; else it goes on and may be adopted.
    """

    kind: Kind
    parameters: dict[str, Any]
    seed: int = 0
    threads: int = 1
    niceness: int = 10
    attached: bool = True

    def write(self, folder: Path) -> None:
        """Write ``spec.json`` into ``folder``, which is made if needed."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "spec.json").write_text(json.dumps(asdict(self), indent=1))

    @classmethod
    def read(cls, folder: Path) -> JobSpec:
        """Read ``spec.json`` of ``folder``.

        Raises:
            ValueError: If it is missing or not a job.
        """
        try:
            return cls(**json.loads((folder / "spec.json").read_text()))
        except (OSError, TypeError, json.JSONDecodeError) as error:
            raise ValueError(f"{folder} is not a job folder: {error}") from error
