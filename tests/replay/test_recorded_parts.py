"""Seeds and plans of a recorded flight, told what happened in it one by one."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.jobs.spec import JobSpec
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig, MissionConfig
from server.mission.events import (
    Event,
    EventStream,
    NoGoChanged,
    NoGoVolume,
    Noted,
    PlanFound,
)
from server.mission.eyes import Sight
from server.mission.flight_recording import event_message
from server.mission.pilot import Pilot
from server.planner.config import PlannerConfig
from server.replay import prompt_jobs, seeding
from server.replay.planning import RecordedPlanning
from server.replay.recorded_fleet import (
    RecordedDrone,
    RecordedEye,
    RecordedFleet,
    StartCircle,
)
from server.replay.seeding import RecordedSeeding
from server.stages import Box, Frame, Region, SeedGeometry, View
from server.swarm.config import DroneConfig, SafetyConfig
from server.swarm.fleet import Fleet
from server.vision.config import SeedConfig, VisionConfig

CONFIG = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
OUTER = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 1.0]))
SEED = SeedGeometry(OUTER, (OUTER,), 4)
AZIMUTHS_DEG = {"north": 0.0, "west": 90.0, "south": 180.0, "east": 270.0}
PICTURE = np.zeros((2, 2, 3), np.uint8)
REGION = Region(np.zeros(2), 1.0, 1.0, np.ones((2, 2), bool), 4.0, 1.0)
BOX = Box(np.array([400.0, 300.0, 560.0, 420.0]), 0.9, touches_edge=False)


class HeardEvents(EventStream):
    def __init__(self) -> None:
        super().__init__()
        self.heard: list[Event] = []

    def publish(self, event: Event) -> None:
        self.heard.append(event)


class Rig:
    """Four recorded drones that fly, and a pilot who believes them at their start places."""

    def __init__(self) -> None:
        configs = [DroneConfig(id=d, azimuth_deg=a) for d, a in AZIMUTHS_DEG.items()]
        drones = {config.id: RecordedDrone(config, activity="flying") for config in configs}
        self.fleet = RecordedFleet(StartCircle(1.8), drones)
        self.eyes = {c.id: RecordedEye(c, CONFIG.vision.region, 0.0) for c in configs}
        self.events = HeardEvents()
        self.pilot = Pilot(cast("Fleet", self.fleet), dict(self.eyes), CONFIG, self.events)

    def see(self, number: int, seen: Sequence[str] = tuple(AZIMUTHS_DEG)) -> None:
        for drone_id in AZIMUTHS_DEG:
            found = (REGION, BOX) if drone_id in seen else (None, None)
            frame = Frame(drone_id, number, float(number), PICTURE, damaged=False)
            self.eyes[drone_id].sight = Sight(frame, *found)


# Plans --------------------------------------------------------------------------------------------


def part(name: str, drone_id: str, *drawn: float) -> dict[str, Any]:
    return {"id": name, "drone_id": drone_id, "drawn": list(drawn), "weight": 4.0, "box": None}


async def test_every_plan_asks_for_the_parts_that_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[dict[str, Any]] = []

    def plan(spec: JobSpec, _: object) -> dict[str, Any]:
        asked.append(dict(spec.parameters))
        raise ValueError("no room")

    monkeypatch.setattr(prompt_jobs.plan, "run", plan)
    rig = Rig()
    request = CaptureRequest(pictures=12)
    planning = RecordedPlanning(request, CONFIG, rig.fleet, rig.eyes, rig.pilot, rig.events)
    # Drawn before there is a geometry; a console's third capture goes on counting its parts.
    whole, below = part("part-7", "north", 0.1, 0.1, 0.9, 0.9), part("part-8", "west", 0, 0, 1, 1)
    planning.set_parts([whole, below], 1.0)
    rig.pilot.seed = SEED
    await planning.plan(2.0)
    for drone_id in AZIMUTHS_DEG:
        planning.photographed(drone_id, 3.0)
    sliver = part("part-9", "south", 0.0, 0.0, 0.03, 0.03)
    planning.set_parts([below, sliver], 4.0)
    await planning.plan_anew()
    planning.set_parts([], 5.0)
    assert [len(wanted["priorities"]) for wanted in asked] == [2, 1]
    assert [wanted["rounds"] for wanted in asked] == [3, 2]
    assert [len(wanted["taken"]) for wanted in asked] == [0, 4]
    # A planner that fails is no end: as in flight, the ring is flown, or the old plan.
    assert len([event for event in rig.events.heard if isinstance(event, PlanFound)]) == 1
    warnings = [e.text for e in rig.events.heard if isinstance(e, Noted) and e.level == "warning"]
    assert [text.split(":")[0] for text in warnings] == [
        "No plan (no room)",
        "part-9 is not marked",
        "No new plan (no room)",
    ]


async def test_plans_keep_clear_of_the_volumes_that_stood(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def plan(spec: JobSpec, _: object) -> dict[str, Any]:
        asked.append(spec.parameters["config"]["space"]["no_go"])
        raise ValueError("no room")

    monkeypatch.setattr(prompt_jobs.plan, "run", plan)
    rig = Rig()
    request = CaptureRequest(pictures=12)
    planning = RecordedPlanning(request, CONFIG, rig.fleet, rig.eyes, rig.pilot, rig.events)
    rig.pilot.seed = SEED
    box = Box3(np.array([3.0, 3.0, 0.0]), np.array([3.5, 3.5, 3.0]))
    told = event_message(NoGoChanged((NoGoVolume("no-go-1", box),)))
    planning.set_no_go(json.loads(told.encoded())["volumes"])
    await planning.plan(1.0)
    planning.set_no_go([])
    await planning.plan(2.0)
    assert [tuple(map(tuple, each)) for each in asked] == [((3.0, 3.0, 0.0, 3.5, 3.5, 3.0),), ()]


async def test_without_a_geometry_there_is_no_plan() -> None:
    rig = Rig()
    planning = RecordedPlanning(
        CaptureRequest(), CONFIG, rig.fleet, rig.eyes, rig.pilot, rig.events
    )
    await planning.plan(1.0)
    planning.photographed("north", 2.0)
    await planning.plan_anew()
    (told,) = rig.events.heard
    assert isinstance(told, Noted)
    assert "no seed geometry" in told.text


# Seeds --------------------------------------------------------------------------------------------


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the views of every fit instead of carving; fewer than eight make no geometry."""
    counts: list[int] = []

    def seed_of(views: Sequence[View], _: object) -> SeedGeometry:
        counts.append(len(views))
        if len(views) < 8:
            raise seeding.SeedError("too few")
        return SeedGeometry(OUTER, (OUTER,), len(views))

    def refined(_: object, views: Sequence[View], __: object) -> SeedGeometry:
        counts.append(len(views))
        return SeedGeometry(OUTER, (OUTER,), len(views))

    monkeypatch.setattr(seeding, "seed_from_views", seed_of)
    monkeypatch.setattr(seeding, "refined_seed", refined)
    return counts


def test_the_pilot_gets_a_geometry_when_it_had_one_in_flight(fits: list[int]) -> None:
    rig = Rig()
    seeding = RecordedSeeding(rig.fleet, rig.eyes, rig.pilot, SeedConfig())
    rig.see(1)
    seeding.begin(5.0)  # What was seen long before does not count.
    assert fits == []
    for number in (5, 6, 7):
        rig.see(number)
        seeding.look()
        seeding.look()  # A picture is one view.
    assert fits == [4, 8]
    assert seeding.seeds == []
    seeding.fitted(views=4)
    assert [seed.views for seed in seeding.seeds] == [8]
    assert rig.pilot.seed is seeding.seeds[0]
    assert seeding.conclude() is None


def test_views_of_a_round_vote_along_in_the_refinements_that_had_them(fits: list[int]) -> None:
    rig = Rig()
    seeding = RecordedSeeding(rig.fleet, rig.eyes, rig.pilot, SeedConfig())
    seeding.begin(1.0)
    for number in (1, 2):
        rig.see(number)
        seeding.look()
    seeding.fitted(views=4)
    rig.see(3, seen=("north", "west", "south"))
    for drone_id in ("north", "west", "east"):
        seeding.photographed(drone_id)
    seeding.end_round()
    rig.see(4)
    seeding.photographed("south")
    # The refinement of the first round was a slow one; the second's was over at once.
    seeding.fitted(views=6)
    seeding.fitted(views=7)
    assert fits == [4, 8, 10, 11]
    assert [seed.views for seed in seeding.seeds] == [8, 10, 11]
    assert rig.pilot.seed is seeding.seeds[-1]


def test_who_never_sees_the_object_is_told(fits: list[int]) -> None:
    rig = Rig()
    seeding = RecordedSeeding(rig.fleet, rig.eyes, rig.pilot, SeedConfig())
    seeding.begin(1.0)
    rig.see(1, seen=())
    seeding.fitted(views=4)
    assert seeding.conclude() == "too few"
    assert seeding.conclude() is None
    assert rig.pilot.seed is None
