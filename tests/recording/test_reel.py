"""A recording as a browser shows it: films, ways and moments on one axis of time."""

from __future__ import annotations

import json
import math
from pathlib import Path

import av
import numpy as np
import pytest
from flights import HEIGHT, SMALL, WIDTH, pictures

from server.geometry.cameras import Intrinsics
from server.recording.json_messages import JsonMessage
from server.recording.messages import calibration_message, pose_message
from server.recording.reading import RecordingError
from server.recording.recorder import FlightRecorder
from server.recording.reel import make_reel

CAMERA = Intrinsics(width=WIDTH, height=HEIGHT, fx=300.0, fy=300.0, cx=160.0, cy=120.0)


def camera_looking_along(heading_rad: float, position: tuple[float, float, float]) -> np.ndarray:
    """Return a level camera's pose, built column by column: right, down, forward."""
    s, c = math.sin(heading_rad), math.cos(heading_rad)
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.column_stack([(s, -c, 0.0), (0.0, 0.0, -1.0), (c, s, 0.0)])
    T_world_cam[:3, 3] = position
    return T_world_cam


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two drones' videos, the second two seconds later, a way, a picture, a line of the log."""
    made = FlightRecorder(tmp_path / "recording.mcap", SMALL, lambda: 100.0)
    made.open({"dronerf": {"version": "test"}})
    ns = made.base.ns
    for drone_id in ("a", "b"):
        note = calibration_message(drone_id, CAMERA, ns(100.0))
        made.note(f"/{drone_id}/calibration", lambda note=note: note, 100.0)
    for drone_id, begins_s in (("b", 100.5), ("a", 102.5)):
        for at_s, datagrams in pictures(12):
            for datagram in datagrams:
                made.film(drone_id, datagram, begins_s + at_s)
    for step in range(10):
        T = camera_looking_along(2.5, (1.0, 0.1 * step, 0.5))
        note = pose_message(T, ns(101.0 + 0.1 * step))
        made.note("/a/pose", lambda note=note: note, 101.0 + 0.1 * step, 101.0 + 0.1 * step)
    said = {"event": "noted", "level": "warning", "text": "Mind the chair.", "drone_id": None}
    made.note("/events", lambda: JsonMessage("dronerf.Event", said), 101.5)
    taken = {"event": "capture_taken", "capture": {"index": 6, "pose": {"drone_id": "b"}}}
    made.note("/events", lambda: JsonMessage("dronerf.Event", taken), 102.0)
    made.close()
    return tmp_path


def test_films_ways_and_moments_share_one_time(run: Path) -> None:
    shares: list[float] = []
    reel = json.loads(make_reel(run / "recording.mcap", run, shares.append).read_text())
    # Told as it goes, at most once in a per cent.
    assert shares
    assert shares == sorted(shares)
    assert 0.0 < shares[0] <= shares[-1] <= 1.0
    assert len(shares) <= 100
    assert [drone["drone_id"] for drone in reel["drones"]] == ["a", "b"]
    a, b = reel["drones"]
    assert (a["begins_s"], b["begins_s"]) == (pytest.approx(2.0), pytest.approx(0.0))
    assert reel["seconds"] == pytest.approx(3.1)
    for drone in (a, b):
        with av.open(str(run / "replay" / drone["film"])) as film:
            frames = list(film.decode(video=0))
        assert len(frames) == 12
        assert (frames[0].width, frames[0].height) == (WIDTH, HEIGHT)
        assert frames[-1].time == pytest.approx(1.1, abs=0.002)
        # The bright square has wandered: these are the pictures, in their order.
        left = [int(np.argmax(f.to_ndarray(format="gray")[120] > 100)) for f in frames]
        assert left == sorted(left)
        assert left[-1] - left[0] == pytest.approx(44, abs=2)
    assert [place[0] for place in a["way"]] == pytest.approx([0.5, 0.7, 0.9, 1.1, 1.3])
    assert a["way"][0][1:] == pytest.approx([1.0, 0.0, 0.5, 2.5], abs=0.001)
    told = [(m["at_s"], m["kind"], m["drone_id"], m["text"]) for m in reel["moments"]]
    assert told == [(1.0, "warning", "", "Mind the chair."), (1.5, "picture", "b", "7")]


def test_a_recording_without_pictures_leaves_nothing_behind(tmp_path: Path) -> None:
    made = FlightRecorder(tmp_path / "recording.mcap", SMALL, lambda: 100.0)
    made.open({"dronerf": {"version": "test"}})
    made.close()
    with pytest.raises(RecordingError, match="no picture"):
        make_reel(tmp_path / "recording.mcap", tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["recording.mcap"]
