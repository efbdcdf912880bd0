"""Video on its way into a recording: datagrams become pictures as the driver's decoder sees them.

Each picture is two messages: what is known of it, and right behind that its bytes. Foxglove wants
parameter sets with every key picture; where they were lost, those last seen stand in.
"""

from __future__ import annotations

from server.recording.json_messages import video_unit_message
from server.recording.mcap_file import McapFile
from server.recording.messages import video_message
from server.recording.times import TimeBase
from server.swarm.access_units import AccessUnit, AccessUnits, parameter_sets


class _Stream:
    """One drone's stream."""

    def __init__(self) -> None:
        self.units = AccessUnits()
        self.sets = b""
        self.begun = False


class VideoNotes:
    """Writes the pictures of all drones."""

    def __init__(self, base: TimeBase) -> None:
        self._base = base
        self._streams: dict[str, _Stream] = {}

    def write(self, file: McapFile, drone_id: str, datagram: bytes, at_s: float, gap: bool) -> None:
        """Take a datagram and write the pictures it completes.

        Args:
            file: Where to.
            drone_id: Whose.
            datagram: As it came.
            at_s: When.
            gap: True when one before it is missing here.
        """
        stream = self._streams.setdefault(drone_id, _Stream())
        if gap:
            stream.units.lost()
        for unit in stream.units.feed(datagram, at_s):
            if unit.has_sets:
                stream.sets = parameter_sets(unit.data)
            # What comes before the first whole key picture nobody can decode.
            stream.begun = stream.begun or (unit.key and bool(stream.sets))
            if stream.begun:
                self._write_unit(file, drone_id, unit, stream.sets)

    def _write_unit(self, file: McapFile, drone_id: str, unit: AccessUnit, sets: bytes) -> None:
        captured_ns, completed_ns = self._base.ns(unit.captured_s), self._base.ns(unit.completed_s)
        about = video_unit_message(unit, captured_ns, completed_ns)
        file.write(f"/{drone_id}/video_unit", about, completed_ns, captured_ns)
        data = sets + unit.data if unit.key and not unit.has_sets else unit.data
        message = video_message(drone_id, data, captured_ns)
        file.write(f"/{drone_id}/video", message, completed_ns, captured_ns)
