"""Messages for which Foxglove has no schema: JSON, each kind with a JSON schema of its own.

Lengths are metres, angles radians, times nanoseconds since 1970 (``*_ns``).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from server.stages import Telemetry
from server.swarm.access_units import AccessUnit
from server.swarm.protocol import split_label

_NUMBER, _TEXT, _FLAG, _WHOLE = (
    {"type": "number"},
    {"type": "string"},
    {"type": "boolean"},
    {"type": "integer"},
)
_VECTOR = {"type": "array", "items": _NUMBER}


def _schema(title: str, properties: dict[str, Any]) -> bytes:
    schema = {"title": title, "type": "object", "properties": properties}
    return json.dumps(schema).encode()


# By name: what Foxglove shows as fields to plot. An event has further fields of its kind.
SCHEMAS = {
    "dronerf.Telemetry": _schema(
        "dronerf.Telemetry",
        {
            "received_ns": _WHOLE,
            "activity": _TEXT,
            "yaw_rad": _NUMBER,
            "pitch_rad": _NUMBER,
            "roll_rad": _NUMBER,
            "velocity_m_s": _VECTOR,
            "acceleration_m_s2": _VECTOR,
            "height_m": _NUMBER,
            "tof_m": {"type": ["number", "null"]},
            "baro_m": _NUMBER,
            "battery_pct": _WHOLE,
            "temperature_c": _NUMBER,
            "motor_time_s": _NUMBER,
        },
    ),
    "dronerf.Datagram": _schema(
        "dronerf.Datagram", {"text": _TEXT, "label": {"type": ["integer", "null"]}}
    ),
    "dronerf.VideoUnit": _schema(
        "dronerf.VideoUnit",
        {
            "captured_ns": _WHOLE,
            "completed_ns": _WHOLE,
            "key": _FLAG,
            "has_sets": _FLAG,
            "damaged": _FLAG,
            "bytes": _WHOLE,
        },
    ),
    "dronerf.Event": _schema("dronerf.Event", {"event": _TEXT}),
}


@dataclass(frozen=True, slots=True)
class JsonMessage:
    """A message to be written as JSON.

    Attributes:
        schema: One of ``SCHEMAS``.
        content: Its fields.
    """

    schema: str
    content: dict[str, Any]

    def encoded(self) -> bytes:
        """Return the bytes; what JSON cannot hold becomes a list or text."""
        return json.dumps(self.content, default=_plain, separators=(",", ":")).encode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value)


def telemetry_message(telemetry: Telemetry, activity: str, received_ns: int) -> JsonMessage:
    """Return a state report and what the drone is believed to be doing since."""
    return JsonMessage(
        "dronerf.Telemetry",
        {
            "received_ns": received_ns,
            "activity": activity,
            "yaw_rad": telemetry.yaw_rad,
            "pitch_rad": telemetry.pitch_rad,
            "roll_rad": telemetry.roll_rad,
            "velocity_m_s": telemetry.velocity_m_s,
            "acceleration_m_s2": telemetry.acceleration_m_s2,
            "height_m": telemetry.height_m,
            "tof_m": telemetry.tof_m,
            "baro_m": telemetry.baro_m,
            "battery_pct": telemetry.battery_pct,
            "temperature_c": telemetry.temperature_c,
            "motor_time_s": telemetry.motor_time_s,
        },
    )


def datagram_message(datagram: bytes) -> JsonMessage:
    """Return a command or reply; bytes that are no text are shown as escapes."""
    label, body = split_label(datagram)
    text = body.decode("utf-8", "backslashreplace").rstrip("\r\n\0")
    return JsonMessage("dronerf.Datagram", {"text": text, "label": label})


def video_unit_message(unit: AccessUnit, captured_ns: int, completed_ns: int) -> JsonMessage:
    """Return what is known of a coded picture besides its bytes."""
    return JsonMessage(
        "dronerf.VideoUnit",
        {
            "captured_ns": captured_ns,
            "completed_ns": completed_ns,
            "key": unit.key,
            "has_sets": unit.has_sets,
            "damaged": unit.damaged,
            "bytes": len(unit.data),
        },
    )
