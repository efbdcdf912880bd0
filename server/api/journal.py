"""What the console remembers of the mission's events, for whoever comes or asks later.

The event log, of the newest capture its plan and its pictures, and how the video fares.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter, deque
from dataclasses import dataclass

from server.api.course import Course
from server.api.video_counts import VideoCounts
from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    DroneReported,
    Event,
    EventStream,
    FailsafeFired,
    FrameAnnotated,
    Noted,
    PlanFound,
    PlanProgressed,
    PlanViewChosen,
)

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line of the event log.

    Attributes:
        sequence: Counts lines from 1; a client asks for what came after the last it has.
        note: What happened.
    """

    sequence: int
    note: Noted


@dataclass(frozen=True, slots=True, eq=False)
class KnownPlan:
    """The newest plan and the capture it was made for (None when no capture was seen yet)."""

    capture_id: str | None
    found: PlanFound


class Journal:
    """A bounded memory of the event log, fed from the event stream.

    Attributes:
        plan: The newest plan of the newest capture, None before there is one.
        annealing: The newest annealing's reports from its first one on.
        plan_view: Which viewpoints the 3D scene shows, None before anybody chose.
        pictures: The newest capture's pictures by their index.
        video: Counts of annotated pictures.
        course: What the drones reported over the last minutes.
        failsafes: How often each row of the failsafe table fired, by (event, action).
        healthy: True while events are being followed.
    """

    def __init__(self, limit: int) -> None:
        """Make a journal that keeps the newest ``limit`` lines."""
        self._lines: deque[Line] = deque(maxlen=limit)
        self._sequence = 0
        self._capture_id: str | None = None
        self.plan: KnownPlan | None = None
        self.annealing: list[PlanProgressed] = []
        self.plan_view: PlanViewChosen | None = None
        self.pictures: dict[int, CaptureTaken] = {}
        self.video = VideoCounts()
        self.course = Course()
        self.failsafes: Counter[tuple[str, str]] = Counter()
        self.healthy = False

    def record(self, event: Event) -> None:
        """Remember what is worth remembering of ``event``."""
        match event:
            case FrameAnnotated():
                self.video.record(event)
            case DroneReported():
                self.course.record(event)
            case FailsafeFired(event=row, action=action):
                self.failsafes[row, action] += 1
            case Noted():
                self._sequence += 1
                self._lines.append(Line(self._sequence, event))
            case PlanProgressed(iteration=iteration):
                if self.annealing and iteration <= self.annealing[-1].iteration:
                    self.annealing = []
                self.annealing.append(event)
            case PlanFound():
                self.plan = KnownPlan(self._capture_id, event)
            case PlanViewChosen():
                self.plan_view = event
            case CaptureChanged(state="queued" | "running" | "paused", id=capture_id):
                if capture_id != self._capture_id:
                    self._capture_id = capture_id
                    self.plan = None
                    self.annealing = []
                    self.pictures = {}
            case CaptureTaken():
                self.pictures[event.capture.index] = event
            case _:
                pass

    def since(self, sequence: int, limit: int) -> list[Line]:
        """Return up to ``limit`` of the oldest kept lines after ``sequence``."""
        return [line for line in self._lines if line.sequence > sequence][:limit]

    def newest(self, limit: int) -> list[Line]:
        """Return the newest ``limit`` lines, oldest first."""
        return list(self._lines)[-limit:] if limit else []

    async def follow(self, events: EventStream) -> None:
        """Record events until cancelled."""
        self.healthy = True
        try:
            with events.subscribe() as subscription:
                async for event in subscription:
                    self.record(event)
        except asyncio.CancelledError:
            raise
        except Exception:
            logger.exception("the event log stopped")
        finally:
            self.healthy = False
