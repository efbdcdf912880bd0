"""A drone flown by hand: it does what the sticks say, within every limit, and hovers in silence."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from virtual_console import REQUEST, in_phase, tell, until

from server.bench.missions.inline_jobs import InlineJob, InlineRunner
from server.bench.missions.virtual_flight import VirtualFlight
from server.jobs.spec import JobSpec
from server.mission.commands import AT_REST, RefusedError, Sticks
from server.mission.control import Control
from server.swarm.config import SafetyConfig
from server.swarm.fleet import Fleet

pytestmark = pytest.mark.slow

PILOTED = "drone-1"
LEFT = Sticks(forward=0.0, left=1.0, up=0.0, turn=0.0)
BACK = Sticks(forward=-1.0, left=0.0, up=0.0, turn=0.0)
AHEAD = Sticks(forward=1.0, left=0.0, up=0.0, turn=0.0)
TURN = Sticks(forward=0.0, left=0.0, up=0.0, turn=1.0)


async def taken_off(control: Control, fleet: Fleet) -> None:
    drone = fleet.drones[PILOTED]
    await until(lambda: drone.telemetry is not None and drone.newest_frame is not None)
    await control.command_drone(PILOTED, "takeoff")
    await until(lambda: drone.activity == "flying")
    await asyncio.sleep(1.0)
    control.steer(PILOTED, AT_REST)


async def push(control: Control, sticks: Sticks, seconds: float) -> None:
    """Send sticks as a browser does."""
    for _ in range(round(10.0 * seconds)):
        control.steer(PILOTED, sticks)
        await asyncio.sleep(0.1)


def place(flight: VirtualFlight) -> np.ndarray:
    return np.array(flight.tellos[PILOTED].airframe.position)


def speed(flight: VirtualFlight) -> float:
    return float(np.linalg.norm(flight.tellos[PILOTED].airframe.velocity[:2]))


def heading(flight: VirtualFlight) -> float:
    return float(flight.tellos[PILOTED].airframe.yaw_rad)


def test_it_goes_where_the_sticks_point_and_hovers_when_they_fall_silent(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await taken_off(control, fleet)
        report = control.drones()[0]
        for age_s in (report.link_age_s, report.object_age_s, report.velocity_age_s):
            assert age_s is not None
            assert age_s < 1.0
        before, yaw = place(flight), heading(flight)
        await push(control, LEFT, 2.0)
        moved = place(flight) - before
        along = float(moved[:2] @ [-np.sin(yaw), np.cos(yaw)])
        # The coasting rule lets it go no faster than a dead link would be harmless.
        assert along > 0.2
        assert np.linalg.norm(moved[:2]) < 1.3 * along
        await asyncio.sleep(1.5)
        assert speed(flight) < 0.1
        before, yaw = place(flight), heading(flight)
        await push(control, TURN, 2.0)
        assert (heading(flight) - yaw) % (2.0 * np.pi) > 0.6
        assert np.linalg.norm(place(flight) - before) < 0.3

    tell(story, tmp_path)


def test_no_stick_carries_it_over_the_fence_or_into_the_object(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await taken_off(control, fleet)
        for sticks, seconds in ((AHEAD, 20.0), (BACK, 90.0)):
            for _ in range(round(seconds)):
                await push(control, sticks, 1.0)
                assert 0.5 < np.linalg.norm(place(flight)[:2]) < SafetyConfig().fence_radius_m
        assert np.linalg.norm(place(flight)[:2]) > 3.0, "it has come to the fence"

    tell(story, tmp_path)


def test_sticks_move_nothing_that_a_capture_flies_that_is_held_or_that_stands(
    tmp_path: Path,
) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        with pytest.raises(RefusedError, match="does not fly"):
            control.steer(PILOTED, LEFT)
        await taken_off(control, fleet)
        await push(control, LEFT, 0.5)
        fleet.hold(PILOTED)
        with pytest.raises(RefusedError, match="does not fly"):
            control.steer(PILOTED, LEFT)
        await asyncio.sleep(2.0)
        assert speed(flight) < 0.1
        fleet.drones[PILOTED].rearm()
        # Sticks that are pushed when it is re-armed must come to rest first.
        await push(control, LEFT, 2.0)
        assert speed(flight) < 0.1
        control.steer(PILOTED, AT_REST)
        await push(control, LEFT, 1.5)
        assert speed(flight) > 0.1
        with pytest.raises(RefusedError, match="in the air; land first"):
            await control.start_capture(REQUEST)
        fleet.land(PILOTED)
        await until(lambda: fleet.drones[PILOTED].activity == "ground")
        record = await control.start_capture(REQUEST)
        with pytest.raises(RefusedError, match="capture is running"):
            control.steer(PILOTED, AT_REST)
        centring = await in_phase(control, "centre")
        assert list(centring.status.entered) == ["preflight", "take_off", "centre"]
        with pytest.raises(RefusedError, match="capture is running"):
            control.steer(PILOTED, LEFT)
        await control.abort_capture(record.status.id)
        await control.wait_for_capture(record.status.id)

    tell(story, tmp_path)


def test_a_drone_that_took_off_again_outlives_the_end_of_the_capture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = InlineRunner.submit

    async def submit(runner: InlineRunner, spec: JobSpec, folder: Path) -> InlineJob:
        trains = spec.kind == "reconstruct"
        return InlineJob(spec, hangs=True) if trains else await plan(runner, spec, folder)

    monkeypatch.setattr(InlineRunner, "submit", submit)

    async def story(_: VirtualFlight, control: Control, fleet: Fleet) -> None:
        drone = fleet.drones[PILOTED]
        record = await control.start_capture(replace(REQUEST, pictures=4, train_seconds=5.0))
        await in_phase(control, "train")
        await control.command_drone(PILOTED, "takeoff")
        await until(lambda: drone.activity == "flying")
        await control.abort_capture(record.status.id)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "aborted"
        await asyncio.sleep(2.0)
        assert drone.activity == "flying"

    tell(story, tmp_path)
