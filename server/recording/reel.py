"""A recording made ready to be looked at: every drone's video as MP4, and who was where when.

The videos are the drones' own pictures in another box, not coded anew, so that an hour of flight
takes seconds. Times ``at_s`` are seconds since the first picture of any drone.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from av.container import OutputContainer
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame

from server.drafts import draft_of
from server.recording.reading import RecordedMessage, Recording, RecordingError

FOLDER, CONTENTS = "replay", "replay.json"

_TICKS_PER_S = 90_000
# Poses come ten times a second; for a drawing half of them are enough.
_WAY_STEP_S = 0.15
_USUAL_SIZE = (960, 720)
_SHARE_STEP = 0.01


@dataclass(slots=True)
class DroneReel:
    """What there is to see of one drone.

    Attributes:
        drone_id: Which drone.
        film: Its video's file name; None when there was none.
        begins_s: When its first picture came.
        way: Believed camera poses ``[at_s, x, y, z, heading]``, world metres and radians.
    """

    drone_id: str
    film: str | None = None
    begins_s: float = 0.0
    way: list[list[float]] = field(default_factory=list[list[float]])


@dataclass(frozen=True, slots=True)
class Moment:
    """Something that happened.

    Attributes:
        at_s: When.
        kind: ``picture``, or a log line's ``info``, ``warning`` or ``error``.
        drone_id: Whom it is about; empty for the fleet.
        text: What is said; a picture's number.
    """

    at_s: float
    kind: str
    drone_id: str
    text: str


@dataclass(slots=True)
class Reel:
    """A whole recording.

    Attributes:
        seconds: How long it is.
        drones: In fleet order.
        moments: What happened, in order.
        object_box: The object's last known box, lower and upper corner, world metres.
    """

    seconds: float = 0.0
    drones: list[DroneReel] = field(default_factory=list[DroneReel])
    moments: list[Moment] = field(default_factory=list[Moment])
    object_box: list[list[float]] | None = None


def make_reel(recording: Path, run: Path, on_share: Callable[[float], None] | None = None) -> Path:
    """Write ``replay/`` into the folder ``run``; return its table of contents.

    The folder is complete or not there.

    Args:
        recording: The recording's file.
        run: The run folder.
        on_share: Told about every per cent how much of the recording has been read, 0 to 1.

    Raises:
        RecordingError: If ``recording`` is none, or shows nothing.
        OSError: If a file cannot be written.
    """
    folder = run / FOLDER
    draft = draft_of(folder)
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    try:
        reel = _Cutter(draft).cut(Recording(recording), on_share)
        (draft / CONTENTS).write_text(json.dumps(asdict(reel)))
        shutil.rmtree(folder, ignore_errors=True)
        draft.replace(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return folder / CONTENTS


class _Film:
    """One drone's video on its way into an MP4 file."""

    def __init__(self, file: Path, size: tuple[int, int]) -> None:
        self._container: OutputContainer = av.open(
            str(file), "w", format="mp4", options={"movflags": "faststart"}
        )
        self._stream = self._container.add_mux_stream(
            "h264", rate=30, width=size[0], height=size[1], time_base=Fraction(1, _TICKS_PER_S)
        )
        self._last = -1

    def add(self, picture: bytes, at_s: float, *, key: bool) -> None:
        """Add a picture, ``at_s`` seconds after the first one."""
        packet = av.Packet(picture)
        packet.stream = self._stream
        packet.time_base = Fraction(1, _TICKS_PER_S)
        # Times of arrival jitter, and the file wants them to rise.
        self._last = max(self._last + 1, round(at_s * _TICKS_PER_S))
        packet.pts = packet.dts = self._last
        packet.is_keyframe = key
        self._container.mux(packet)

    def close(self) -> None:
        """End the file."""
        self._container.close()


class _Cutter:
    """Goes through a recording once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._reel = Reel()
        self._drones: dict[str, DroneReel] = {}
        self._films: dict[str, _Film] = {}
        self._sizes: dict[str, tuple[int, int]] = {}
        self._keys: dict[str, bool] = {}
        self._begun_ns: int | None = None

    def cut(self, recording: Recording, on_share: Callable[[float], None] | None) -> Reel:
        """Return what it holds, the films written."""
        told = 0.0
        try:
            for message in recording.messages():
                self._take(message)
                if on_share is not None and recording.share >= told + _SHARE_STEP:
                    told = recording.share
                    on_share(told)
        finally:
            for film in self._films.values():
                film.close()
        if not self._films:
            raise RecordingError("the recording has no picture that can be shown")
        self._reel.drones = list(self._drones.values())
        return self._reel

    def _take(self, message: RecordedMessage) -> None:
        drone_id, _, what = message.topic.lstrip("/").partition("/")
        match message.schema:
            case "foxglove.CameraCalibration":
                camera = CameraCalibration.FromString(message.data)
                self._sizes[drone_id] = (camera.width, camera.height)
                self._drone(drone_id)  # Cameras are told of first, in the order of the fleet.
            case "dronerf.VideoUnit":
                self._keys[drone_id] = bool(json.loads(message.data)["key"])
            case "foxglove.CompressedVideo":
                self._show(drone_id, message)
            case "foxglove.PoseInFrame" if what == "pose":
                self._move(drone_id, message)
            case "dronerf.Event":
                self._happen(message, json.loads(message.data))
            case _:
                pass

    def _at_s(self, ns: int) -> float:
        begun_ns = ns if self._begun_ns is None else self._begun_ns
        return round(max(0.0, (ns - begun_ns) / 1e9), 3)

    def _show(self, drone_id: str, message: RecordedMessage) -> None:
        if self._begun_ns is None:
            self._begun_ns = message.publish_ns
        at_s, drone = self._at_s(message.publish_ns), self._drone(drone_id)
        if drone_id not in self._films:
            drone.film, drone.begins_s = f"film-{len(self._films)}.mp4", at_s
            size = self._sizes.get(drone_id, _USUAL_SIZE)
            self._films[drone_id] = _Film(self._folder / drone.film, size)
        picture = CompressedVideo.FromString(message.data).data
        key = self._keys.get(drone_id, False)
        self._films[drone_id].add(picture, at_s - drone.begins_s, key=key)
        self._reel.seconds = max(self._reel.seconds, at_s)

    def _move(self, drone_id: str, message: RecordedMessage) -> None:
        at_s, way = self._at_s(message.publish_ns), self._drone(drone_id).way
        if way and at_s - way[-1][0] < _WAY_STEP_S:
            return
        pose = PoseInFrame.FromString(message.data).pose
        place, q = pose.position, pose.orientation
        # The camera's axis z, forward, as the world sees it.
        forward_x, forward_y = 2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x)
        heading = math.atan2(forward_y, forward_x)
        way.append([at_s, *(round(v, 3) for v in (place.x, place.y, place.z, heading))])

    def _happen(self, message: RecordedMessage, event: dict[str, Any]) -> None:
        if event.get("event") == "seed_fitted":
            outer = event["seed"]["outer"]
            self._reel.object_box = [outer["lower"], outer["upper"]]
        if event.get("event") == "capture_taken":
            capture = event["capture"]
            number = str(int(capture["index"]) + 1)
            self._note(message, "picture", str(capture["pose"]["drone_id"]), number)

        if event.get("event") == "noted":
            self._note(message, event["level"], event["drone_id"] or "", event["text"])

    def _note(self, message: RecordedMessage, kind: str, drone_id: str, text: str) -> None:
        self._reel.moments.append(Moment(self._at_s(message.log_ns), kind, drone_id, text))

    def _drone(self, drone_id: str) -> DroneReel:
        return self._drones.setdefault(drone_id, DroneReel(drone_id))
