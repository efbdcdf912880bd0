"""Tells the course of a capture in sentences: what the event log shows when all goes well.

Trouble is noted by whoever meets it. This is the rest of the story: it follows the event stream,
and what it finds worth a line goes back into it as ``Noted``.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator

from server.mission.events import (
    CaptureChanged,
    Event,
    EventStream,
    MetricsMeasured,
    Noted,
    PlanFound,
    SeedFitted,
)
from server.mission.phases import Phase

logger = logging.getLogger(__name__)


class Chronicle:
    """What was told last of the capture under way. Does no I/O."""

    def __init__(self) -> None:
        self._capture: CaptureChanged | None = None
        self._object_told = False

    def lines(self, event: Event) -> Iterator[Noted]:
        """Yield what ``event`` adds to the story, oldest first."""
        match event:
            case CaptureChanged(phase=Phase.PREFLIGHT, state="running") if self._is_new(event):
                self._capture, self._object_told = event, False
                yield Noted("info", f"Capture {event.id}: {event.images_total} pictures wanted.")
            case CaptureChanged() if not self._is_new(event):
                before, self._capture = self._capture, event
                assert before is not None
                yield from _course(before, event)
            case SeedFitted(seed=seed) if not self._object_told:
                # It is refined after every round; the numbers are in the scene.
                self._object_told = True
                size = " x ".join(f"{edge:.2f}" for edge in seed.outer.size)
                yield Noted("info", f"Object found: {size} m.")
            case PlanFound(placement=placement, assignment=assignment):
                chosen, of = len(placement.viewpoints), placement.candidates
                rounds = len(assignment.rounds)
                choice = f" out of {of}" if of > chosen else ""
                yield Noted("info", f"Plan: {chosen} viewpoints{choice} in {rounds} rounds.")
            case MetricsMeasured(metrics=metrics) if self._under_way:
                text = f"Held-out pictures: {metrics.psnr_db:.2f} dB, SSIM {metrics.ssim:.3f}."
                yield Noted("info", text)

    @property
    def _under_way(self) -> bool:
        return self._capture is not None and self._capture.state in ("running", "paused")

    def _is_new(self, event: CaptureChanged) -> bool:
        return self._capture is None or self._capture.id != event.id


def _course(before: CaptureChanged, now: CaptureChanged) -> Iterator[Noted]:
    """Yield what lies between two reports of one capture."""
    if now.phase != before.phase:
        if before.phase == Phase.CAPTURE:
            done, taken = f"{before.round_index + 1} of {now.rounds}", now.images
            yield Noted("info", f"Round {done}: {taken} of {now.images_total} pictures.")
        match now.phase:
            case Phase.TAKE_OFF:
                yield Noted("info", "Taking off.")
            case Phase.CENTRE:
                yield Noted("info", "In the air: turning to the object.")
            case Phase.LAND:
                yield Noted("info", "Landing.")
            case Phase.TRAIN:
                yield Noted("info", f"On the ground with {now.images} pictures.")
    if now.state != before.state:
        match now.state:
            case "paused" if now.phase != Phase.GROUNDED:
                yield Noted("info", "Paused.")
            case "running" if before.state == "paused":
                yield Noted("info", "The capture goes on.")
            case "succeeded":
                yield Noted("info", "Capture complete.")
            case "aborted":
                yield Noted("warning", f"Capture ended early: {now.error}.")
            case "failed":
                yield Noted("error", "The capture failed.")


async def follow(events: EventStream) -> None:
    """Tell the story of what ``events`` brings until cancelled; no failure of it stops a flight."""
    chronicle = Chronicle()
    try:
        with events.subscribe(1024) as subscription:
            async for event in subscription:
                for line in chronicle.lines(event):
                    events.publish(line)
    except Exception:
        logger.exception("the chronicle stopped")
