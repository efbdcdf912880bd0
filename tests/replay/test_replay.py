"""A simulated flight is recorded and sent through the pipeline again."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.reader import make_reader
from simulated_flight import fly

from server.mission.pilot import Pilot
from server.recording.reading import Recording, RecordingError
from server.recording.repair import is_whole
from server.replay import prompt_jobs
from server.replay.flight import replay
from server.replay.notes import NoteReader
from server.replay.recorded_fleet import described
from server.replay.report import ReplayResult
from server.sim.virtual_time import in_virtual_time
from server.vision.region import RegionTracker

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@dataclass
class Watched:
    """What eyes, pilot and planner did, in flight or in a replay.

    Attributes:
        searches: Every full search of a picture: the eye's turn, when.
        targets: Where the operator's picks moved the object.
        seeds: Views of the geometries that the pilot believed in, in order.
        parts: The parts that each plan was asked for: corners and weight.
    """

    searches: set[tuple[float, float]] = field(default_factory=set[tuple[float, float]])
    targets: list[list[float]] = field(default_factory=list[list[float]])
    seeds: list[int] = field(default_factory=list[int])
    parts: list[list[Any]] = field(default_factory=list[list[Any]])


@contextmanager
def watching() -> Iterator[Watched]:
    """Yield what happens from here on."""
    watched = Watched()
    search, move = RegionTracker._searched, Pilot.move_target
    observe, planned = Pilot.observe, prompt_jobs.plan.run

    def searched(self, work, grey, at_s):
        watched.searches.add((self._turn, round(at_s, 3)))
        return search(self, work, grey, at_s)

    def moved(self, target):
        watched.targets.append(target.centre.tolist())
        move(self, target)

    def observed(self, now_s):
        views = 0 if self.seed is None else self.seed.views
        if views and views not in watched.seeds:
            watched.seeds.append(views)
        return observe(self, now_s)

    def plan(spec, reporting):
        watched.parts.append(spec.parameters["priorities"])
        return planned(spec, reporting)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RegionTracker, "_searched", searched)
        patch.setattr(Pilot, "move_target", moved)
        patch.setattr(Pilot, "observe", observed)
        patch.setattr(prompt_jobs.plan, "run", plan)
        yield watched


@dataclass(frozen=True)
class Flight:
    recording: Path
    watched: Watched


@dataclass(frozen=True)
class Replayed:
    result: ReplayResult
    watched: Watched


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Flight:
    with watching() as watched:
        record = in_virtual_time(fly(tmp_path_factory.mktemp("runs")))
    assert record.status.state == "succeeded", record.status.error
    return Flight(Path(record.status.run) / "recording.mcap", watched)


@pytest.fixture(scope="module")
def recording(flight) -> Path:
    return flight.recording


@pytest.fixture(scope="module")
def replayed(recording) -> Replayed:
    return replay_watched(recording)


def replay_watched(path: Path) -> Replayed:
    with watching() as watched:
        return Replayed(asyncio.run(replay(path)), watched)


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
    assert replayed.result.whole
    for drone_id, tally in replayed.result.drones.items():
        assert tally.decoded == tally.coded == coded[drone_id]
        # A busy machine may have lost datagrams when the file was made.
        assert tally.searched == tally.decoded - tally.damaged
        assert len(tally.boxes) > 0.5 * tally.searched


def test_a_replay_gives_the_same_numbers_every_time(recording, replayed):
    again = replay_watched(recording)
    assert again.result.as_json() == replayed.result.as_json()
    assert again.watched == replayed.watched


def test_the_seed_is_refined_as_in_the_flight(flight, replayed):
    flown = [event["seed"] for event in events(flight.recording, "seed_fitted")]
    seeds = replayed.result.seeds
    assert replayed.result.remarks == []
    assert [seed["views"] for seed in flown] == [4, 8, 12]
    # What the pilot aims at and expects is always the newest.
    assert flight.watched.seeds == [4, 8, 12]
    assert replayed.watched.seeds == [seed.views for seed in seeds]
    # After the first four a drone may lack a view of each round, if the file lost pictures of it.
    lossy = sum(tally.damaged > 0 for tally in replayed.result.drones.values())
    for rounds, (seed, wanted) in enumerate(zip(seeds, flown, strict=True)):
        assert wanted["views"] - lossy * rounds <= seed.views <= wanted["views"]
        assert np.abs(seed.outer.centre - _centre(wanted["outer"])).max() < 0.1
        # It stays, because the plan keeps clear of it; what is inside is carved anew.
        assert seed.outer is seeds[0].outer
    assert [box.lower.tolist() for box in seeds[0].boxes] != [
        box.lower.tolist() for box in seeds[-1].boxes
    ]


def test_every_plan_is_made_as_in_the_flight(flight, replayed):
    flown, plans = events(flight.recording, "plan_found"), replayed.result.plans
    for plan, wanted in zip(plans, flown, strict=True):
        assert len(plan.assignment.rounds) == len(wanted["assignment"]["rounds"])
        assert plan.placement.fitness == pytest.approx(wanted["placement"]["fitness"], rel=0.1)
    assert [len(plan.assignment.rounds) for plan in plans] == [2, 1]


def test_a_part_of_priority_is_found_and_planned_for(flight, replayed):
    (before, after), (flown_before, flown_after) = replayed.watched.parts, flight.watched.parts
    assert before == flown_before == []
    ((lower, upper, weight),), ((flown_lower, flown_upper, flown_weight),) = after, flown_after
    assert weight == flown_weight == 5.0
    np.testing.assert_allclose([lower, upper], [flown_lower, flown_upper], atol=0.15)


def test_a_pick_moves_the_target_of_all(flight, replayed):
    assert len(flight.watched.targets) >= 1
    np.testing.assert_allclose(replayed.watched.targets, flight.watched.targets, atol=0.1)


def test_full_searches_fall_on_the_pictures_on_which_they_fell_in_flight(flight, replayed):
    flown, searches = flight.watched.searches, replayed.watched.searches
    turns = {turn for turn, _ in searches}
    assert turns == {turn for turn, _ in flown} == {0.0, 0.25, 0.5, 0.75}
    for turn in turns:
        wanted = {search for search in flown if search[0] == turn}
        assert len(wanted & searches) > 0.6 * len(wanted)


def test_a_replay_believes_what_the_flight_believed(recording, replayed):
    reader = NoteReader(described(Recording(recording).metadata()).wall_ns)
    flown: dict[str, list[list[float]]] = {}
    for message in Recording(recording).messages():
        if message.topic.endswith("/pose"):
            place = PoseInFrame.FromString(message.data).pose.position
            row = [reader.at_s(message.publish_ns), place.x, place.y, place.z]
            flown.setdefault(message.topic.split("/")[1], []).append(row)
    for drone_id, tally in replayed.result.drones.items():
        last = np.array(flown[drone_id])[-1, 1:]
        assert np.linalg.norm(np.array(tally.poses[-1][:3]) - last) < 1.0


def test_a_flight_that_was_cut_short_is_replayed_as_far_as_it_goes(recording, tmp_path):
    data = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) // 4])
    result = asyncio.run(replay(cut))
    assert not result.whole
    assert all(tally.decoded > 5 for tally in result.drones.values())
    assert not result.plans or result.seeds


def test_a_file_without_a_flight_is_refused(tmp_path):
    path = tmp_path / "other.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\0" * 100)
    with pytest.raises(RecordingError, match="not recorded by dronerf"):
        asyncio.run(replay(path))


def _centre(box: dict) -> np.ndarray:
    return (np.array(box["lower"]) + np.array(box["upper"])) / 2.0
