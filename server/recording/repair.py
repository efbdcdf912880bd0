"""Makes a recording whole whose writer was killed, so that any viewer opens it."""

from __future__ import annotations

import fcntl
import logging
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from server.drafts import drafted
from server.recording.mcap_file import LIBRARY
from server.recording.reading import Recording, RecordingError
from server.recording.reserved_file import forget_reserve

_LOG = logging.getLogger(__name__)

_MAGIC = b"\x89MCAP0\r\n"
_CHUNK_BYTES = 1 << 20
# What a copy may need beyond the size of what it copies.
_ROOM_BYTES = 64 << 20


def is_whole(path: Path) -> bool:
    """Return whether a file ends as an MCAP file must."""
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - len(_MAGIC)))
        return size > 2 * len(_MAGIC) and stream.read() == _MAGIC


def repair(path: Path) -> bool:
    """Make a recording whole; returns whether anything was done.

    A file that somebody still writes is left alone, and so is a whole one. The copy replaces the
    original only once it is complete.

    Raises:
        OSError: If it cannot be read or rewritten.
        RecordingError: If it is no recording at all.
    """
    with path.open("rb") as original:
        try:
            # A recorder locks its file exclusively for as long as it lives.
            fcntl.flock(original, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        forget_reserve(path)
        if is_whole(path):
            return False
        if shutil.disk_usage(path.parent).free < path.stat().st_size + _ROOM_BYTES:
            raise OSError(f"{path}: no room on the disk for a repaired copy")
        with drafted(path) as copy:
            _copy_whole(Recording(path), copy)
    return True


def repair_all(paths: Iterable[Path]) -> list[Path]:
    """Repair every recording that needs it; returns those repaired, logs those that cannot be."""
    repaired: list[Path] = []
    for path in paths:
        try:
            if repair(path):
                repaired.append(path)
        except (OSError, RecordingError) as error:
            _LOG.warning("a recording could not be repaired: %s", error)
    return repaired


def _copy_whole(recording: Recording, path: Path) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=_CHUNK_BYTES, compression=CompressionType.NONE)
        writer.start(library=LIBRARY)
        schemas = {0: 0}
        channels: dict[int, int] = {}
        for record in recording.contents():
            match record:
                case Schema():
                    if record.id not in schemas:
                        schemas[record.id] = writer.register_schema(
                            record.name, record.encoding, record.data
                        )
                case Channel():
                    if record.id not in channels:
                        channels[record.id] = writer.register_channel(
                            record.topic,
                            record.message_encoding,
                            schemas[record.schema_id],
                            record.metadata,
                        )
                case Message():
                    writer.add_message(
                        channels[record.channel_id],
                        record.log_time,
                        record.data,
                        record.publish_time,
                        record.sequence,
                    )
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
        writer.finish()
