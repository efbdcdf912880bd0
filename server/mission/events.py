"""What happened, in the past tense: the only way news leaves a mission.

Events are frozen values. ``EventStream`` hands each of them to every subscriber; a subscriber that
falls behind loses its oldest events first (its queue is bounded) and is told how many.
Times ``at`` are aware UTC.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.stages import (
    Assignment,
    Box,
    CameraPose,
    Capture,
    CodedPicture,
    Metrics,
    Placement,
    SeedGeometry,
)

Level = Literal["info", "warning", "error"]


def _now() -> datetime:
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True, eq=False)
class DroneReported:
    """Five times a second: everything a person wants to know about one drone.

    Attributes:
        drone_id: Which drone.
        name: Its display name.
        colour: Its display colour, ``#rrggbb``.
        activity: ``offline``, ``ground``, ``taking_off``, ``flying``, ``holding``, ``landing`` or
            ``cut``.
        held: True while HOLD is latched.
        battery_pct: Charge, None before the first report.
        temperature_c: Board temperature.
        height_m: Believed camera height above the floor.
        speed_m_s: Speed by telemetry.
        state_age_s: Seconds since the last state report, None before the first.
        video_age_s: Seconds since the last picture, None before the first.
        video_fps: Pictures per second over the last seconds.
        position_sigma_m: Uncertainty of the believed position.
        video_wanted: False while its video is switched off on purpose, on the ground.
        link_age_s: Seconds since it last answered in this flight, None where that is not known.
        object_age_s: Seconds since it last saw the object where it may be, None before the first
            time in this flight.
        velocity_age_s: Seconds for which it was told to move and reported no velocity at all.
    """

    drone_id: str
    name: str
    colour: str
    activity: str
    held: bool
    battery_pct: int | None
    temperature_c: float | None
    height_m: float | None
    speed_m_s: float | None
    state_age_s: float | None
    video_age_s: float | None
    video_fps: float
    position_sigma_m: float | None
    at: datetime = field(default_factory=_now)
    video_wanted: bool = True
    link_age_s: float | None = None
    object_age_s: float | None = None
    velocity_age_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PictureMarks:
    """What was seen in a picture, in whole pixels of it.

    Attributes:
        size_px: Width and height of the picture.
        box: The object's box.
        outlines_px: The region's outlines, each ``(k, 2)`` int.
        yaw_error_rad: How far the drone must turn to face the box, counter-clockwise positive.
    """

    size_px: tuple[int, int]
    box: Box
    outlines_px: tuple[NDArray[np.int64], ...]
    yaw_error_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameAnnotated:
    """A picture with its region, box, centroid and drone name drawn in; made for every frame.

    Attributes:
        drone_id: Which drone.
        sequence: The frame's number.
        captured_s: Monotonic arrival time of the frame.
        jpeg: 640x480 JPEG.
        damaged: As the frame says.
        latency_s: Seconds from the arrival of the frame's last datagram to this JPEG.
        skipped: Pictures of this drone that were decoded but not looked at, since the start.
        coded: The picture as the drone sent it, for who draws ``marks`` on it, with those before it
            that nobody looked at; empty without.
        marks: What is drawn into the JPEG, None when nothing was seen.
        note: What else there is to say of the picture.
    """

    drone_id: str
    sequence: int
    captured_s: float
    jpeg: bytes
    damaged: bool
    at: datetime = field(default_factory=_now)
    latency_s: float = 0.0
    skipped: int = 0
    coded: tuple[CodedPicture, ...] = ()
    marks: PictureMarks | None = None
    note: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class FailsafeFired:
    """A row of the failsafe table began to fire for a drone.

    Attributes:
        drone_id: Which drone.
        event: The row's event, see ``server.swarm.failsafes``.
        threshold: The row's threshold.
        action: What the drone does: ``hold``, ``land``, ``land_all`` or ``cut``.
        value: What was measured.
        text: The measured value in words.
    """

    drone_id: str
    event: str
    threshold: float
    action: str
    value: float
    text: str
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimated:
    """A drone's believed camera pose, about ten times a second."""

    pose: CameraPose
    intrinsics: Intrinsics
    colour: str
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class SeedFitted:
    """The seed geometry was made or refined."""

    seed: SeedGeometry
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True)
class Coverage:
    """Shares of the area of the object's surface, 0 to 1.

    Attributes:
        once: That at least one picture shows.
        thrice: That at least three show.
    """

    once: float
    thrice: float


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSeen:
    """How much of the object's surface the pictures taken so far show.

    Attributes:
        points: Centres of its patches ``(s, 3)``, world metres.
        pictures: In how many pictures each is seen ``(s,)``.
        patch_m: Width of a patch.
        coverage: What that comes to.
    """

    points: NDArray[np.float64]
    pictures: NDArray[np.int64]
    patch_m: float
    coverage: Coverage
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PlanProgressed:
    """The annealing reports: temperature and best fitness so far."""

    iteration: int
    iterations: int
    temperature: float
    fitness: float
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PlanFound:
    """A placement was found and its viewpoints assigned to drones.

    Attributes:
        placement: What was chosen.
        assignment: Who flies where.
        ring: The standard ring around the same object, to compare with; None where it is what was
            chosen, or where it does not fit.
        expected: What the pictures taken before and those planned will show, None when unknown.
        ring_expected: What the ring would, None without one to compare with.
    """

    placement: Placement
    assignment: Assignment
    expected: Coverage | None
    at: datetime = field(default_factory=_now)
    ring: Assignment | None = None
    ring_expected: Coverage | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CaptureTaken:
    """A picture is on disk.

    Attributes:
        capture: What was taken.
        thumbnail_jpeg: 160x120 JPEG of it.
    """

    capture: Capture
    thumbnail_jpeg: bytes
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PosesRefined:
    """The pictures' poses were refined after the flight.

    Attributes:
        T_world_cam: ``(n, 4, 4)`` of all pictures in order of taking.
        refined: ``(n,)`` False where a picture kept its pose from the flight.
    """

    T_world_cam: NDArray[np.float64]
    refined: NDArray[np.bool_]
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class TrainingProgressed:
    """The field's training reports.

    Attributes:
        stage: ``live``, ``refine``, ``train``, ``evaluate`` or ``deliver``.
        step: Steps so far in this stage.
        seconds: Seconds so far in this stage.
        seconds_total: Planned seconds of this stage, None when open-ended.
        loss: Training loss.
        psnr_db: PSNR of the training batch, None before the first.
        held_out_psnr_db: PSNR on held-out pictures when last measured.
        samples_per_s: Points through encoding and both MLPs with gradient, per second.
        images: Pictures in use.
        held_out_ssim: SSIM on held-out pictures when last measured; earlier workers do not tell it.
    """

    stage: str
    step: int
    seconds: float
    seconds_total: float | None
    loss: float | None
    psnr_db: float | None
    held_out_psnr_db: float | None
    samples_per_s: float
    images: int
    at: datetime = field(default_factory=_now)
    held_out_ssim: float | None = None


@dataclass(frozen=True, slots=True)
class FieldView:
    """Where an operator looks at the field from, on a sphere about the object.

    Attributes:
        azimuth_rad: Counter-clockwise from the world's +X.
        elevation_rad: Above the object's middle.
        distance: As a share of the pictures' median distance.
    """

    azimuth_rad: float
    elevation_rad: float
    distance: float


@dataclass(frozen=True, slots=True, eq=False)
class PreviewRendered:
    """The field was rendered while it is trained, from where somebody wants it or on an orbit.

    Attributes:
        jpeg: The rendering.
        T_world_cam: ``(4, 4)`` of the camera it was rendered from.
        intrinsics: Its camera.
        view: Where that is on its sphere about the object.
    """

    jpeg: bytes
    T_world_cam: NDArray[np.float64]
    intrinsics: Intrinsics
    view: FieldView
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class MetricsMeasured:
    """Held-out pictures were judged."""

    metrics: Metrics
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class CaptureChanged:
    """The capture (one run of the mission) has a new state, phase or progress.

    Attributes:
        id: The capture's id, also the run folder's name.
        state: queued, running, paused, succeeded, failed, aborted or interrupted.
        phase: The mission phase, in words.
        progress: 0 to 1 over the whole capture.
        eta_s: Seconds left, None when unknown.
        run: Path of the run folder.
        error: What went wrong, None when nothing did.
        mode: ``optimized`` or ``standard``.
        round_index: Round being flown, from 0.
        rounds: Rounds planned.
        images: Pictures taken.
        images_total: Pictures planned.
        commanded: Viewpoints the drones were sent to so far.
        entered: When each phase so far was entered for the first time, ISO 8601 UTC, in that order.
    """

    id: str
    state: str
    phase: str
    progress: float
    eta_s: float | None
    run: str
    error: str | None
    mode: str
    round_index: int
    rounds: int
    images: int
    images_total: int
    at: datetime = field(default_factory=_now)
    commanded: int = 0
    entered: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class ObjectPointedOut:
    """The operator said where the object is in a drone's picture, or took it back.

    Attributes:
        drone_id: In whose picture.
        box: Left, top, right, bottom as shares 0 to 1 of the picture; None: the drone searches
            without help again.
    """

    drone_id: str
    box: tuple[float, float, float, float] | None
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class ViewsDisagree:
    """The drones began to see different things, it is others now, or they agree again.

    Attributes:
        drone_ids: Those that see something else than the rest; empty when all agree again.
        reason: Why, for people; empty when all agree again.
    """

    drone_ids: tuple[str, ...]
    reason: str
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PriorityPart:
    """A part of the object that the operator wants to have better pictures of.

    Attributes:
        id: Names it until the capture ends.
        drone_id: In whose picture it was drawn.
        drawn: Left, top, right, bottom as shares 0 to 1 of that picture.
        weight: How many times as much as elsewhere a patch of surface in it counts.
        box: Where it is, world metres; None until the object's geometry is known.
    """

    id: str
    drone_id: str
    drawn: tuple[float, float, float, float]
    weight: float
    box: Box3 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NoGoVolume:
    """A column of the room that no drone may enter.

    Attributes:
        id: Names it.
        box: Where it is, world metres, from the floor to the ceiling.
        configured: True for one of the settings, which is changed there.
    """

    id: str
    box: Box3
    configured: bool = False

    @property
    def area(self) -> tuple[float, float, float, float]:
        """Its rectangle on the floor: lower x, lower y, upper x, upper y, world metres."""
        (x_0, y_0, _), (x_1, y_1, _) = self.box.lower.tolist(), self.box.upper.tolist()
        return x_0, y_0, x_1, y_1


@dataclass(frozen=True, slots=True, eq=False)
class NoGoChanged:
    """The no-go volumes as they stand now, all of them."""

    volumes: tuple[NoGoVolume, ...]
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PrioritiesChanged:
    """The operator's parts of priority as they stand now, all of them."""

    parts: tuple[PriorityPart, ...]
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class PlanViewChosen:
    """Somebody chose which viewpoints the 3D scene shows; it is one scene for all who look.

    Attributes:
        shown: ``planned``, the standard ``ring`` to compare with, or ``both``.
    """

    shown: Literal["planned", "ring", "both"]
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class CommandChanged:
    """Another browser is in command now, or one asks for the command.

    Attributes:
        holder: Who is in command, None for nobody.
        asking: Who asks for it, None for nobody.
    """

    holder: str | None
    asking: str | None
    at: datetime = field(default_factory=_now)


@dataclass(frozen=True, slots=True, eq=False)
class Noted:
    """A line for the operator's event log.

    Attributes:
        level: How much it matters.
        text: What happened, what it means, what to do.
        drone_id: The drone concerned, None for the whole fleet.
    """

    level: Level
    text: str
    drone_id: str | None = None
    at: datetime = field(default_factory=_now)


Event = (
    DroneReported
    | FrameAnnotated
    | PoseEstimated
    | SeedFitted
    | SurfaceSeen
    | PlanProgressed
    | PlanFound
    | CaptureTaken
    | PosesRefined
    | TrainingProgressed
    | PreviewRendered
    | MetricsMeasured
    | CaptureChanged
    | FailsafeFired
    | ObjectPointedOut
    | ViewsDisagree
    | PrioritiesChanged
    | NoGoChanged
    | PlanViewChosen
    | CommandChanged
    | Noted
)


class Subscription:
    """One subscriber's bounded queue; ``async for event in subscription`` reads it.

    Attributes:
        dropped: Events lost because the subscriber was too slow.
    """

    def __init__(self, limit: int) -> None:
        self._queue: asyncio.Queue[Event] = asyncio.Queue(limit)
        self.dropped = 0

    def offer(self, event: Event) -> None:
        """Queue ``event``; when the queue is full the oldest one goes."""
        if self._queue.full():
            self._queue.get_nowait()
            self.dropped += 1
        self._queue.put_nowait(event)

    def __aiter__(self) -> Subscription:
        return self

    async def __anext__(self) -> Event:
        return await self._queue.get()


class EventStream:
    """Hands events to all subscribers. Lives on the event loop; call it from there only."""

    def __init__(self) -> None:
        self._subscriptions: set[Subscription] = set()

    def publish(self, event: Event) -> None:
        """Hand ``event`` to every subscriber, without waiting."""
        for subscription in self._subscriptions:
            subscription.offer(event)

    @contextmanager
    def subscribe(self, limit: int = 256) -> Iterator[Subscription]:
        """Yield a subscription that ends with the ``with`` block."""
        subscription = Subscription(limit)
        self._subscriptions.add(subscription)
        try:
            yield subscription
        finally:
            self._subscriptions.discard(subscription)
