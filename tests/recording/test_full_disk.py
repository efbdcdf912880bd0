"""A disk that fills up under a recording: what was written stays readable, index and all."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest
from flights import SMALL, read_officially
from test_recorder import event, recorder, until

from server.recording import reserved_file
from server.recording.recorder import FlightRecorder
from server.recording.repair import is_whole, repair
from server.recording.reserved_file import ReservedFile


class SmallDisk:
    """Stands in for the disk below ``ReservedFile``: so many bytes and no more."""

    def __init__(self, monkeypatch, folder: Path, size: int):
        self.folder, self.size = folder, size
        self.reserved = self.used = 0
        self._write = os.write
        monkeypatch.setattr(reserved_file.os, "write", self.write)
        monkeypatch.setattr(reserved_file.os, "posix_fallocate", self.reserve)

    def room(self) -> int:
        held = self.reserved if list(self.folder.glob(".*.reserve")) else 0
        return self.size - self.used - held

    def reserve(self, fd: int, offset: int, count: int) -> None:
        if count > self.room():
            raise OSError(errno.ENOSPC, "No space left on device")
        self.reserved = count

    def write(self, fd: int, data: memoryview) -> int:
        fits = min(len(data), self.room())
        if fits <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.used += fits
        return self._write(fd, data[:fits])


@pytest.mark.parametrize("size", [420_000, 421_000, 433_333, 500_000])
def test_a_full_disk_ends_the_recording_with_its_index_and_nothing_lost(
    tmp_path, monkeypatch, size
):
    disk = SmallDisk(monkeypatch, tmp_path, size)
    reasons = []
    made = recorder(tmp_path, replace(SMALL, max_bytes=1 << 20), on_end=reasons.append)
    assert disk.reserved > 0
    noted = 0
    while not reasons:
        made.note("/events", lambda: event("x" * 500), 101.0)
        noted += 1
        until(lambda goal=noted: made.state.messages >= goal or bool(reasons))
    made.close()
    assert reasons == ["the disk is full"]
    assert is_whole(made.path)
    assert len(list(read_officially(made.path))) == made.state.messages > 20
    assert [file.name for file in tmp_path.iterdir()] == ["recording.mcap"]


def test_without_room_for_its_end_no_recording_begins(tmp_path, monkeypatch):
    SmallDisk(monkeypatch, tmp_path, 50_000)
    made = FlightRecorder(tmp_path / "recording.mcap", SMALL)
    with pytest.raises(OSError, match="No space"):
        made.open({})
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_writer_set_aside_is_freed(tmp_path):
    path = tmp_path / "recording.mcap"
    made = ReservedFile(path, 100_000)
    made.write(b"\x89MCAP0\r\n")
    (reserve,) = tmp_path.glob(".*")
    assert reserve.stat().st_size == 100_000
    repair(path)
    assert not reserve.exists()
    made.close()
