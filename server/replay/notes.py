"""Recorded messages as the values they were made of; times in seconds of a clock to be given."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from google.protobuf.message import DecodeError

from server.recording.reading import RecordedMessage, RecordingError
from server.stages import Telemetry
from server.swarm.access_units import AccessUnit
from server.swarm.flight_watch import Activity


@dataclass(frozen=True, slots=True, eq=False)
class Reported:
    """A state report, and what the drone was believed to be doing."""

    telemetry: Telemetry
    activity: Activity


@dataclass(frozen=True, slots=True, eq=False)
class Filmed:
    """A coded picture of a drone."""

    drone_id: str
    unit: AccessUnit


@dataclass(frozen=True, slots=True, eq=False)
class Happened:
    """An event: its name and its fields."""

    name: str
    fields: dict[str, Any]


class NoteReader:
    """Reads the messages of one recording in their order."""

    def __init__(self, zero_ns: int) -> None:
        """Build it; times count from ``zero_ns``, nanoseconds since 1970."""
        self._zero_ns = zero_ns
        self._about: dict[str, dict[str, Any]] = {}

    def at_s(self, ns: int) -> float:
        """Return a time of the file in seconds."""
        return (ns - self._zero_ns) / 1e9

    def read(self, message: RecordedMessage) -> Reported | Filmed | Happened | None:
        """Return what a message means, None when a replay has no use for it.

        Raises:
            RecordingError: If it is not what its topic promises.
        """
        drone_id, _, kind = message.topic.removeprefix("/").rpartition("/")
        try:
            match kind:
                case "telemetry":
                    return self._reported(drone_id, json.loads(message.data))
                case "video_unit":
                    self._about[drone_id] = json.loads(message.data)
                case "video":
                    return self._filmed(drone_id, message.data)
                case "events":
                    fields = json.loads(message.data)
                    return Happened(fields["event"], fields)
        except (ValueError, KeyError, TypeError, DecodeError) as error:
            raise RecordingError(f"{message.topic}: unreadable message: {error}") from error
        return None

    def _reported(self, drone_id: str, fields: dict[str, Any]) -> Reported:
        activity = fields.pop("activity")
        vectors = ("velocity_m_s", "acceleration_m_s2")
        for name in vectors:
            fields[name] = np.array(fields[name], float)
        received_s = self.at_s(fields.pop("received_ns"))
        return Reported(Telemetry(drone_id, received_s, **fields), activity)

    def _filmed(self, drone_id: str, data: bytes) -> Filmed | None:
        about = self._about.pop(drone_id, None)
        if about is None:
            return None  # Cut off at the beginning of what was kept.
        unit = AccessUnit(
            CompressedVideo.FromString(data).data,
            self.at_s(about["captured_ns"]),
            self.at_s(about["completed_ns"]),
            about["key"],
            about["has_sets"],
            about["damaged"],
        )
        return Filmed(drone_id, unit)
