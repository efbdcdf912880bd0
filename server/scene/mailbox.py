"""What waits to be drawn: the newest of everything that has a place in the scene.

Drawing is slower than the events come. A pose, a picture, a report or a preview replaces the one
that has not been drawn; thumbnails are let through only so often. What happened once (a picture
taken, a plan found) waits in order. Does no I/O and reads no clock.
"""

from __future__ import annotations

from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    DroneReported,
    Event,
    FrameAnnotated,
    NoGoChanged,
    PlanFound,
    PlanViewChosen,
    PoseEstimated,
    PosesRefined,
    PreviewRendered,
    PrioritiesChanged,
    SeedFitted,
    SurfaceSeen,
)

_Slot = tuple[str, object]


class Mailbox:
    """Events waiting to be drawn, newest per place."""

    def __init__(self, thumbnail_hz: float) -> None:
        self._waiting: dict[_Slot, Event] = {}
        self._frames: dict[str, FrameAnnotated] = {}
        self._drawn_s: dict[str, float] = {}
        self._period_s = 1.0 / thumbnail_hz

    def offer(self, event: Event) -> bool:
        """Keep ``event`` if the scene shows it; return whether it does."""
        match event:
            case FrameAnnotated():
                self._frames[event.drone_id] = event
                return True
            case PoseEstimated():
                slot: _Slot = ("pose", event.pose.drone_id)
            case DroneReported():
                slot = ("report", event.drone_id)
            case CaptureTaken():
                slot = ("picture", event.capture.index)
            case SeedFitted():
                slot = ("seed", None)
            case SurfaceSeen():
                slot = ("seen", None)
            case PrioritiesChanged():
                slot = ("priorities", None)
            case NoGoChanged():
                slot = ("no-go", None)
            case PlanFound():
                slot = ("plan", None)
            case PlanViewChosen():
                slot = ("plan view", None)
            case PosesRefined():
                slot = ("refined", None)
            case PreviewRendered():
                slot = ("preview", None)
            case CaptureChanged(state="queued" | "running"):
                # Only that a capture began matters here, and that comes before its pictures: the
                # first report keeps its place in the order.
                self._waiting.setdefault(("capture", event.id), event)
                return True
            case _:
                return False
        self._waiting.pop(slot, None)  # A newer value also moves behind what came before it.
        self._waiting[slot] = event
        return True

    def take(self, now_s: float) -> list[Event]:
        """Return everything to draw now, in order, and forget it; ``now_s`` is monotonic."""
        batch = list(self._waiting.values())
        self._waiting.clear()
        for drone_id, frame in list(self._frames.items()):
            if now_s - self._drawn_s.get(drone_id, -self._period_s) >= self._period_s:
                self._drawn_s[drone_id] = now_s
                batch.append(frame)
                del self._frames[drone_id]
        return batch
