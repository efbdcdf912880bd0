"""What a recording puts in the place of drones and their eyes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.events import FrameAnnotated
from server.mission.eyes import PictureSearch, Sight
from server.planner.config import PlannerConfig
from server.recording.reading import RecordingError
from server.stages import Frame, Setpoint, Telemetry
from server.swarm.config import DroneConfig, SafetyConfig
from server.swarm.failsafes import FlightReadings
from server.swarm.flight_watch import Activity
from server.vision.config import RegionConfig, VisionConfig
from server.vision.region import RegionPrior

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FlightDescription:
    """What a recording says of its flight.

    Attributes:
        drones: The drones, in fleet order.
        start_radius_m: Radius of the start circle.
        config: Numbers of everything that flew.
        request: The capture that was flown, None when there was none.
        wall_ns: Where its time axis begins, nanoseconds since 1970.
    """

    drones: tuple[DroneConfig, ...]
    start_radius_m: float
    config: FlightConfig
    request: CaptureRequest | None
    wall_ns: int


def described(metadata: Mapping[str, Mapping[str, str]]) -> FlightDescription:
    """Return the description of a flight.

    Raises:
        RecordingError: If the recording holds none that can be read.
    """
    fields = metadata.get("dronerf")
    if fields is None:
        raise RecordingError("it was not recorded by dronerf")

    def read(kind: type, name: str) -> object:
        return TypeAdapter(kind).validate_python(json.loads(fields[name]))

    try:
        config = FlightConfig(
            read(MissionConfig, "mission"),  # pyright: ignore[reportArgumentType]
            read(PlannerConfig, "planner"),  # pyright: ignore[reportArgumentType]
            read(VisionConfig, "vision"),  # pyright: ignore[reportArgumentType]
            read(SafetyConfig, "safety"),  # pyright: ignore[reportArgumentType]
        )
        drones = TypeAdapter(tuple[DroneConfig, ...]).validate_python(json.loads(fields["drones"]))
        request = TypeAdapter(CaptureRequest | None).validate_python(json.loads(fields["request"]))
        radius_m = float(json.loads(fields["start_radius_m"]))
        return FlightDescription(drones, radius_m, config, request, int(fields["wall_ns"]))
    except KeyError as error:
        raise RecordingError(f"its description lacks {error}") from error
    except (ValidationError, ValueError) as error:
        line = str(error).splitlines()[0]
        raise RecordingError(f"its description cannot be read: {line}") from error


@dataclass(slots=True)
class RecordedDrone:
    """A drone as its recorded reports show it; stands in for ``server.swarm.drone.Drone``.

    Attributes:
        config: Who it is.
        telemetry: Newest state report so far.
        activity: What it was believed to be doing.
        held: Never: what was held back is part of the recorded flight.
    """

    config: DroneConfig
    telemetry: Telemetry | None = None
    activity: Activity = "offline"
    held: bool = False

    @property
    def airborne(self) -> bool:
        """Whether it was in the air."""
        return self.activity in ("taking_off", "flying", "holding", "landing")

    def observe_flight(self, readings: FlightReadings, now_s: float) -> None:
        """Take no notice: the flight is over."""

    def set_setpoint(self, setpoint: Setpoint, now_s: float) -> bool:
        """Refuse: nobody flies."""
        return False


class RecordedEye:
    """Searches recorded pictures as the mission's eye does; an ``Eye``."""

    def __init__(self, drone: DroneConfig, config: RegionConfig, turn: float) -> None:
        """Build it; ``turn`` as ``CameraEye`` takes it."""
        self.sight: Sight | None = None
        self.annotated: FrameAnnotated | None = None
        self._search = PictureSearch(drone.intrinsics, config, turn)
        self._expected: RegionPrior | None = None

    def expect(self, prior: RegionPrior | None) -> None:
        """Say where the object should be in the next pictures."""
        self._expected = prior

    def point_out(self, xyxy_px: Array | None) -> None:
        """Say where the object is in the next picture."""
        self._search.point_out(xyxy_px)

    def look(self, frame: Frame) -> Sight:
        """Search a picture."""
        self.sight = self._search.look(frame, self._expected)
        return self.sight

    async def run(self) -> None:
        """Do nothing: pictures come from the file."""


@dataclass(frozen=True, slots=True)
class StartCircle:
    """The part of a fleet's config that a pilot asks for.

    Attributes:
        start_radius_m: Radius of the start circle.
    """

    start_radius_m: float


@dataclass(frozen=True, slots=True)
class RecordedFleet:
    """All recorded drones; stands in for ``server.swarm.fleet.Fleet``.

    Attributes:
        config: Where they start.
        drones: By id, in fleet order.
    """

    config: StartCircle
    drones: dict[str, RecordedDrone] = field(default_factory=dict[str, RecordedDrone])

    @property
    def crew(self) -> list[str]:
        """Those that fly, in fleet order."""
        return [d for d, drone in self.drones.items() if drone.activity in ("flying", "holding")]
