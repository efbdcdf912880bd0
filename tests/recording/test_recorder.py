from __future__ import annotations

import json
import threading
import time
from dataclasses import replace

import av
import pytest
from flights import SMALL, pictures, read_officially
from mcap.reader import make_reader

from server.recording.json_messages import JsonMessage, datagram_message
from server.recording.recorder import FlightRecorder
from server.recording.repair import is_whole

ABOUT = {"dronerf": {"version": "test"}}


class Clock:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


def recorder(tmp_path, config=SMALL, **more):
    made = FlightRecorder(tmp_path / "recording.mcap", config, Clock(), **more)
    made.open(ABOUT)
    return made


def event(text):
    return JsonMessage("dronerf.Event", {"event": text})


def until(holds, timeout_s=5.0):
    deadline_s = time.monotonic() + timeout_s
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.005)


def test_what_is_noted_is_read_back_by_the_official_reader(tmp_path):
    made = recorder(tmp_path)
    made.note("/drone-1/commands", lambda: datagram_message(b"takeoff"), 101.5)
    made.note("/drone-1/commands", lambda: datagram_message(b"Re0701 land"), 102.0)
    made.close()
    with made.path.open("rb") as stream:
        reader = make_reader(stream)
        (schema, channel, first), (_, _, second) = list(reader.iter_messages())
        assert schema is not None
        assert schema.name == "dronerf.Datagram"
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert json.loads(first.data) == {"text": "takeoff", "label": None}
        assert json.loads(second.data) == {"text": "land", "label": 7}
        assert second.log_time - first.log_time == 500_000_000
        assert first.log_time - made.base.wall_ns == 1_500_000_000
        metadata = list(reader.iter_metadata())
        assert [m.name for m in metadata] == ["dronerf"]
        assert json.loads(schema.data)["type"] == "object"


def test_video_comes_back_as_whole_pictures_that_decode(tmp_path):
    made = recorder(tmp_path)
    shot = pictures(12)
    for at_s, datagrams in shot:
        for datagram in datagrams:
            made.film("drone-1", datagram, 100.0 + at_s)
    made.close()
    videos = [m for topic, _, m in read_officially(made.path) if topic == "/drone-1/video"]
    assert len(videos) == 12
    codec = av.CodecContext.create("h264", "r")
    decoded = [frame for video in videos for frame in codec.decode(av.Packet(video.data))]
    decoded += codec.decode(None)
    assert len(decoded) == 12
    for (at_s, datagrams), video in zip(shot, videos, strict=True):
        assert video.format == "h264"
        assert video.frame_id == "drone-1/camera"
        assert video.data == b"".join(datagrams)  # As received, to the byte.
        passed_ns = video.timestamp.seconds * 10**9 + video.timestamp.nanos - made.base.wall_ns
        assert abs(passed_ns - at_s * 1e9) < 1000


def test_a_key_picture_whose_parameter_sets_were_lost_gets_the_last_ones(tmp_path):
    made = recorder(tmp_path)
    for number, (at_s, datagrams) in enumerate(pictures(25)):
        sets = [d for d in datagrams if d.startswith((b"\0\0\0\1\x67", b"\0\0\0\1\x68"))]
        lost = number == 10 and len(sets) == 2
        for datagram in datagrams[len(sets) if lost else 0 :]:
            made.film("drone-1", datagram, 100.0 + at_s)
    made.close()
    videos = [m for topic, _, m in read_officially(made.path) if topic == "/drone-1/video"]
    keys = [v.data for v in videos if b"\0\0\1\x65" in v.data]
    assert len(keys) == 3
    for data in keys:
        assert b"\0\0\1\x67" in data
        assert data.index(b"\0\0\1\x67") < data.index(b"\0\0\1\x68") < data.index(b"\0\0\1\x65")


def test_nothing_is_recorded_before_the_first_key_picture(tmp_path):
    made = recorder(tmp_path)
    for at_s, datagrams in pictures(14)[3:]:
        for datagram in datagrams:
            made.film("drone-1", datagram, 100.0 + at_s)
    made.close()
    topics = [topic for topic, _, _ in read_officially(made.path)]
    assert topics.count("/drone-1/video") == 4  # Of pictures 10 to 13.


def test_a_recording_never_outgrows_its_limit_and_says_why_it_ended(tmp_path):
    reasons = []
    config = replace(SMALL, max_bytes=300_000)
    made = recorder(tmp_path, config, on_end=reasons.append)
    for number in range(3000):
        made.note("/events", lambda n=number: event(f"{n} " + "x" * 500), 100.0 + number)
        if number % 100 == 0:
            time.sleep(0.01)
    until(lambda: reasons)
    made.note("/events", lambda: event("too late"), 9999.0)
    made.close()
    assert reasons == ["it has reached its limit of 0 MB"]
    assert made.state.ended == reasons[0]
    assert made.path.stat().st_size <= config.max_bytes
    assert is_whole(made.path)
    kept = read_officially(made.path)
    assert 100 < len(kept) < 3000
    assert json.loads(kept[-1][2])["event"].startswith(f"{len(kept) - 1} ")


def test_recording_stops_cleanly_while_the_disk_still_has_room(tmp_path):
    room = {"bytes": 10_000}
    reasons = []
    made = recorder(
        tmp_path,
        replace(SMALL, min_free_bytes=5_000),
        on_end=reasons.append,
        free=lambda _: room["bytes"],
    )
    made.note("/events", lambda: event("before"), 101.0)
    until(lambda: made.state.messages == 1)
    room["bytes"] = 4_999
    until(lambda: reasons)
    made.note("/events", lambda: event("after"), 102.0)
    made.close()
    assert "nearly full" in reasons[0]
    assert is_whole(made.path)
    assert [json.loads(m)["event"] for _, _, m in read_officially(made.path)] == ["before"]


def test_no_recording_begins_on_a_full_disk(tmp_path):
    made = FlightRecorder(
        tmp_path / "recording.mcap", replace(SMALL, min_free_bytes=5_000), free=lambda _: 10
    )
    with pytest.raises(OSError, match="nearly full"):
        made.open(ABOUT)
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_never_overwritten(tmp_path):
    recorder(tmp_path).close()
    with pytest.raises(FileExistsError):
        recorder(tmp_path)


def test_a_stuck_disk_costs_notes_but_never_time(tmp_path):
    stuck = threading.Event()
    made = recorder(tmp_path, replace(SMALL, waiting_bytes=50_000))

    def wait():
        stuck.wait(20.0)
        return event("stuck")

    made.note("/events", wait, 100.0)
    begun_s = time.thread_time()
    for _ in range(10_000):
        made.note("/events", lambda: event("x"), 101.0)
        made.film("drone-1", bytes(1460), 101.0)
    spent_s = time.thread_time() - begun_s
    assert made.state.dropped > 19_000
    assert spent_s / 20_000 < 1e-3  # Far below a beat: a note is a lock and an append.
    stuck.set()
    made.close()
    assert is_whole(made.path)


def test_pictures_after_dropped_datagrams_are_marked_damaged(tmp_path):
    stuck, working = threading.Event(), threading.Event()
    made = recorder(tmp_path, replace(SMALL, waiting_bytes=60_000))
    shot = pictures(9)

    def wait():
        working.set()
        stuck.wait(20.0)
        return event("stuck")

    made.note("/events", wait, 100.0)
    assert working.wait(5.0)
    for at_s, datagrams in shot[:3]:
        for datagram in datagrams:
            made.film("drone-1", datagram, 100.0 + at_s)
    made.note("/events", lambda: event("fills it"), 100.3, weight=55_000)
    before = made.state.dropped
    while made.state.dropped == before:
        made.note("/events", lambda: event("more"), 100.3)
    for datagram in shot[3][1]:
        made.film("drone-1", datagram, 100.3)
    stuck.set()
    until(lambda: made.state.messages >= 2)
    until(lambda: not made._waiting_bytes)
    for at_s, datagrams in shot[4:]:
        for datagram in datagrams:
            made.film("drone-1", datagram, 100.0 + at_s)
    made.close()
    units = [
        json.loads(m)
        for topic, _, m in read_officially(made.path)
        if topic == "/drone-1/video_unit"
    ]
    assert [unit["damaged"] for unit in units] == [False] * 3 + [True] * 5


def test_a_failing_message_ends_the_recording_not_the_thread_that_notes(tmp_path):
    reasons = []
    made = recorder(tmp_path, on_end=reasons.append)
    made.note("/events", lambda: event("good"), 100.0)
    made.note("/events", lambda: event(str(1 / 0)), 101.0)
    until(lambda: reasons)
    made.note("/events", lambda: event("later"), 102.0)
    made.close()
    assert reasons == ["the recorder failed, see the log"]
    assert is_whole(made.path)
    assert len(read_officially(made.path)) == 1
