"""What may be asked of the mission, and by which names: the door between console and mission."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal, Protocol

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.mission.calibration_record import CalibrationControl
from server.mission.checklist import Check
from server.mission.events import (
    CaptureChanged,
    DroneReported,
    Event,
    EventStream,
    FieldView,
    FrameAnnotated,
    NoGoVolume,
    ObjectPointedOut,
    PriorityPart,
)
from server.swarm.failsafes import FALLING, Failsafe, FailsafeTable

Mode = Literal["optimized", "standard"]
DroneCommand = Literal["takeoff", "land", "hold", "rearm", "cut_motors"]
StopCommand = Literal["hold", "land", "cut_motors"]
# A point x, y or a box left, top, right, bottom, as shares 0 to 1 of a picture.
PointedPlace = tuple[float, float] | tuple[float, float, float, float]
# A rectangle of the floor: x, y of two opposite corners, world metres.
Area = tuple[float, float, float, float]


def failsafe_falls(event: str) -> bool:
    """Return whether a failsafe's event fires at or below its threshold, not at or above it."""
    return event in FALLING


def failsafe_meaning(event: str) -> str:
    """Return what a failsafe's event means, in the table's own words; empty when it has none."""
    lines = (FailsafeTable.__doc__ or "").splitlines()
    head = f"        {event}: "
    start = next((n for n, line in enumerate(lines) if line.startswith(head)), None)
    if start is None:
        return ""
    words = [lines[start][len(head) :]]
    for line in lines[start + 1 :]:
        if not line.startswith(" " * 12):  # Only the lines that go on are indented further.
            break
        words.append(line.strip())
    return " ".join(words)


class RefusedError(Exception):
    """A well-formed request that cannot be carried out now; the text says why (HTTP 409)."""


class UnknownError(Exception):
    """The named drone, capture or file does not exist (HTTP 404)."""


# More pictures a capture does not take.
MOST_PICTURES = 400


@dataclass(frozen=True, slots=True)
class CaptureRequest:
    """What to capture.

    Attributes:
        mode: ``optimized`` (the paper's method) or ``standard`` (the fixed ring).
        drones: How many drones to use, None for all.
        pictures: How many pictures in all.
        train_seconds: Training time of the judged field after the last picture; 0 takes
            pictures only.
        name: A name for people, also part of the run folder's name.
        seed: Seed of planning and training.
        overrides: Reason by checklist item that shall not keep the capture on the ground.
    """

    mode: Mode = "optimized"
    drones: int | None = None
    pictures: int = 24
    train_seconds: float = 60.0
    name: str = ""
    seed: int = 0
    overrides: Mapping[str, str] = field(default_factory=dict[str, str])


@dataclass(frozen=True, slots=True)
class CaptureRecord:
    """A capture as it stands: its newest ``CaptureChanged`` and what it was asked to be."""

    request: CaptureRequest
    status: CaptureChanged
    started_at: datetime
    metrics: dict[str, object] | None


@dataclass(frozen=True, slots=True)
class Sticks:
    """How somebody pushes the sticks of a drone flown by hand, each from -1 to 1.

    Attributes:
        forward: To where the drone looks.
        left: To its left.
        up: Upwards.
        turn: To the left, seen from above counter-clockwise.
    """

    forward: float
    left: float
    up: float
    turn: float


AT_REST = Sticks(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class StartPlace:
    """Where a drone is set down before a flight.

    Attributes:
        drone_id: Which drone.
        name: Its display name.
        colour: Its display colour, ``#rrggbb``.
        address: Where it is reached; empty when it is searched for.
        serial: Its serial number; empty means any.
        x_m: Place on the floor, world metres from the middle of the start circle.
        y_m: Likewise; +X is where drone 1 nominally stands, +Y is to its right as it looks in.
        yaw_rad: Heading, counter-clockwise from +X.
        focal_px: Focal length of its camera, pixels of its own picture.
        tilt_deg: How far its camera looks below the horizon.
        calibrated: False while the camera is taken to be a usual Tello's.
    """

    drone_id: str
    name: str
    colour: str
    address: str
    serial: str
    x_m: float
    y_m: float
    yaw_rad: float
    focal_px: float = TELLO_INTRINSICS.fx
    tilt_deg: float = math.degrees(TELLO_TILT_RAD)
    calibrated: bool = False


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """Where everything is before a flight.

    Attributes:
        start_radius_m: Radius of the start circle; the object stands in its middle.
        fence_radius_m: No drone flies farther from the middle than this.
        ceiling_m: Nor higher.
        places: The drones' places, in fleet order.
    """

    start_radius_m: float
    fence_radius_m: float
    ceiling_m: float
    places: tuple[StartPlace, ...]


@dataclass(frozen=True, slots=True)
class DatagramCounts:
    """A drone's datagrams that were of no use, since the start.

    Attributes:
        dropped: Those from it that said nothing, by reason.
        unsent: Those to it that could not be handed to the network.
        video_overflows: Times all video that waited to be decoded was dropped.
    """

    dropped: Mapping[str, int]
    unsent: int
    video_overflows: int


class MissionControl(Protocol):
    """What console and shell may do; every method is called on the event loop.

    Stops are not here on purpose: they go straight to the fleet through ``StopControl``.
    """

    events: EventStream

    @property
    def calibrations(self) -> CalibrationControl:
        """What may be asked of the calibrations of the cameras."""
        ...

    def drones(self) -> list[DroneReported]:
        """Return the newest report of every drone, in fleet order."""
        ...

    def newest_frame(self, drone_id: str) -> FrameAnnotated | None:
        """Return the newest annotated picture; raises UnknownError."""
        ...

    def standing(self) -> list[Event]:
        """Return the events a newcomer needs to see the present state (seed, plan, captures...)."""
        ...

    async def command_drone(self, drone_id: str, command: DroneCommand) -> None:
        """Carry out one drone's command; raises UnknownError or RefusedError."""
        ...

    def steer(self, drone_id: str, sticks: Sticks) -> None:
        """Fly a drone by hand for a moment; silence lets it hover.

        Raises:
            UnknownError: If there is no such drone.
            RefusedError: If it does not fly, or a capture flies it.
        """
        ...

    async def start_capture(self, request: CaptureRequest) -> CaptureRecord:
        """Begin a capture; raises RefusedError (one at a time) or ValueError (bad numbers)."""
        ...

    def captures(self) -> list[CaptureRecord]:
        """Return all known captures, newest first."""
        ...

    def capture(self, capture_id: str) -> CaptureRecord:
        """Return one capture; raises UnknownError."""
        ...

    async def pause_capture(self, capture_id: str) -> CaptureRecord:
        """Hold position and stop the mission's clock; raises UnknownError or RefusedError."""
        ...

    async def resume_capture(self, capture_id: str) -> CaptureRecord:
        """Go on; raises UnknownError or RefusedError."""
        ...

    async def add_pictures(self, capture_id: str, count: int) -> CaptureRecord:
        """Take so many pictures more than was asked for, from where they add most.

        Raises:
            UnknownError: If there is no such capture.
            RefusedError: If it takes no more: its drones are on their way down, it flies the
                standard ring, or there would be too many.
        """
        ...

    async def view_field(self, capture_id: str, view: FieldView | None) -> None:
        """See previews of a capture's field from ``view``, None: from the orbit.

        Raises:
            UnknownError: If there is no such capture.
            RefusedError: If its field is not being trained, or nothing can be seen from there.
        """
        ...

    async def abort_capture(self, capture_id: str) -> CaptureRecord:
        """Land all drones and end; what was taken stays; raises UnknownError or RefusedError."""
        ...

    def point_out(self, drone_id: str, place: PointedPlace) -> ObjectPointedOut:
        """Say where the object is in a drone's newest picture.

        Raises:
            UnknownError: If there is no such drone.
            RefusedError: If the drone has no live picture.
        """
        ...

    def search_object(self, drone_id: str) -> None:
        """Let a drone search the object without help again; raises UnknownError."""
        ...

    def priorities(self) -> Sequence[PriorityPart]:
        """Return the parts of the object that the operator wants to have better pictures of."""
        ...

    def add_priority(
        self, drone_id: str, drawn: tuple[float, float, float, float], weight: float
    ) -> PriorityPart:
        """Want better pictures of what a box drawn in a drone's newest picture shows.

        Args:
            drone_id: In whose picture it was drawn.
            drawn: Left, top, right, bottom as shares 0 to 1 of the picture.
            weight: How many times as much as elsewhere a patch of surface there counts.

        Raises:
            UnknownError: If there is no such drone.
            RefusedError: If the drone does not fly in a capture, has no live picture, or shows
                nothing of the object there.
        """
        ...

    def drop_priorities(self, part_id: str | None = None) -> None:
        """Forget one part of priority, or all when None; raises UnknownError."""
        ...

    def no_go(self) -> Sequence[NoGoVolume]:
        """Return the volumes that no drone may enter."""
        ...

    async def add_no_go(self, area: Area) -> NoGoVolume:
        """Let no drone enter what is on and above a rectangle of the floor any more.

        Raises:
            RefusedError: If there are too many, or it is none.
        """
        ...

    async def change_no_go(self, volume_id: str, area: Area) -> NoGoVolume:
        """Give a volume another place; raises UnknownError or RefusedError."""
        ...

    async def drop_no_go(self, volume_id: str | None = None) -> None:
        """Forget a volume, or all when None; raises UnknownError or RefusedError."""
        ...

    def preflight(self) -> Sequence[Check]:
        """Return the preflight checklist as it stands now."""
        ...

    def failsafes(self) -> Sequence[Failsafe]:
        """Return the failsafe table, row by row."""
        ...

    def disk_free_mb(self) -> float | None:
        """Return the free room on the disk of the runs, megabytes, None before it was measured."""
        ...

    def datagram_counts(self) -> Mapping[str, DatagramCounts]:
        """Return, per drone, which datagrams were of no use."""
        ...

    def note_stop(self, command: StopCommand, drone_id: str | None) -> None:
        """Tell everybody that an operator has ordered a stop, which is under way already."""
        ...

    def note_operator(self) -> None:
        """Note a sign of life of the operator in command; from now on silence is a failsafe."""
        ...

    def release_operator(self) -> None:
        """Fly on without an operator: nobody's silence counts until the next sign of life."""
        ...

    async def delete_capture(self, capture_id: str) -> None:
        """Delete a capture and its run folder for good, with the fields trained anew on it.

        Raises:
            UnknownError: If there is no such capture.
            RefusedError: If it is not over yet, or a folder cannot be deleted.
            StillTrainedError: If somebody trains on it, here or elsewhere; nothing is deleted.
        """
        ...

    def floor_plan(self) -> FloorPlan:
        """Return where the drones are set down."""
        ...

    def configuration(self) -> Mapping[str, object]:
        """Return by group the frozen config that flies, the groups named as in the settings."""
        ...

    def run_folder(self, capture_id: str) -> Path:
        """Return the run folder of a capture or of a training beside it; raises UnknownError."""
        ...
