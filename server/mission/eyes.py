"""One drone's eye: every picture becomes a region, a box and an annotated tile.

The search and the drawing run in a worker thread; results come back to the event loop. When
pictures arrive faster than they are searched, the newest one wins.
"""

from __future__ import annotations

import asyncio
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Protocol

from server.mission.events import EventStream, FrameAnnotated
from server.stages import Box, Frame, Region
from server.swarm.drone import Drone
from server.vision.annotate import annotate
from server.vision.config import VisionConfig
from server.vision.region import RegionPrior, RegionTracker


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one picture showed.

    Attributes:
        frame: The picture.
        region: The object's region, None when it was not seen.
        box: Its box, None when it was not seen.
    """

    frame: Frame
    region: Region | None
    box: Box | None


class Eye(Protocol):
    """Says what one drone sees.

    Attributes:
        sight: What the newest searched picture showed, None before the first.
        annotated: The newest annotated picture, None before the first.
    """

    sight: Sight | None
    annotated: FrameAnnotated | None

    def expect(self, prior: RegionPrior | None) -> None:
        """Say where the object should be in the next pictures."""
        ...

    async def run(self) -> None:
        """Look at pictures for ever."""
        ...


class CameraEye:
    """Looks at every picture of one drone; an ``Eye``."""

    def __init__(
        self, drone: Drone, config: VisionConfig, events: EventStream, threads: Executor
    ) -> None:
        self.sight: Sight | None = None
        self.annotated: FrameAnnotated | None = None
        self._drone = drone
        self._tracker = RegionTracker(config.region)
        self._events = events
        self._threads = threads
        self._expected: RegionPrior | None = None

    def expect(self, prior: RegionPrior | None) -> None:
        """Say where the object should be in the next pictures."""
        self._expected = prior

    async def run(self) -> None:
        """Look at pictures for ever."""
        loop = asyncio.get_running_loop()
        sequence = -1
        while True:
            frame = await self._drone.next_frame(sequence)
            sequence = frame.sequence
            sight, jpeg = await loop.run_in_executor(
                self._threads, self._look, frame, self._expected
            )
            self.sight = sight
            self.annotated = FrameAnnotated(
                frame.drone_id, frame.sequence, frame.captured_s, jpeg, frame.damaged
            )
            self._events.publish(self.annotated)

    def _look(self, frame: Frame, expected: RegionPrior | None) -> tuple[Sight, bytes]:
        # What is found in a smeared picture is wrong too often to fly by: drones left the fence.
        found = None if frame.damaged else self._tracker.update(frame, expected)
        region, box = found if found is not None else (None, None)
        jpeg = annotate(frame, region, box, self._drone.config.label, self._drone.config.colour)
        return Sight(frame, region, box), jpeg
