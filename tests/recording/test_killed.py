"""A console that is killed with SIGKILL leaves a recording that can be read and repaired."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from flights import SMALL, read_officially
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError

from server.recording.json_messages import JsonMessage
from server.recording.reading import Recording, RecordingError
from server.recording.recorder import FlightRecorder
from server.recording.repair import is_whole, repair, repair_all

MANY = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
CHILD = Path(__file__).parent / "killed_recorder.py"


def recorded(path: Path, notes: int = 40) -> None:
    made = FlightRecorder(path, SMALL)
    made.open({"dronerf": {"version": "test"}})
    for number in range(notes):
        text = f"{number} " + "x" * 300
        made.note("/events", lambda t=text: JsonMessage("dronerf.Event", {"event": t}), 1.0)
    made.close()


def events(path: Path) -> list[int]:
    return [
        int(json.loads(m.data)["event"].split()[0])
        for m in Recording(path).messages()
        if m.topic == "/events"
    ]


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Return the file of a recorder killed in full work, and what must be in it."""
    path = tmp_path_factory.mktemp("killed") / "recording.mcap"
    child = subprocess.Popen([sys.executable, str(CHILD), str(path)], stdout=subprocess.PIPE)
    assert child.stdout is not None
    try:
        sure = -1
        for _ in range(50):
            sure = int(child.stdout.readline())
    finally:
        os.kill(child.pid, signal.SIGKILL)
        child.stdout.close()
        assert child.wait() == -signal.SIGKILL
    return path, sure


@pytest.mark.slow
def test_what_was_recorded_a_second_before_a_kill_is_read(killed):
    path, sure = killed
    assert not is_whole(path)
    recording = Recording(path)
    assert recording.metadata()["dronerf"] == {"version": "test"}
    found = events(path)
    assert found == list(range(len(found)))  # In order and without a gap.
    assert len(found) > sure > 30
    assert any(m.schema == "foxglove.CompressedVideo" for m in recording.messages())
    assert not recording.whole


@pytest.mark.slow
def test_a_repaired_recording_is_opened_by_the_official_reader(killed, tmp_path):
    path = tmp_path / "recording.mcap"
    path.write_bytes(killed[0].read_bytes())
    before = [(m.topic, m.log_ns, m.data) for m in Recording(path).messages()]
    with pytest.raises((McapError, Exception)):
        read_officially(path)
    assert repair(path)
    assert is_whole(path)
    assert len(read_officially(path)) == len(before)
    repaired = Recording(path)
    assert [(m.topic, m.log_ns, m.data) for m in repaired.messages()] == before
    assert repaired.whole
    assert repaired.metadata()["dronerf"] == {"version": "test"}
    assert not repair(path)  # Nothing is left to do.


def test_a_recording_that_is_being_written_is_left_alone(tmp_path):
    path = tmp_path / "recording.mcap"
    made = FlightRecorder(path, SMALL)
    made.open({})
    assert repair_all([path]) == []
    made.close()
    assert is_whole(path)
    # Cut short and locked by nobody, it is repaired.
    path.write_bytes(path.read_bytes()[:-30])
    with path.open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert repair_all([path]) == []
    assert repair_all([path]) == [path]


def test_what_is_no_recording_is_named_and_left_as_it_is(tmp_path):
    path = tmp_path / "recording.mcap"
    path.write_bytes(b"not a recording at all, but long enough to look at")
    with pytest.raises(RecordingError, match="no MCAP file"):
        repair(path)
    assert repair_all([path, tmp_path / "missing.mcap"]) == []
    assert path.read_bytes().startswith(b"not a recording")
    assert list(tmp_path.iterdir()) == [path]


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(share=st.floats(0.0, 1.0))
def test_a_file_cut_anywhere_gives_a_beginning_of_what_it_held(tmp_path, share):
    path, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    if not path.exists():
        recorded(path)
    data = path.read_bytes()
    kept = 8 + int(share * (len(data) - 8))
    cut.write_bytes(data[:kept])
    found = events(cut)
    assert found == list(range(len(found)))
    assert repair(cut) == (kept < len(data))
    assert events(cut) == found
    assert len(found) <= len(read_officially(cut)) if found else True


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.floats(0.0, 1.0, exclude_max=True), value=st.integers(0, 255))
def test_a_damaged_byte_never_gives_wrong_messages_or_another_error(tmp_path, place, value):
    path, damaged = tmp_path / "whole.mcap", tmp_path / "damaged.mcap"
    if not path.exists():
        recorded(path)
    data = bytearray(path.read_bytes())
    data[8 + int(place * (len(data) - 8))] = value
    damaged.write_bytes(bytes(data))
    found = events(damaged)
    assert found == list(range(len(found)))
