"""One drone's eye: every picture becomes a region, a box and an annotated tile.

The search and the drawing run in worker threads, one picture of a drone at a time; results come
back to the event loop. A picture that takes long lets a few others wait; when too many wait, only
the newest is looked at and the others are counted as skipped.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.mission.events import EventStream, FrameAnnotated, PictureMarks
from server.stages import Box, Frame, Region
from server.swarm.drone import Drone
from server.vision.annotate import annotate, outlines_px
from server.vision.config import RegionConfig, VisionConfig
from server.vision.orientation import yaw_error
from server.vision.region import RegionPrior, RegionTracker

Array = NDArray[np.float64]


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


@dataclass(frozen=True, slots=True, eq=False)
class _Pointing:
    """What the operator said last.

    Attributes:
        xyxy_px: The object's box ``(4,)``, full-picture pixels; None: search without help.
    """

    xyxy_px: Array | None


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

    def point_out(self, xyxy_px: Array | None) -> None:
        """Say where the object is in the next picture.

        Args:
            xyxy_px: Left, top, right, bottom ``(4,)``, full-picture pixels; None to go back to
                searching without help.

        Raises:
            ValueError: If the box is empty or not finite.
        """
        ...

    async def run(self) -> None:
        """Look at pictures for ever."""
        ...


class PictureSearch:
    """Searches the pictures of one camera for the object, one after the other."""

    def __init__(self, camera: Intrinsics, config: RegionConfig, turn: float = 0.0) -> None:
        """Build it; ``turn`` as ``RegionTracker`` takes it."""
        self._camera = camera
        self._tracker = RegionTracker(config, turn)

    def point_out(self, xyxy_px: Array | None) -> None:
        """Say where the object is in the next picture, see ``Eye.point_out``."""
        self._tracker.point_out(xyxy_px)

    def use(self, camera: Intrinsics) -> None:
        """Take this for the camera from the next picture on."""
        self._camera = camera

    def fits(self, frame: Frame) -> bool:
        """Return whether a picture is of the calibrated size."""
        return frame.size_px == (self._camera.width, self._camera.height)

    def look(self, frame: Frame, expected: RegionPrior | None) -> Sight:
        """Return what a picture shows."""
        # Boxes in pixels of another camera than the calibrated one would lead astray; and what is
        # found in a smeared picture is wrong too often to fly by: drones left the fence.
        usable = self.fits(frame) and not frame.damaged
        found = self._tracker.update(frame, expected) if usable else None
        region, box = found if found is not None else (None, None)
        return Sight(frame, region, box)


class CameraEye:
    """Looks at every picture of one drone; an ``Eye``."""

    def __init__(
        self,
        drone: Drone,
        config: VisionConfig,
        events: EventStream,
        threads: Executor,
        clock: Callable[[], float] = time.monotonic,
        turn: float = 0.0,
    ) -> None:
        """Build it.

        Args:
            drone: Whose pictures to look at.
            config: Settings.
            events: Where annotated pictures go.
            threads: Search and draw.
            clock: That of the frames' times.
            turn: 0 to 1, another for each drone, so that long searches do not fall together.
        """
        self.sight: Sight | None = None
        self.annotated: FrameAnnotated | None = None
        self._drone = drone
        self._search = PictureSearch(drone.config.intrinsics, config.region, turn)
        self._events = events
        self._threads = threads
        self._clock = clock
        self._expected: RegionPrior | None = None
        self._pointing: _Pointing | None = None

    def expect(self, prior: RegionPrior | None) -> None:
        """Say where the object should be in the next pictures."""
        self._expected = prior

    def point_out(self, xyxy_px: Array | None) -> None:
        """Say where the object is in the next picture, see ``Eye.point_out``."""
        # The tracker may be at work in its thread: it is told between two pictures, and what it
        # would refuse there is refused here.
        self._pointing = _Pointing(None if xyxy_px is None else _checked(xyxy_px))

    async def run(self) -> None:
        """Look at pictures for ever."""
        loop = asyncio.get_running_loop()
        while True:
            frame = await self._drone.next_in_order()
            # Counted now, when all that were skipped came before this picture.
            skipped = self._drone.pictures_skipped
            pointing, self._pointing = self._pointing, None
            sight, annotated = await loop.run_in_executor(
                self._threads, self._look, frame, self._expected, pointing, skipped
            )
            self.sight, self.annotated = sight, annotated
            self._events.publish(annotated)

    def _look(
        self,
        frame: Frame,
        expected: RegionPrior | None,
        pointing: _Pointing | None,
        skipped: int,
    ) -> tuple[Sight, FrameAnnotated]:
        """Search and draw one picture; runs in a worker thread."""
        config = self._drone.config
        camera = config.intrinsics
        self._search.use(camera)  # It may have been calibrated since.
        if pointing is not None:
            self._search.point_out(pointing.xyxy_px)
        sight = self._search.look(frame, expected)
        region, box = sight.region, sight.box
        turn_rad = marks = None
        if box is not None:
            turn_rad = yaw_error(box, camera, float(np.deg2rad(config.tilt_deg)))
            outlines = () if region is None else outlines_px(region)
            marks = PictureMarks(frame.size_px, box, outlines, turn_rad)
        note = ""
        if not self._search.fits(frame):
            note = f"calibrated for {camera.width}x{camera.height}: not searched"
        jpeg = annotate(
            frame,
            region,
            box,
            config.label,
            config.colour,
            yaw_error_rad=turn_rad,
            note=note,
        )
        arrived_s = frame.captured_s if frame.completed_s is None else frame.completed_s
        annotated = FrameAnnotated(
            frame.drone_id,
            frame.sequence,
            frame.captured_s,
            jpeg,
            frame.damaged,
            latency_s=self._clock() - arrived_s,
            skipped=skipped,
            coded=frame.coded,
            marks=marks,
            note=note,
        )
        return sight, annotated


def _checked(xyxy_px: Array) -> Array:
    """Return a copy of a box ``(4,)``; raises ValueError when it is none."""
    box = np.array(xyxy_px, float)
    if box.shape != (4,) or not np.isfinite(box).all() or (box[2:] <= box[:2]).any():
        raise ValueError(f"xyxy_px must be left, top, right, bottom of a box, got {xyxy_px}")
    return box
