"""One MCAP file being written: topics and schemas as they come up, chunks that reach the disk soon.

The file is locked while it is written, so that nobody repairs it meanwhile; the lock goes with the
process that holds it.
"""

from __future__ import annotations

import fcntl
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, cast

from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from server.recording.json_messages import SCHEMAS, JsonMessage
from server.recording.reserved_file import ReservedFile

Recordable = Message | JsonMessage

LIBRARY = "dronerf"
# What the end of a file may need beyond its messages: the summary, and so much for each chunk.
_SUMMARY_BYTES = 96 << 10
_CHUNK_INDEX_BYTES = 2 << 10
# What a message needs besides its data, its index entry included.
_MESSAGE_BYTES = 64
# Chunks are ended here, where their size is known to the byte.
_NEVER_BYTES = 1 << 40


class McapFile:
    """An MCAP file being written; used by one thread at a time.

    Attributes:
        messages: Written so far.
    """

    def __init__(self, path: Path, chunk_bytes: int, max_bytes: int) -> None:
        """Create the file.

        Args:
            path: Where.
            chunk_bytes: Messages reach the disk in chunks of about this size.
            max_bytes: How large it may become, for the room that its end needs.

        Raises:
            OSError: If it cannot be created.
            FileExistsError: If it is there already: no recording is ever overwritten.
        """
        self.messages = 0
        # Two chunks: the one that did not fit, and the one that was being filled meanwhile.
        end_bytes = _SUMMARY_BYTES + (max_bytes // chunk_bytes + 1) * _CHUNK_INDEX_BYTES
        self._stream = ReservedFile(path, 2 * chunk_bytes + end_bytes)
        fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Video does not get smaller, and an uncompressed chunk is open to any reader.
        self._writer = Writer(
            cast("BinaryIO", self._stream),
            chunk_size=_NEVER_BYTES,
            compression=CompressionType.NONE,
        )
        self._writer.start(library=LIBRARY)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, tuple[int, str]] = {}
        self._chunk_bytes = chunk_bytes
        self._pending_bytes = 0

    def describe(self, name: str, about: Mapping[str, str]) -> None:
        """Write metadata."""
        self._writer.add_metadata(name, dict(about))

    def write(self, topic: str, message: Recordable, log_ns: int, publish_ns: int) -> None:
        """Write a message.

        Args:
            topic: Where; all messages of a topic are of one kind.
            message: What.
            log_ns: When it arrived, nanoseconds since 1970.
            publish_ns: The time it is about, likewise.

        Raises:
            OSError: If the disk does not take it.
            ValueError: If the topic holds messages of another kind.
        """
        if isinstance(message, JsonMessage):
            kind, encoding, data = message.schema, "json", message.encoded()
        else:
            kind, encoding = message.DESCRIPTOR.full_name, "protobuf"
            data = message.SerializeToString()
        channel = self._channels.get(topic)
        if channel is None:
            schema_id = self._schema(kind, message)
            channel = (self._writer.register_channel(topic, encoding, schema_id), kind)
            self._channels[topic] = channel
        if channel[1] != kind:
            raise ValueError(f"{topic} holds {channel[1]}, not {kind}")
        self._writer.add_message(channel[0], log_ns, data, publish_ns, sequence=self.messages)
        self.messages += 1
        self._pending_bytes += len(data) + _MESSAGE_BYTES
        if self._pending_bytes >= self._chunk_bytes:
            self.flush()

    def _schema(self, kind: str, message: Recordable) -> int:
        if kind not in self._schemas:
            if isinstance(message, JsonMessage):
                schema_id = self._writer.register_schema(kind, "jsonschema", SCHEMAS[kind])
            else:
                schema_id = register_schema(self._writer, type(message))
            self._schemas[kind] = schema_id
        return self._schemas[kind]

    @property
    def full(self) -> bool:
        """Whether the disk is full: there is room for the end, and for nothing after it."""
        return self._stream.full

    def size_if_ended(self, more_bytes: int = 0) -> int:
        """Return an upper bound of the file's size if it ended after ``more_bytes`` of messages."""
        written = self._stream.tell() + self._pending_bytes + more_bytes
        chunks = written // self._chunk_bytes + 1
        return written + _SUMMARY_BYTES + chunks * _CHUNK_INDEX_BYTES

    def flush(self) -> None:
        """Hand everything to the operating system, as a whole chunk."""
        self._writer.flush()
        self._pending_bytes = 0

    def finish(self) -> None:
        """Write index and end, and close; raises OSError if the disk does not take them."""
        try:
            self._writer.finish()
        finally:
            self._stream.close()
