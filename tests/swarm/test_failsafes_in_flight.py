"""The failsafe table at work on a simulated drone: what fires, what is done, what is told."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from virtual_air import (
    AirLink,
    fleet_on,
    flying_drone,
    flying_fleet,
    in_virtual_time,
    now_s,
    setpoint,
    steer,
)

from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone, DroneError
from server.swarm.failsafes import FailsafeTable, Fired, FlightReadings

WELL = FlightReadings(fence_m=-2.0, ceiling_m=-1.0, standoff_m=1.5, separation_m=2.0)


async def fly(drone: Drone, believed: FlightReadings, seconds: float, forward: float = 0.4) -> None:
    """Steer and tell what is believed, as the pilot does."""
    until_s = now_s() + seconds
    while now_s() < until_s:
        drone.observe_flight(believed, now_s())
        drone.set_setpoint(setpoint(forward=forward, turn=0.5), now_s())
        await asyncio.sleep(1.0 / 15.0)


def speed(link: AirLink) -> float:
    return float(np.linalg.norm(link.airframe.velocity))


def events(drone: Drone) -> set[str]:
    return {fired.failsafe.event for fired in drone.fired}


def test_a_drone_that_holds_for_a_failsafe_still_evades_slowly_and_then_goes_on() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await fly(drone, WELL, 2.0)
            assert speed(link) == pytest.approx(0.4, abs=0.03)
            await fly(drone, replace(WELL, separation_m=0.5), 2.0)
            assert drone.activity == "holding"
            assert events(drone) == {"separation_m"}
            assert drone.verdict.action == "hold"
            assert 0.15 < speed(link) < 0.27
            yaw_rad = link.airframe.yaw_rad
            await fly(drone, replace(WELL, separation_m=0.5), 1.0)
            assert link.airframe.yaw_rad == pytest.approx(yaw_rad, abs=1e-3)
            await fly(drone, WELL, 2.0)
            assert drone.activity == "flying"
            assert drone.fired == ()
            assert speed(link) == pytest.approx(0.4, abs=0.03)
            drone.hold()
            await fly(drone, WELL, 2.0)
            assert speed(link) < 0.02, "the operator's HOLD lets nothing pass"

    in_virtual_time(story())


@pytest.mark.parametrize(
    "believed",
    [
        replace(WELL, fence_m=1.2),
        replace(WELL, ceiling_m=1.2),
        replace(WELL, floor_m=0.22),
        replace(WELL, pose_sigma_m=1.6),
        replace(WELL, pose_sigma_m=float("nan")),
    ],
)
def test_what_lands_a_drone(believed: FlightReadings) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await fly(drone, believed, 0.5)
            assert drone.activity == "landing"
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            assert drone.fired == (), "nothing fires on the ground"

    in_virtual_time(story())


def test_a_pilot_that_dies_leaves_a_drone_that_hovers_and_lands() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await asyncio.sleep(12.0)
            assert drone.activity == "flying", "nobody has flown it yet: nobody is missed"
            await fly(drone, WELL, 1.0)
            await asyncio.sleep(1.2)
            assert drone.activity == "holding"
            assert events(drone) == {"mission_silence_s"}
            await asyncio.sleep(9.0)
            assert drone.activity == "landing"
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            await drone.take_off()
            await asyncio.sleep(12.0)
            assert drone.activity == "flying", "the flight before is forgotten"

    in_virtual_time(story())


def test_a_drone_that_reports_but_does_not_hear_is_noticed() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await fly(drone, WELL, 3.0)
            assert drone.fired == ()
            link.loses = lambda _: True
            await fly(drone, WELL, 1.0)
            assert drone.hears, "two answers may be late or lost"
            assert drone.link_age_s == pytest.approx(1.0, abs=0.6)
            await fly(drone, WELL, 2.0)
            assert not drone.hears, "from now on the others make room for it"
            assert drone.fired == ()
            await fly(drone, WELL, 2.0)
            assert events(drone) == {"link_age_s"}
            assert drone.activity == "holding"
            link.loses = lambda _: False
            await fly(drone, WELL, 1.5)
            assert drone.activity == "flying", "it hears again"
            assert drone.hears
            link.loses = lambda _: True
            await fly(drone, WELL, 11.0)
            assert drone.activity == "landing"
            assert drone.link_age_s is None, "nobody asks it while it lands"
            link.loses = lambda _: False
            await asyncio.sleep(8.0)
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_a_drone_that_answers_nothing_in_flight_is_not_believed_deaf() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            link.loses = lambda datagram: datagram == b"battery?"
            # What was asked before the take-off does not count for this flight, nor does an ``ok``.
            drone.hold()
            await fly(drone, WELL, 2.0)
            drone.rearm()
            await fly(drone, WELL, 15.0)
            assert drone.fired == ()

    in_virtual_time(story())


def test_a_busy_radio_makes_no_drone_deaf() -> None:
    """A fifth of all datagrams lost each way: questions are asked often enough."""

    async def story() -> None:
        link = AirLink(faults=("loss=0.2",))
        async with flying_drone(link) as drone:
            held_s = 0.0
            for _ in range(120):
                await fly(drone, WELL, 0.5)
                held_s += 0.5 * any(e == "link_age_s" for e in events(drone))
            assert held_s < 2.0

    in_virtual_time(story())


def test_questions_in_flight_are_few_and_never_disturb_a_landing() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            await fly(drone, WELL, 10.0)
            assert 15 <= link.since(begun_s).count(b"battery?") <= 21
            landing_s = now_s()
            await drone.land()
            assert b"battery?" not in link.since(landing_s)

    in_virtual_time(story())


def test_without_the_operator_all_hover_and_then_land() -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(3)}
        async with flying_fleet(links) as fleet:
            await asyncio.sleep(70.0)
            assert all(drone.activity == "flying" for drone in fleet.drones.values())
            fleet.note_operator()
            await asyncio.sleep(10.0)
            fleet.note_operator()
            await asyncio.sleep(19.0)
            assert all(drone.activity == "flying" for drone in fleet.drones.values())
            await asyncio.sleep(2.0)
            assert all(drone.activity == "holding" for drone in fleet.drones.values())
            fleet.note_operator()
            await asyncio.sleep(0.2)
            assert all(drone.activity == "flying" for drone in fleet.drones.values())
            await asyncio.sleep(67.0)
            assert not any(link.airframe.motors_on for link in links.values())
            told = {(note.drone_id, note.fired.failsafe.action) for note in fleet.fired}
            assert {("d0", "hold"), ("d1", "hold"), ("d2", "hold")} < told
            assert any(action == "land_all" for _, action in told)
            assert [note.number for note in fleet.fired] == list(range(1, len(fleet.fired) + 1))

    in_virtual_time(story())


def test_an_operator_who_took_leave_is_not_missed() -> None:
    async def story() -> None:
        links = {"d0": AirLink()}
        async with flying_fleet(links) as fleet:
            fleet.note_operator()
            fleet.forget_operator()
            await asyncio.sleep(70.0)
            assert fleet.drones["d0"].activity == "flying"

    in_virtual_time(story())


def test_one_that_must_land_all_lands_the_fleet() -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(3)}
        table = FailsafeTable(standoff_m={"land_all": 0.2})
        fleet = fleet_on(links, safety=SafetyConfig(failsafes=table))
        async with fleet:
            assert await fleet.connect() == {}
            await asyncio.gather(*(drone.take_off() for drone in fleet.drones.values()))
            fleet.drones["d1"].observe_flight(replace(WELL, standoff_m=0.1), now_s())
            await asyncio.sleep(0.1)
            assert all(drone.activity == "landing" for drone in fleet.drones.values())
            await asyncio.sleep(6.0)
            assert not any(link.airframe.motors_on for link in links.values())

    in_virtual_time(story())


def test_one_that_lands_already_still_lands_the_fleet_when_a_row_says_so() -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(3)}
        table = FailsafeTable(standoff_m={"land": 0.5, "land_all": 0.2})
        fleet = fleet_on(links, safety=SafetyConfig(failsafes=table))
        async with fleet:
            assert await fleet.connect() == {}
            await asyncio.gather(*(drone.take_off() for drone in fleet.drones.values()))
            fleet.drones["d1"].observe_flight(replace(WELL, standoff_m=0.4), now_s())
            await asyncio.sleep(0.1)
            assert fleet.drones["d1"].activity == "landing"
            assert fleet.drones["d0"].activity == "flying"
            fleet.drones["d1"].observe_flight(replace(WELL, standoff_m=0.1), now_s())
            await asyncio.sleep(0.1)
            assert all(drone.activity == "landing" for drone in fleet.drones.values())

    in_virtual_time(story())


def lean(link: AirLink, degrees: int) -> None:
    """Let a report arrive in which the drone leans this much."""
    fields = link.sdk.state().split(b";")
    leaning = [b"roll:%d" % degrees if f.startswith(b"roll:") else f for f in fields]
    link.reach_driver("state", b";".join(leaning))


def test_a_drone_that_lies_on_its_side_is_cut_but_not_for_one_report() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            lean(link, 90)
            await asyncio.sleep(0.5)
            assert drone.activity == "flying"
            link.deaf = lambda datagram: b"bat:" in datagram
            await asyncio.sleep(0.1)
            lean(link, 90)
            lean(link, 90)  # The network may deliver one report twice.
            await asyncio.sleep(0.1)
            assert drone.activity == "flying"
            lean(link, -80)
            await asyncio.sleep(0.1)
            assert drone.activity == "cut"
            await asyncio.sleep(1.0)
            assert not link.airframe.motors_on

    in_virtual_time(story())


def test_a_landing_drone_can_only_be_cut() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            drone.land_now()
            await asyncio.sleep(0.6)
            begun_s = now_s()
            drone.observe_flight(replace(WELL, fence_m=2.0, separation_m=0.1), now_s())
            await asyncio.sleep(0.2)
            assert events(drone) == {"fence_m", "separation_m"}
            assert not {b"stop", b"rc 0 0 0 0"} & set(link.since(begun_s))
            link.deaf = lambda datagram: b"bat:" in datagram
            await asyncio.sleep(0.1)
            lean(link, 90)
            await asyncio.sleep(0.1)
            lean(link, 90)
            await asyncio.sleep(0.1)
            assert drone.activity == "cut"

    in_virtual_time(story())


def test_a_row_is_told_when_it_begins_and_not_while_it_flickers() -> None:
    async def story() -> None:
        told: list[tuple[str, Fired]] = []

        def tell(drone_id: str, fired: Fired) -> None:
            told.append((drone_id, fired))

        near = replace(WELL, separation_m=0.5)
        async with flying_drone(AirLink(), on_fired=tell) as drone:
            for _ in range(5):
                await fly(drone, near, 0.5)
                await fly(drone, WELL, 0.5)
            assert [fired.failsafe.event for _, fired in told] == ["separation_m"]
            assert told[0][0] == drone.config.id
            assert told[0][1].value == 0.5
            await fly(drone, WELL, 2.5)
            await fly(drone, near, 0.5)
            assert len(told) == 2

    in_virtual_time(story())


def test_a_listener_that_raises_does_not_keep_a_drone_from_landing() -> None:
    async def story() -> None:
        link = AirLink()

        def tell(drone_id: str, fired: Fired) -> None:
            raise RuntimeError("this listener is broken")

        async with flying_drone(link, on_fired=tell) as drone:
            link.airframe.battery_pct = 14.0
            await steer(drone, setpoint(forward=0.3), 8.0)
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


@pytest.mark.parametrize("name", ["battery", "temperature"])
def test_an_operator_may_override_what_is_not_final(name: str) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            if name == "battery":
                link.airframe.battery_pct = 18.0
            else:
                link.airframe.temperature_c = 96.0
            await asyncio.sleep(0.3)
            with pytest.raises(DroneError, match="must not take off"):
                await drone.take_off()
            with pytest.raises(DroneError, match="must not take off"):
                await drone.take_off(frozenset({"battery", "temperature"} - {name}))
            await drone.take_off(frozenset({name}))
            assert link.airframe.phase == "flying"

    in_virtual_time(story())


def test_nobody_overrides_silence_or_an_empty_battery() -> None:
    async def story() -> None:
        link = AirLink()
        everything = frozenset({"battery", "temperature", "state"})
        async with flying_drone(link, up=False) as drone:
            link.airframe.battery_pct = 12.0
            await asyncio.sleep(0.3)
            with pytest.raises(DroneError, match="battery"):
                await drone.take_off(everything)
            link.airframe.battery_pct = 90.0
            await asyncio.sleep(0.3)
            link.deaf = lambda datagram: b"bat:" in datagram
            await asyncio.sleep(1.5)
            with pytest.raises(DroneError, match="no state report"):
                await drone.take_off(everything)
            assert b"takeoff" not in link.since(0.0)

    in_virtual_time(story())
