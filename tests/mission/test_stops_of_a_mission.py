"""Stops that come at awkward moments of a mission, in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from virtual_console import REQUEST, in_phase, tell, until

from server.app import bring_down
from server.bench.missions.virtual_flight import VirtualFlight
from server.mission.commands import RefusedError
from server.mission.control import Control
from server.swarm.fleet import Fleet

pytestmark = pytest.mark.slow


def standing(flight: VirtualFlight) -> int:
    return sum(tello.airframe.phase == "standing" for tello in flight.tellos.values())


def test_hold_during_the_landing_of_an_abort_waits_and_a_second_abort_does_not(
    tmp_path: Path,
) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        record = await in_phase(control, "centre")
        await control.abort_capture(record.status.id)
        await in_phase(control, "land")
        fleet.hold()
        await asyncio.sleep(10.0)
        held = [drone.activity for drone in fleet.drones.values()]
        assert held.count("holding") == 4, "somebody may stand below"
        await control.abort_capture(record.status.id)
        await until(lambda: standing(flight) == 4)

    tell(story, tmp_path)


def test_an_abort_lands_the_drones_that_are_held(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        record = await in_phase(control, "centre")
        fleet.hold()
        await asyncio.sleep(1.0)
        await control.abort_capture(record.status.id)
        await until(lambda: standing(flight) == 4)

    tell(story, tmp_path)


def test_a_drone_held_again_after_the_abort_waits_again(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        record = await in_phase(control, "centre")
        fleet.hold()
        await asyncio.sleep(1.0)
        await control.abort_capture(record.status.id)
        for drone in fleet.drones.values():
            drone.rearm()
        fleet.hold()
        await asyncio.sleep(10.0)
        assert [drone.activity for drone in fleet.drones.values()] == ["holding"] * 4

    tell(story, tmp_path)


def test_land_before_take_off_keeps_everybody_on_the_ground(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        await in_phase(control, "preflight")
        await asyncio.sleep(0.1)
        fleet.land()
        record = await control.wait_for_capture(control.captures()[0].status.id)
        assert record.status.state == "failed"
        assert "stopped before take-off" in (record.status.error or "")
        assert standing(flight) == 4

    tell(story, tmp_path)


def test_a_task_that_fails_during_preflight_keeps_everybody_on_the_ground(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        record = await in_phase(control, "preflight")

        async def fails() -> None:
            raise ZeroDivisionError

        task = asyncio.create_task(fails(), name="pilot")
        task.add_done_callback(control._on_task_end)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state in ("failed", "aborted")
        assert standing(flight) == 4
        with pytest.raises(RefusedError, match="“pilot” has failed"):
            await control.resume_capture(record.status.id)

    tell(story, tmp_path)


def test_a_log_that_cannot_be_written_lands_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        await in_phase(control, "take_off")

        def full(*_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patched:
            patched.setattr("server.store.runs.RunFolder.log", full)
            await in_phase(control, "fly")
        record = await control.wait_for_capture(control.captures()[0].status.id)
        assert record.status.state == "succeeded"

    tell(story, tmp_path)


def test_a_pause_lasts_as_long_as_the_operator_wants(tmp_path: Path) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        record = await in_phase(control, "fly")
        await control.pause_capture(record.status.id)
        await asyncio.sleep(90.0)
        assert control.captures()[0].status.state == "paused"
        assert standing(flight) == 0
        await control.resume_capture(record.status.id)
        record = await control.wait_for_capture(record.status.id)
        assert record.status.state == "succeeded"

    tell(story, tmp_path)


def test_ending_the_program_lands_everybody_while_the_stops_are_still_served(
    tmp_path: Path,
) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        await control.start_capture(REQUEST)
        await in_phase(control, "centre")
        await until(lambda: standing(flight) == 0)
        await bring_down(control, fleet)
        assert standing(flight) == 4
        assert control.captures()[0].status.state == "aborted"
        # Control and fleet are still open: whoever presses a stop now is heard.
        fleet.hold()
        assert all(drone.held for drone in fleet.drones.values())

    tell(story, tmp_path)
