"""A simulated flight is recorded and sent through the pipeline again."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.reader import make_reader
from simulated_flight import fly

from server.recording.reading import Recording, RecordingError
from server.recording.repair import is_whole
from server.replay.flight import replay
from server.replay.notes import NoteReader
from server.replay.recorded_fleet import described
from server.sim.virtual_time import in_virtual_time

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    runs = tmp_path_factory.mktemp("runs")
    record = in_virtual_time(fly(runs))
    assert record.status.state == "succeeded", record.status.error
    return Path(record.status.run) / "recording.mcap"


@pytest.fixture(scope="module")
def replayed(recording):
    return asyncio.run(replay(recording))


def events(path: Path, name: str) -> list[dict]:
    found = (json.loads(m.data) for m in Recording(path).messages() if m.topic == "/events")
    return [event for event in found if event["event"] == name]


def test_the_file_is_whole_and_holds_every_topic(recording):
    assert is_whole(recording)
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    kinds = {c.topic: summary.schemas[c.schema_id].name for c in summary.channels.values()}
    for drone_id in ("drone-1", "drone-2", "drone-3", "drone-4"):
        assert kinds[f"/{drone_id}/video"] == "foxglove.CompressedVideo"
        assert kinds[f"/{drone_id}/annotations"] == "foxglove.ImageAnnotations"
        assert kinds[f"/{drone_id}/calibration"] == "foxglove.CameraCalibration"
        assert kinds[f"/{drone_id}/pose"] == "foxglove.PoseInFrame"
        assert kinds[f"/{drone_id}/telemetry"] == "dronerf.Telemetry"
        assert kinds[f"/{drone_id}/commands"] == "dronerf.Datagram"
        assert kinds[f"/{drone_id}/replies"] == "dronerf.Datagram"
    assert kinds["/tf"] == "foxglove.FrameTransforms"
    assert kinds["/scene"] == "foxglove.SceneUpdate"
    assert kinds["/events"] == "dronerf.Event"


def test_annotations_bear_the_time_of_their_picture(recording):
    times: dict[str, set[int]] = {}
    for message in Recording(recording).messages():
        times.setdefault(message.topic, set()).add(message.publish_ns)
    for drone_id in ("drone-1", "drone-2", "drone-3", "drone-4"):
        searched = times[f"/{drone_id}/annotations"]
        assert len(searched) > 50
        assert searched <= times[f"/{drone_id}/video"]


def test_it_begins_before_the_start_and_ends_after_the_landing(recording):
    activities = [
        json.loads(m.data)["activity"]
        for m in Recording(recording).messages()
        if m.topic == "/drone-1/telemetry"
    ]
    assert activities[0] in ("ground", "offline")
    assert "flying" in activities
    assert activities[-1] == "ground"


def test_every_picture_of_the_file_is_decoded_and_most_show_the_object(recording, replayed):
    coded: dict[str, int] = {}
    for message in Recording(recording).messages():
        if message.schema == "foxglove.CompressedVideo":
            drone_id = message.topic.split("/")[1]
            coded[drone_id] = coded.get(drone_id, 0) + 1
    assert replayed.whole
    for drone_id, tally in replayed.drones.items():
        assert tally.decoded == tally.coded == coded[drone_id]
        # A busy machine may have lost datagrams when the file was made.
        assert tally.searched == tally.decoded - tally.damaged
        assert len(tally.boxes) > 0.5 * tally.searched


def test_a_replay_gives_the_same_numbers_every_time(recording, replayed):
    again = asyncio.run(replay(recording))
    assert again.as_json() == replayed.as_json()
    assert again.digest() == replayed.digest()


def test_seed_and_plan_come_out_as_in_the_flight(recording, replayed):
    seed = events(recording, "seed_fitted")[0]["seed"]
    assert replayed.remarks == []
    assert replayed.seed is not None
    assert replayed.seed.views == seed["views"] == 4
    off_m = np.abs(replayed.seed.outer.centre - _centre(seed["outer"])).max()
    assert off_m < 0.3
    plan = events(recording, "plan_found")[0]
    assert replayed.plan is not None
    assert len(replayed.plan.assignment.rounds) == len(plan["assignment"]["rounds"])
    assert replayed.plan.placement.fitness == pytest.approx(plan["placement"]["fitness"], rel=0.25)


def test_a_replay_believes_what_the_flight_believed(recording, replayed):
    reader = NoteReader(described(Recording(recording).metadata()).wall_ns)
    flown: dict[str, list[list[float]]] = {}
    for message in Recording(recording).messages():
        if message.topic.endswith("/pose"):
            place = PoseInFrame.FromString(message.data).pose.position
            row = [reader.at_s(message.publish_ns), place.x, place.y, place.z]
            flown.setdefault(message.topic.split("/")[1], []).append(row)
    for drone_id, tally in replayed.drones.items():
        last = np.array(flown[drone_id])[-1, 1:]
        assert np.linalg.norm(np.array(tally.poses[-1][:3]) - last) < 1.0


def test_a_flight_that_was_cut_short_is_replayed_as_far_as_it_goes(recording, tmp_path):
    data = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 4])
    result = asyncio.run(replay(cut))
    assert not result.whole
    assert all(tally.decoded > 5 for tally in result.drones.values())
    assert result.plan is None or result.seed is not None


def test_a_file_without_a_flight_is_refused(tmp_path):
    path = tmp_path / "other.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\0" * 100)
    with pytest.raises(RecordingError, match="not recorded by dronerf"):
        asyncio.run(replay(path))


def _centre(box: dict) -> np.ndarray:
    return (np.array(box["lower"]) + np.array(box["upper"])) / 2.0
