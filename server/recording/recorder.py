"""The flight recorder: notes come in on the event loop, a thread writes them to the disk.

Nothing that flies ever waits for it. What waits to be written is bounded in bytes; beyond that,
notes are dropped and counted. A full or failing disk ends the recording, not the flight.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from server.recording.config import RecordingConfig
from server.recording.mcap_file import McapFile, Recordable
from server.recording.times import TimeBase
from server.recording.video import VideoNotes

_LOG = logging.getLogger(__name__)

# What a small note counts for while it waits, bytes.
_NOTE_BYTES = 1024

Make = Callable[[], Recordable]


def free_bytes(path: Path) -> int:
    """Return the room left on the disk that holds ``path``, bytes."""
    return shutil.disk_usage(path).free


@dataclass(frozen=True, slots=True)
class _Note:
    """Something to be written: makes its message in the writing thread."""

    topic: str
    make: Make
    at_s: float
    about_s: float

    def write(self, file: McapFile, video: VideoNotes, base: TimeBase) -> None:
        file.write(self.topic, self.make(), base.ns(self.at_s), base.ns(self.about_s))


@dataclass(frozen=True, slots=True)
class _VideoNote:
    """A video datagram; ``gap`` when one before it was dropped here."""

    drone_id: str
    datagram: bytes
    at_s: float
    gap: bool

    def write(self, file: McapFile, video: VideoNotes, base: TimeBase) -> None:
        video.write(file, self.drone_id, self.datagram, self.at_s, self.gap)


@dataclass(frozen=True, slots=True)
class RecorderState:
    """How a recording stands.

    Attributes:
        messages: Written so far.
        dropped: Notes lost because the disk was too slow.
        ended: Why it has ended before it was closed, None while it has not.
    """

    messages: int
    dropped: int
    ended: str | None


class FlightRecorder:
    """One recording; ``note`` and ``film`` return at once and never raise.

    Attributes:
        path: The file.
        base: The recording's time axis.
    """

    def __init__(
        self,
        path: Path,
        config: RecordingConfig,
        clock: Callable[[], float] = time.monotonic,
        *,
        on_end: Callable[[str], None] | None = None,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        """Build it; ``open`` begins.

        Args:
            path: The file to be made.
            config: Its bounds.
            clock: Monotonic seconds, the same as that of all times noted.
            on_end: Called, in the writing thread, with the reason when the recording ends by
                itself.
            free: Room left on the disk of a path, bytes.
        """
        self.path = path
        self.base = TimeBase.now(clock)
        self._config = config
        self._on_end = on_end
        self._free = free
        self._changed = threading.Condition()
        self._waiting: deque[tuple[_Note | _VideoNote, int]] = deque()
        self._waiting_bytes = 0
        self._gaps: set[str] = set()
        self._dropped = 0
        self._closing = False
        self._ended: str | None = None
        self._file: McapFile | None = None
        self._thread: threading.Thread | None = None

    def open(self, about: Mapping[str, Mapping[str, str]]) -> None:
        """Create the file with ``about`` as its metadata and begin to write; may block shortly.

        Raises:
            OSError: If the file cannot be made or the disk is too full.
        """
        room = self._free(self.path.parent)
        if room < self._config.min_free_bytes:
            raise OSError(self._too_full(room))
        self._file = McapFile(self.path, self._config.chunk_bytes, self._config.max_bytes)
        for name, fields in about.items():
            self._file.describe(name, fields)
        self._thread = threading.Thread(target=self._run, name="flight recorder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write what waits and end the file; blocks, at most for ``close_s``."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(self._config.close_s)
            if self._thread.is_alive():
                _LOG.error("%s: the disk does not take the end of the recording", self.path)

    @property
    def state(self) -> RecorderState:
        """How the recording stands."""
        written = 0 if self._file is None else self._file.messages
        return RecorderState(written, self._dropped, self._ended)

    # Notes -----------------------------------------------------------------------------------

    def note(
        self, topic: str, make: Make, at_s: float, about_s: float | None = None, weight: int = 0
    ) -> None:
        """Note a message.

        Args:
            topic: Where it belongs.
            make: Makes it, in the writing thread: what it uses must not change any more.
            at_s: When it arrived.
            about_s: The time it is about; without it, ``at_s``.
            weight: Bytes it holds on to until it is written, if many.
        """
        about_s = at_s if about_s is None else about_s
        self._offer(_Note(topic, make, at_s, about_s), _NOTE_BYTES + weight)

    def film(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Note a video datagram."""
        note = _VideoNote(drone_id, datagram, at_s, drone_id in self._gaps)
        if self._offer(note, len(datagram)):
            self._gaps.discard(drone_id)
        else:
            self._gaps.add(drone_id)

    def _offer(self, note: _Note | _VideoNote, size: int) -> bool:
        with self._changed:
            if self._closing or self._ended is not None:
                return False
            if self._waiting_bytes + size > self._config.waiting_bytes:
                self._dropped += 1
                return False
            self._waiting.append((note, size))
            self._waiting_bytes += size
            # The writer looks every so often by itself; waking it for each datagram would cost
            # the event loop more than the note does.
        return True

    # The thread ------------------------------------------------------------------------------

    def _run(self) -> None:
        file = self._file
        assert file is not None
        try:
            reason = self._write_on(file)
        except OSError as error:
            reason = f"the disk does not take the recording: {error.strerror or error}"
        except Exception:  # noqa: BLE001  # Whatever it is, the flight goes on without a recording.
            _LOG.exception("%s: recording failed", self.path)
            reason = "the recorder failed, see the log"
        with self._changed:
            self._ended = reason
            self._waiting.clear()
            self._waiting_bytes = 0
        try:
            file.finish()
        except OSError as error:
            _LOG.warning("%s: ended without its index: %s", self.path, error)
        if reason is not None and self._on_end is not None:
            self._on_end(reason)

    def _write_on(self, file: McapFile) -> str | None:
        """Write until told to close; returns why it has to end earlier, or None."""
        video = VideoNotes(self.base)
        flushed_s = time.monotonic()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing, self._config.flush_s / 4.0)
                batch, closing = list(self._waiting), self._closing
                self._waiting.clear()
            for note, size in batch:
                if file.size_if_ended(size + _NOTE_BYTES) > self._config.max_bytes:
                    return f"it has reached its limit of {_megabytes(self._config.max_bytes)}"
                note.write(file, video, self.base)
                if file.full:
                    return "the disk is full"
                with self._changed:
                    self._waiting_bytes -= size
            if closing:
                return None
            if time.monotonic() - flushed_s >= self._config.flush_s:
                flushed_s = time.monotonic()
                file.flush()
                if file.full:
                    return "the disk is full"
                room = self._free(self.path.parent)
                if room < self._config.min_free_bytes:
                    return self._too_full(room)

    def _too_full(self, room: int) -> str:
        least = _megabytes(self._config.min_free_bytes)
        return f"the disk is nearly full ({_megabytes(room)} left, {least} must stay free)"


def _megabytes(count: int) -> str:
    return f"{count / 1e6:.0f} MB"
