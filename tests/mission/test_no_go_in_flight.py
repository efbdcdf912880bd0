"""No-go volumes: kept, bound on the pilot, told, and never entered."""

from __future__ import annotations

import asyncio
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from virtual_console import REQUEST, in_phase, tell, until

from server.bench.missions.virtual_flight import VirtualFlight
from server.geometry.boxes import Box3
from server.mission.commands import RefusedError, UnknownError
from server.mission.control import Control
from server.mission.events import EventStream, NoGoChanged, NoGoVolume, Noted, PlanFound
from server.mission.no_go import NoGo
from server.mission.pilot import Pilot
from server.planner.config import FlightSpace, PlannerConfig
from server.swarm.config import SafetyConfig
from server.swarm.fleet import Fleet

SAFETY = SafetyConfig()
TWICE = '{"id": "a", "area": [0, 0, 1, 1]}'
AREA = (2.0, -1.0, 1.0, 1.0)
SHELF = (-3.0, -3.0, 1.2, -2.0, -2.5, 2.0)


class StandingPilot:
    """What the volumes need of a pilot."""

    def __init__(self) -> None:
        self.no_go: tuple[Box3, ...] = ()
        self.places: dict[str, Any] = {}

    def standing_places(self) -> dict[str, Any]:
        return self.places


def volumes_of(
    file: Path | None, planner: PlannerConfig | None = None
) -> tuple[NoGo, StandingPilot, EventStream]:
    pilot, events = StandingPilot(), EventStream()
    planner = PlannerConfig() if planner is None else planner
    return NoGo(file, cast("Pilot", pilot), planner, SAFETY, events), pilot, events


async def test_volumes_are_bound_told_and_kept(tmp_path: Path) -> None:
    file = tmp_path / "not yet" / "no-go.json"
    no_go, pilot, events = volumes_of(file)
    assert no_go.standing() == []
    with events.subscribe() as news:
        first = await no_go.add(AREA)
        told = await anext(aiter(news))
    assert isinstance(told, NoGoChanged)
    assert told.volumes == (first,)
    # Whichever way it was drawn; from the floor to the ceiling.
    assert first.area == (1.0, -1.0, 2.0, 1.0)
    assert (first.box.lower[2], first.box.upper[2]) == (0.0, SAFETY.ceiling_m)
    assert pilot.no_go == (first.box,)
    second = await no_go.add((-1.0, 2.0, 0.0, 3.0))
    await no_go.change(first.id, (1.5, -1.0, 2.5, 1.0))
    # Another console on the same runs finds them as they were left.
    again, bound, _ = volumes_of(file)
    assert [(v.id, v.area) for v in again.volumes] == [
        (first.id, (1.5, -1.0, 2.5, 1.0)),
        (second.id, (-1.0, 2.0, 0.0, 3.0)),
    ]
    assert len(bound.no_go) == 2
    await again.drop(first.id)
    await again.drop()
    assert (again.volumes, bound.no_go) == ((), ())
    assert volumes_of(file)[0].volumes == ()


async def test_names_are_not_given_twice(tmp_path: Path) -> None:
    file = tmp_path / "no-go.json"
    no_go, *_ = volumes_of(file)
    first = await no_go.add(AREA)
    await no_go.drop(first.id)
    # Whoever still means the first must not hit the second.
    second = await no_go.add(AREA)
    await no_go.drop(second.id)
    third = await volumes_of(file)[0].add(AREA)
    assert len({first.id, second.id, third.id}) == 3


async def test_changes_at_once_leave_the_newest_on_disk(tmp_path: Path) -> None:
    file = tmp_path / "no-go.json"
    no_go, *_ = volumes_of(file)
    await asyncio.gather(*(no_go.add((0.0, 0.0, 1.0, 0.5 + 0.1 * i)) for i in range(8)))
    assert [v.id for v in volumes_of(file)[0].volumes] == [v.id for v in no_go.volumes]


@pytest.mark.parametrize(
    ("area", "reason"),
    [
        ((0.0, 0.0, 0.0, 1.0), "sides"),
        ((0.0, 0.0, float("nan"), 1.0), "finite"),
        ((0.0, 0.0, 20.0, 1.0), "from the middle"),
    ],
)
async def test_what_is_no_volume_is_refused(
    tmp_path: Path, area: tuple[float, float, float, float], reason: str
) -> None:
    no_go, pilot, _ = volumes_of(tmp_path / "no-go.json")
    with pytest.raises(RefusedError, match=reason):
        await no_go.add(area)
    assert (no_go.volumes, pilot.no_go) == ((), ())
    with pytest.raises(UnknownError):
        await no_go.drop("no-go-7")


async def test_there_is_an_end_to_them(tmp_path: Path) -> None:
    no_go, *_ = volumes_of(tmp_path / "no-go.json")
    for _ in range(12):
        await no_go.add(AREA)
    with pytest.raises(RefusedError, match="drop one"):
        await no_go.add(AREA)


async def test_those_of_the_settings_stand_and_stay(tmp_path: Path) -> None:
    planner = PlannerConfig(space=FlightSpace(no_go=(SHELF,)))
    no_go, pilot, _ = volumes_of(tmp_path / "no-go.json", planner)
    (shelf,) = no_go.volumes
    # What is under a shelf and above it is part of it: whoever falls silent there comes down.
    assert (shelf.box.lower[2], shelf.box.upper[2]) == (0.0, SAFETY.ceiling_m)
    assert pilot.no_go == (shelf.box,)
    with pytest.raises(RefusedError, match="settings"):
        await no_go.drop(shelf.id)
    own = await no_go.add(AREA)
    assert len(no_go.within(planner).space.no_go) == 2
    await no_go.drop()
    assert no_go.volumes == (shelf,)
    assert own.id not in [v.id for v in volumes_of(tmp_path / "no-go.json")[0].volumes]


async def test_a_curtain_of_the_settings_may_be_thin() -> None:
    curtain = (1.0, -1.0, 0.0, 1.0, 1.0, 2.0)
    no_go, pilot, _ = volumes_of(None, PlannerConfig(space=FlightSpace(no_go=(curtain,))))
    assert [volume.area for volume in no_go.volumes] == [(1.0, -1.0, 1.0, 1.0)]
    assert len(pilot.no_go) == 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"count": 1, "volumes": [{"id": "a", "area": [0, 0, 1]}]}',
        '{"count": 1, "volumes": [{"id": "a", "area": [0, 0, 1, 1e400]}]}',
        f'{{"count": 1, "volumes": [{TWICE}, {TWICE}]}}',
    ],
)
async def test_a_file_nobody_can_read_keeps_everything_down_and_is_left_alone(
    tmp_path: Path, text: str
) -> None:
    file = tmp_path / "no-go.json"
    file.write_text(text)
    no_go, *_ = volumes_of(file)
    (check,) = no_go.checks()
    assert (check.passed, check.final, check.drone_id) == (False, True, None)
    assert "no-go.json cannot be read" in check.found
    with pytest.raises(RefusedError, match="mend or delete"):
        await no_go.add(AREA)
    assert file.read_text() == text


async def test_a_full_disk_is_said_and_the_volume_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("server.mission.no_go.write_atomic", fail)
    no_go, pilot, events = volumes_of(tmp_path / "no-go.json")
    with events.subscribe() as news:
        await no_go.add(AREA)
        told = [await anext(aiter(news)) for _ in range(3)]
    assert "not kept" in getattr(told[-1], "text", "")
    assert len(pilot.no_go) == 1


async def test_nobody_takes_off_inside_one(tmp_path: Path) -> None:
    no_go, pilot, _ = volumes_of(tmp_path / "no-go.json")
    pilot.places = {"d1": np.array([1.5, 0.0, 0.1]), "d2": np.array([-1.8, 0.0, 0.1])}
    assert no_go.checks() == []
    volume = await no_go.add(AREA)
    (check,) = no_go.checks()
    assert (check.key, check.final) == ("d1.no_go", True)
    assert volume.id in check.found


# In flight ----------------------------------------------------------------------------------------


def nearest_m(flight: VirtualFlight, volumes: tuple[NoGoVolume, ...]) -> float:
    """Return the true distance of the nearest flying drone from the volumes."""
    return min(
        (
            volume.box.distance(np.asarray(tello.airframe.position))
            for tello in flight.tellos.values()
            if tello.airframe.phase != "standing"
            for volume in volumes
        ),
        default=np.inf,
    )


@pytest.mark.slow
def test_a_capture_flies_around_what_stands_in_the_room(tmp_path: Path) -> None:
    plans: list[PlanFound] = []
    least = [np.inf]

    async def watch(flight: VirtualFlight, control: Control) -> None:
        while True:
            least[0] = min(least[0], nearest_m(flight, control.no_go()))
            await asyncio.sleep(0.1)

    async def listen(events: EventStream) -> None:
        with events.subscribe(4096) as news:
            async for event in news:
                if isinstance(event, PlanFound):
                    plans.append(event)  # noqa: PERF401 - one by one, for it never ends.

    async def story(flight: VirtualFlight, control: Control, _: Fleet) -> None:
        # Beside the way between two neighbours on the start circle, where a plan likes to go.
        pillar = await control.add_no_go((1.1, 1.1, 1.6, 1.6))
        tasks = [
            asyncio.create_task(watch(flight, control)),
            asyncio.create_task(listen(control.events)),
        ]
        record = await control.start_capture(REQUEST)
        await in_phase(control, "capture")
        # Another thing is noticed while the drones are up: what is left is planned around it.
        await control.add_no_go((-1.6, -1.6, -1.3, -1.3))
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "succeeded"
        assert record.status.images == REQUEST.pictures
        for task in tasks:
            assert not task.done()  # It has looked to the end.
            task.cancel()
        clearance_m = PlannerConfig().space.no_go_clearance_m
        for plan, volumes in zip(plans, ((pillar,), control.no_go()), strict=True):
            for view in plan.placement.viewpoints:
                for volume in volumes:
                    assert volume.box.distance(view.position_world) >= clearance_m - 1e-9

    tell(story, tmp_path)
    # Half a metre is kept to where it is believed to be.
    assert 0.2 < least[0] < np.inf


@pytest.mark.slow
def test_the_ring_leaves_out_what_is_barred_in_flight(tmp_path: Path) -> None:
    told: list[str] = []

    async def listen(events: EventStream) -> None:
        with events.subscribe(4096) as news:
            async for event in news:
                if isinstance(event, Noted) and event.level == "warning":
                    told.append(event.text)  # noqa: PERF401 - one by one, for it never ends.

    async def story(_: VirtualFlight, control: Control, __: Fleet) -> None:
        listening = asyncio.create_task(listen(control.events))
        record = await control.start_capture(replace(REQUEST, mode="standard"))
        await in_phase(control, "capture")
        # Between the places of the first round, over one of the second.
        await control.add_no_go((0.9, 0.9, 1.3, 1.3))
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "succeeded"
        assert 4 <= record.status.images < 8
        listening.cancel()

    tell(story, tmp_path)
    assert any("left out" in text for text in told)


@pytest.mark.slow
def test_a_drone_is_driven_out_of_a_volume_that_is_drawn_over_it(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        barred = await control.add_no_go((1.5, -0.3, 2.1, 0.3))
        with pytest.raises(RefusedError, match="stands 0\\.0 m from no-go-1"):
            await control.command_drone("drone-1", "takeoff")
        await control.drop_no_go(barred.id)
        await until(lambda: fleet.drones["drone-1"].activity == "ground")
        await control.command_drone("drone-1", "takeoff")
        await until(lambda: fleet.drones["drone-1"].activity == "flying")
        await asyncio.sleep(3.0)
        x, y, _ = flight.tellos["drone-1"].airframe.position
        await control.add_no_go((x - 0.3, y - 0.3, x + 0.3, y + 0.3))
        await until(lambda: nearest_m(flight, control.no_go()) > 0.3, 30.0)
        assert json.loads((tmp_path / "no-go.json").read_text())["volumes"]

    tell(story, tmp_path)


def test_space_of_the_settings_stays_as_it_is() -> None:
    planner = replace(PlannerConfig(), space=FlightSpace(fence_radius_m=3.0))
    no_go, *_ = volumes_of(None)
    assert no_go.within(planner) == planner
