"""Records one flight: what the drones say and hear, what is believed, seen, planned and told.

The file is ``recording.mcap`` in the run folder, from the start of a capture to its landing, or
whatever ``dronerf record`` was told. Whatever is wrong with it, the flight goes on.
"""

from __future__ import annotations

import asyncio
import dataclasses
import json
import logging
import re
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from server.geometry.boxes import Box3
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig
from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    DroneReported,
    Event,
    EventStream,
    FailsafeFired,
    FrameAnnotated,
    NoGoChanged,
    Noted,
    PlanFound,
    PoseEstimated,
    PreviewRendered,
    SeedFitted,
    TrainingProgressed,
)
from server.mission.eyes import Eye
from server.mission.phases import Phase
from server.recording.config import RecordingConfig
from server.recording.json_messages import (
    JsonMessage,
    datagram_message,
    telemetry_message,
)
from server.recording.messages import (
    annotations_message,
    calibration_message,
    log_message,
    pose_message,
    transforms_message,
)
from server.recording.recorder import FlightRecorder, RecorderState, free_bytes
from server.recording.scene_messages import (
    drones_message,
    fence_message,
    no_go_message,
    plan_message,
    seed_message,
)
from server.stages import Telemetry
from server.swarm.fleet import Fleet

logger = logging.getLogger(__name__)

RECORDING = "recording.mcap"

_WAITING_EVENTS = 4096
# A Tello reports ten times a second.
_LAST_REPORTS_S = 0.5
# These tell no more than other topics do, or nothing of the flight.
_LEFT_OUT = (
    DroneReported,
    FrameAnnotated,
    PoseEstimated,
    PreviewRendered,
    TrainingProgressed,
)
# Once it is here, a capture has landed for good.
_LANDED = {phase.value for phase in (Phase.TRAIN, Phase.DONE, Phase.ENDED)}


@dataclasses.dataclass(frozen=True, slots=True)
class Scenery:
    """Whose flight is recorded.

    Attributes:
        fleet: The drones.
        eyes: One eye per drone.
        events: What happens.
        config: Numbers of everything that flies; they go into the file for the replay.
    """

    fleet: Fleet
    eyes: Mapping[str, Eye]
    events: EventStream
    config: FlightConfig


class FlightRecording:
    """One recording: a ``Listener`` to the drones and a follower of events.

    An async context manager: entering opens the file, leaving ends it.
    """

    def __init__(
        self,
        path: Path,
        scenery: Scenery,
        config: RecordingConfig,
        request: CaptureRequest | None = None,
        *,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Build it; inside a running event loop, whose clock is that of all times.

        Args:
            path: The file to be made.
            scenery: Whose flight.
            config: Bounds of the file.
            request: The capture that is flown, None for none.
            free: Room left on a disk, bytes.
        """
        self._scenery = scenery
        self._request = request
        self._loop = asyncio.get_running_loop()
        self._recorder = FlightRecorder(
            path, config, self._loop.time, on_end=self._on_end, free=free
        )
        self._pictures: dict[str, int] = {}
        self._following: asyncio.Task[None] | None = None
        self._landed = asyncio.Event()

    async def __aenter__(self) -> FlightRecording:
        """Begin; raises OSError when the file cannot be made."""
        await asyncio.to_thread(self._recorder.open, {"dronerf": self._description()})
        self._set_scene()
        self._following = asyncio.create_task(self._follow(), name="flight recording")
        self._scenery.fleet.tap.attach(self)
        return self

    async def __aexit__(self, *_: object) -> None:
        self._scenery.fleet.tap.detach(self)
        if self._following is not None:
            self._following.cancel()
            await asyncio.gather(self._following, return_exceptions=True)
        await asyncio.to_thread(self._recorder.close)
        if self.state.dropped:
            self._tell("warning", f"The recording lacks {self.state.dropped} notes: slow disk.")

    @property
    def state(self) -> RecorderState:
        """How the recording stands."""
        return self._recorder.state

    async def until_landed(self) -> None:
        """Wait until the capture has landed for good."""
        await self._landed.wait()

    # What the drones say and hear ------------------------------------------------------------

    def sent(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Record a command."""
        self._recorder.note(f"/{drone_id}/commands", lambda: datagram_message(datagram), at_s)

    def replied(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Record a reply."""
        self._recorder.note(f"/{drone_id}/replies", lambda: datagram_message(datagram), at_s)

    def reported(self, telemetry: Telemetry, activity: str) -> None:
        """Record a state report."""
        at_s = telemetry.received_s
        received_ns = self._recorder.base.ns(at_s)
        self._recorder.note(
            f"/{telemetry.drone_id}/telemetry",
            lambda: telemetry_message(telemetry, activity, received_ns),
            at_s,
        )

    def filmed(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Record a video datagram."""
        self._recorder.film(drone_id, datagram, at_s)

    # What happens ----------------------------------------------------------------------------

    async def _follow(self) -> None:
        with self._scenery.events.subscribe(_WAITING_EVENTS) as subscription:
            async for event in subscription:
                try:
                    self._record(event, self._loop.time())
                except Exception:  # One strange event must not cost the rest.
                    logger.exception("%s could not be recorded", type(event).__name__)
                if isinstance(event, CaptureChanged) and _has_landed(event):
                    self._landed.set()

    def _record(self, event: Event, now_s: float) -> None:
        note, ns = self._recorder.note, self._recorder.base.ns
        match event:
            case FrameAnnotated():
                self._record_sight(event.drone_id, now_s)
            case PoseEstimated(pose=pose):
                at_s, T = pose.at_s, pose.T_world_cam
                drone_id = pose.drone_id
                note(f"/{drone_id}/pose", lambda: pose_message(T, ns(at_s)), now_s, at_s)
                note("/tf", lambda: transforms_message(drone_id, T, ns(at_s)), now_s, at_s)
            case SeedFitted(seed=seed):
                note("/scene", lambda: seed_message(seed, ns(now_s)), now_s)
            case NoGoChanged(volumes=volumes):
                boxes = [volume.box for volume in volumes]
                note("/scene", lambda: no_go_message(boxes, ns(now_s)), now_s)
            case PlanFound(assignment=assignment):
                rounds = [list(row.items()) for row in assignment.rounds]
                drones = [drone.config for drone in self._scenery.fleet.drones.values()]
                tilts_rad = {d.id: float(np.deg2rad(d.tilt_deg)) for d in drones}
                colours = {d.id: d.colour for d in drones}
                note("/scene", lambda: plan_message(rounds, tilts_rad, colours, ns(now_s)), now_s)
            case Noted(level=level, text=text, drone_id=about):
                name = about or "fleet"
                note("/log", lambda: log_message(level, text, name, ns(now_s)), now_s)
            case FailsafeFired():
                text = f"failsafe {event.event}: {event.action}: {event.text}"
                name = event.drone_id
                note("/log", lambda: log_message("warning", text, name, ns(now_s)), now_s)
        if not isinstance(event, _LEFT_OUT):
            note("/events", lambda: event_message(event), now_s)

    def _record_sight(self, drone_id: str, now_s: float) -> None:
        sight = self._scenery.eyes[drone_id].sight
        if sight is None or self._pictures.get(drone_id) == sight.frame.sequence:
            return
        self._pictures[drone_id] = sight.frame.sequence
        drone = self._scenery.fleet.drones[drone_id].config
        at_s, region, box = sight.frame.captured_s, sight.region, sight.box
        weight = 0 if region is None else region.mask.nbytes
        captured_ns = self._recorder.base.ns(at_s)
        self._recorder.note(
            f"/{drone_id}/annotations",
            lambda: annotations_message(drone.label, drone.colour, region, box, captured_ns),
            now_s,
            at_s,
            weight,
        )

    # The beginning and the end ---------------------------------------------------------------

    def _set_scene(self) -> None:
        now_s, drones = self._loop.time(), [d.config for d in self._scenery.fleet.drones.values()]
        note, now_ns = self._recorder.note, self._recorder.base.ns(now_s)
        for drone in drones:
            make = _bound(calibration_message, drone.id, drone.intrinsics, now_ns)
            note(f"/{drone.id}/calibration", make, now_s)
        safety = self._scenery.config.safety
        fence = (safety.fence_radius_m, safety.floor_m, safety.ceiling_m)
        note("/scene", lambda: fence_message(*fence, now_ns), now_s)
        no_go = np.array(self._scenery.config.planner.space.no_go).reshape(-1, 2, 3)
        boxes = [Box3(lower, upper) for lower, upper in no_go]
        note("/scene", lambda: no_go_message(boxes, now_ns), now_s)
        tags = [(drone.id, drone.label, drone.colour) for drone in drones]
        note("/scene", lambda: drones_message(tags, now_ns), now_s)

    def _description(self) -> dict[str, str]:
        """Return what a replay has to know, as JSON texts."""
        fleet, config, base = self._scenery.fleet, self._scenery.config, self._recorder.base
        return {
            "version": version("dronerf"),
            "drones": json.dumps([dataclasses.asdict(d.config) for d in fleet.drones.values()]),
            "start_radius_m": json.dumps(fleet.config.start_radius_m),
            "vision": json.dumps(dataclasses.asdict(config.vision), default=str),
            "planner": json.dumps(dataclasses.asdict(config.planner), default=str),
            "safety": json.dumps(dataclasses.asdict(config.safety), default=str),
            "mission": json.dumps(dataclasses.asdict(config.mission), default=str),
            "request": json.dumps(
                None if self._request is None else dataclasses.asdict(self._request)
            ),
            "wall_ns": str(base.wall_ns),
        }

    def _on_end(self, reason: str) -> None:
        """Tell the operator; called in the recorder's thread."""
        text = f"Recording ended: {reason}. The flight goes on; what was recorded stays."
        try:
            self._loop.call_soon_threadsafe(self._tell, "warning", text)
        except RuntimeError:
            logger.warning("%s", text)  # The loop is gone, and with it whoever would read it.

    def _tell(self, level: Any, text: str) -> None:
        logger.warning("%s", text)
        self._scenery.events.publish(Noted(level, text))


async def record_capture(
    recording: FlightRecording, events: EventStream, flight: asyncio.Task[None]
) -> None:
    """Record a capture until it has landed or ``flight`` is over; never raises.

    Args:
        recording: Where to.
        events: Where it is told why there is no recording.
        flight: The mission's task.
    """
    try:
        async with recording:
            landed = asyncio.create_task(recording.until_landed(), name="recording until landed")
            try:
                await asyncio.wait((landed, flight), return_when=asyncio.FIRST_COMPLETED)
            finally:
                landed.cancel()
            # The last drone's own report of standing on the ground comes after the mission's.
            await asyncio.sleep(_LAST_REPORTS_S)
    except OSError as error:
        logger.warning("no recording: %s", error)
        events.publish(Noted("warning", f"This flight is not recorded: {error}."))
    except Exception:  # The flight does not depend on it.
        logger.exception("recording failed")
        events.publish(Noted("warning", "The flight recorder failed; the flight goes on."))


def event_message(event: Event) -> JsonMessage:
    """Return an event as JSON: its name in words and its fields, pictures left out."""
    name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(event).__name__).lower()
    fields = dataclasses.asdict(event)
    if isinstance(event, CaptureTaken):
        del fields["thumbnail_jpeg"]
    return JsonMessage("dronerf.Event", {"event": name, **_plain(fields)})


def _plain(value: Any) -> Any:
    """Return ``value`` as JSON has it."""
    match value:
        case dict():
            return {str(key): _plain(entry) for key, entry in value.items()}
        case list() | tuple():
            return [_plain(entry) for entry in value]
        case np.ndarray() | np.generic():
            return _plain(value.tolist())
        case bytes():
            return f"{len(value)} bytes"
        case None | bool() | int() | float() | str():
            return value
        case _:
            return str(value)


def _has_landed(event: CaptureChanged) -> bool:
    return event.phase in _LANDED


def _bound(make: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    """Return ``make`` with its arguments, which a loop would change under a lambda."""
    return lambda: make(*arguments)
