"""Getting a recording back, whole or not.

A file is read from its beginning, chunk by chunk, so that one whose writer was killed gives all
that had reached the disk: whatever follows the last whole chunk is left out.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

# Longer than any record of ours; what claims more is damaged.
_LONGEST_RECORD_BYTES = 1 << 28
# What the reader raises at bytes that make no sense, among them a wrong checksum.
_DAMAGE = (McapError, CRCValidationError, struct.error, ValueError, OverflowError, RuntimeError)


class RecordingError(ValueError):
    """A file is no recording; the text says why in one line."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMessage:
    """One message.

    Attributes:
        topic: Where it was recorded.
        schema: What it is; its name, ``foxglove.CompressedVideo`` and the like.
        log_ns: When it arrived, nanoseconds since 1970.
        publish_ns: The time it is about, likewise.
        data: The message, coded.
    """

    topic: str
    schema: str
    log_ns: int
    publish_ns: int
    data: bytes


class Recording:
    """A recording to be read.

    Attributes:
        whole: Whether the file was ended properly; known once everything has been read.
        share: How much of the file has been read, 0 to 1.
    """

    def __init__(self, path: Path) -> None:
        """Take a file; raises RecordingError when it is none or no MCAP file."""
        self.whole = False
        self.share = 0.0
        self._path = path
        try:
            with path.open("rb") as stream:
                head = stream.read(8)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from error
        if head != b"\x89MCAP0\r\n":
            raise RecordingError(f"{path} is no MCAP file")

    def metadata(self) -> Mapping[str, Mapping[str, str]]:
        """Return the metadata at its beginning, by name."""
        found: dict[str, Mapping[str, str]] = {}
        for record in self._records():
            if isinstance(record, Metadata):
                found[record.name] = record.metadata
            elif isinstance(record, Chunk):
                break
        return found

    def messages(self) -> Iterator[RecordedMessage]:
        """Return all messages in the order in which they were written."""
        schemas: dict[int, str] = {}
        channels: dict[int, Channel] = {}
        for record in self.contents():
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                yield RecordedMessage(
                    channel.topic,
                    schemas.get(channel.schema_id, ""),
                    record.log_time,
                    record.publish_time,
                    record.data,
                )

    def contents(self) -> Iterator[Schema | Channel | Message | Metadata]:
        """Return schemas, channels, messages and metadata, chunks taken apart."""
        for record in self._records():
            if isinstance(record, Chunk):
                try:
                    yield from breakup_chunk(record, validate_crc=True)  # pyright: ignore[reportReturnType]
                except _DAMAGE:
                    return  # Damaged: nothing from here on can be trusted.
            elif isinstance(record, Schema | Channel | Message | Metadata):
                yield record

    def _records(self) -> Iterator[object]:
        with self._path.open("rb") as stream:
            size = max(1, os.fstat(stream.fileno()).st_size)
            reader = StreamReader(stream, emit_chunks=True, record_size_limit=_LONGEST_RECORD_BYTES)
            try:
                for record in reader.records:
                    # What follows the messages repeats what came before them.
                    if isinstance(record, Footer):
                        break
                    self.share = min(1.0, stream.tell() / size)
                    yield record
            except _DAMAGE:
                return
        self.whole = True
