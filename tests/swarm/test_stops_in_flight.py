"""HOLD, LAND and CUT on a simulated drone: at once, latched, never lost, delayed or overwritten."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_air import (
    AirLink,
    fleet_on,
    flying_drone,
    flying_fleet,
    in_virtual_time,
    now_s,
    setpoint,
    steer,
    sunk_to,
)

from server.stages import StopControl
from server.swarm.drone import DroneError


def test_hold_goes_out_at_once_and_several_times() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            drone.hold()
            assert link.since(begun_s) == [b"rc 0 0 0 0", b"stop"], "before hold returns"
            await asyncio.sleep(1.0)
            assert link.since(begun_s).count(b"stop") >= 4

    in_virtual_time(story())


def test_hold_latches_until_rearm() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await steer(drone, setpoint(forward=0.4), 1.0)
            drone.hold()
            assert drone.held
            assert drone.activity == "holding"
            await steer(drone, setpoint(forward=0.4), 2.0)
            assert np.abs(link.airframe.velocity).max() < 0.01
            assert link.airframe.sticks == (0, 0, 0, 0)
            drone.rearm()
            assert drone.activity == "flying"
            await asyncio.sleep(1.0)
            assert link.airframe.sticks == (0, 0, 0, 0), "the old setpoint is forgotten"
            await steer(drone, setpoint(forward=0.4), 1.0)
            assert link.airframe.sticks[1] > 0

    in_virtual_time(story())


def test_hold_refuses_a_take_off() -> None:
    async def story() -> None:
        async with flying_drone(AirLink(), up=False) as drone:
            drone.hold()
            with pytest.raises(DroneError, match="re-arm"):
                await drone.take_off()
            drone.rearm()
            await drone.take_off()
            assert drone.activity == "flying"

    in_virtual_time(story())


@pytest.mark.parametrize("after_s", [0.0, 0.001, 0.05, 0.3, 1.0, 2.0])
def test_hold_during_a_take_off_stops_it_and_keeps_the_drone_in_sight(after_s: float) -> None:
    """Stopped close above the floor it still hovers: never call that the ground."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            attempt = asyncio.create_task(drone.take_off())
            await asyncio.sleep(after_s)
            begun_s = now_s()
            drone.hold()
            assert b"stop" in link.since(begun_s), "although a command is outstanding"
            with pytest.raises(DroneError, match="stopped"):
                await attempt
            await asyncio.sleep(8.0)
            assert np.abs(link.airframe.velocity).max() < 0.01
            assert drone.airborne == link.airframe.motors_on
            drone.land_now()
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            assert drone.activity == "ground"

    in_virtual_time(story())


@pytest.mark.parametrize("after_s", [0.0, 0.1, 0.5, 1.5, 2.2])
def test_land_during_a_take_off_does_not_wait_for_its_end(after_s: float) -> None:
    """A drone answers a second motion command with an error while the first runs."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            attempt = asyncio.create_task(drone.take_off())
            await asyncio.sleep(after_s)
            height_m = link.airframe.position[2]
            drone.land_now()
            await asyncio.sleep(0.6)
            assert link.airframe.phase in ("landing", "standing")
            assert link.airframe.position[2] < height_m + 0.15
            with pytest.raises(DroneError, match="stopped"):
                await attempt
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            assert drone.activity == "ground"

    in_virtual_time(story())


@pytest.mark.parametrize(("outage_s", "patience_s"), [(0.001, 0.2), (0.3, 0.6), (1.7, 2.8)])
def test_land_outlasts_an_outage(outage_s: float, patience_s: float) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            link.loses = lambda datagram: now_s() < begun_s + outage_s
            drone.land_now()
            assert drone.activity == "landing"
            assert not drone.set_setpoint(setpoint(forward=0.4), now_s())
            await asyncio.sleep(patience_s)
            assert link.airframe.phase == "landing"
            await asyncio.sleep(7.0)
            assert drone.activity == "ground"

    in_virtual_time(story())


@pytest.mark.parametrize("height_m", [0.6, 0.12, 0.05])
def test_a_landing_that_something_interrupts_goes_on(height_m: float) -> None:
    """Heights come in steps of 10 cm, so low is not down; hovering there is not landed."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            drone.land_now()
            await sunk_to(link, height_m)
            link.reach_drone(b"stop")  # A straggler of an earlier HOLD.
            link.reach_driver("reply", b"ok")
            link.loses = lambda datagram: datagram == b"land"
            await asyncio.sleep(6.0)
            assert link.airframe.motors_on
            assert drone.activity == "landing", "it still hovers, so the order stands"
            link.loses = lambda datagram: False
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_a_drone_that_rises_again_after_landing_is_landed_again() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await drone.land()
            await asyncio.sleep(3.0)
            link.airframe.take_off()
            await asyncio.sleep(12.0)
            assert link.airframe.phase == "standing", "the last order was to land"
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_land_while_a_take_off_waits_its_turn_is_not_forgotten() -> None:
    """LAND to a drone on the ground leaves no trace in its activity, but it must call off."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            async with drone._asking.turn:
                attempt = asyncio.create_task(drone.take_off())
                await asyncio.sleep(0.1)
                drone.land_now()
            with pytest.raises(DroneError, match="stopped"):
                await attempt
            await asyncio.sleep(3.0)
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_an_old_order_to_land_does_not_end_a_later_flight() -> None:
    async def story() -> None:
        async with flying_drone(AirLink(), up=False) as drone:
            drone.land_now()
            await drone.take_off()
            await asyncio.sleep(5.0)
            assert drone.activity == "flying"

    in_virtual_time(story())


def test_land_beats_hold_and_hold_does_not_disturb_a_landing() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            drone.hold()
            drone.land_now()
            await asyncio.sleep(0.5)
            drone.hold()
            await asyncio.sleep(6.0)
            assert link.airframe.phase == "standing"
            assert drone.held, "it stays held until re-armed"

    in_virtual_time(story())


def test_a_landing_on_something_high_is_seen_by_the_motors() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            drone.land_now()
            await asyncio.sleep(0.7)
            link.airframe._touch_down()
            x, y, _ = link.airframe.position
            link.airframe.position = (x, y, 0.4)  # A table.
            await asyncio.sleep(5.0)
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_cut_stops_the_motors_and_nothing_moves_until_rearm() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            drone.cut_motors()
            assert b"emergency" in link.since(begun_s), "before it returns"
            await asyncio.sleep(1.5)
            assert link.airframe.phase == "standing"
            begun_s = now_s()
            drone.hold()
            drone.land_now()
            assert not drone.set_setpoint(setpoint(up=0.4), now_s())
            with pytest.raises(DroneError):
                await drone.take_off()
            await asyncio.sleep(5.0)
            assert not set(link.since(begun_s)) & {b"takeoff", b"land", b"rc 0 0 0 0"}
            assert drone.activity == "cut"
            drone.rearm()
            await asyncio.sleep(2.0)
            assert drone.activity == "ground"
            await drone.take_off()
            assert drone.activity == "flying"

    in_virtual_time(story())


def test_cut_is_repeated_until_the_motors_are_seen_to_stand() -> None:
    """A short outage must not leave a drone flying that somebody has cut."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            link.loses = lambda datagram: now_s() < begun_s + 3.0
            drone.cut_motors()
            await asyncio.sleep(5.0)
            assert link.airframe.phase == "standing"
            await asyncio.sleep(4.0)
            begun_s = now_s()
            await asyncio.sleep(10.0)
            assert b"emergency" not in link.since(begun_s), "seen to stand: enough"
            assert drone.activity == "cut"

    in_virtual_time(story())


@pytest.mark.parametrize("when", ["taking off", "flying", "landing", "holding"])
def test_cut_interrupts_anything(when: str) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            attempt = asyncio.create_task(drone.take_off())
            await asyncio.sleep(1.5 if when == "taking off" else 5.0)
            if when == "landing":
                drone.land_now()
                await asyncio.sleep(0.5)
            if when == "holding":
                drone.hold()
            drone.cut_motors()
            await asyncio.sleep(1.0)
            assert link.airframe.phase == "standing"
            await asyncio.gather(attempt, return_exceptions=True)
            assert drone.activity == "cut"

    in_virtual_time(story())


def test_leaving_right_after_a_cut_still_delivers_it() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            begun_s = now_s()
            link.loses = lambda datagram: now_s() < begun_s + 0.3
            drone.cut_motors()
        assert link.airframe.phase in ("falling", "standing")

    in_virtual_time(story())


def test_a_drone_rearmed_while_it_still_flies_since_no_cut_arrived_is_landed() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            link.loses = lambda datagram: datagram == b"emergency"
            drone.cut_motors()
            await asyncio.sleep(0.5)
            drone.rearm()
            await asyncio.sleep(12.0)
            assert drone.activity == "ground"
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["hold", "land", "cut", "rearm", "steer", "take off"]),
            st.floats(0.0, 2.0),
        ),
        max_size=6,
    ),
    st.sampled_from(["land", "cut"]),
    st.integers(0, 2**16),
)
def test_whatever_came_before_the_last_stop_wins(
    orders: list[tuple[str, float]], last: str, seed: int
) -> None:
    """Random orders over a link that loses a third of everything, then LAND or CUT."""

    async def story() -> None:
        link = AirLink()
        rng = np.random.default_rng(seed)
        attempts: list[asyncio.Task[None]] = []
        async with flying_drone(link) as drone:
            link.loses = lambda datagram: rng.random() < 0.3
            link.deaf = lambda datagram: rng.random() < 0.3
            for order, pause_s in orders:
                match order:
                    case "hold":
                        drone.hold()
                    case "land":
                        drone.land_now()
                    case "cut":
                        drone.cut_motors()
                    case "rearm":
                        drone.rearm()
                    case "steer":
                        drone.set_setpoint(setpoint(forward=0.4, up=0.2), now_s())
                    case _:
                        attempts.append(asyncio.create_task(drone.take_off()))
                await asyncio.sleep(pause_s)
            if last == "land":
                drone.land_now()
            else:
                drone.cut_motors()
            await asyncio.sleep(20.0)
            assert not link.airframe.motors_on
            assert not drone.airborne
            await asyncio.gather(*attempts, return_exceptions=True)

    in_virtual_time(story())


def test_a_link_that_raises_loses_no_later_repeat() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            link.broken = True
            with pytest.raises(RuntimeError, match="broken"):
                drone.cut_motors()
            link.broken = False
            await asyncio.sleep(0.3)
            assert link.airframe.phase in ("falling", "standing")

    in_virtual_time(story())


# A fleet ------------------------------------------------------------------------------------------


def test_a_fleet_is_the_stop_control() -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(3)}
        async with flying_fleet(links) as fleet:
            stops: StopControl = fleet
            stops.hold("d1")
            assert [drone.held for drone in fleet.drones.values()] == [False, True, False]
            stops.hold()
            assert all(drone.held for drone in fleet.drones.values())
            stops.land("d0")
            await asyncio.sleep(5.0)
            assert [link.airframe.motors_on for link in links.values()] == [False, True, True]
            stops.cut_motors()
            await asyncio.sleep(1.0)
            assert not any(link.airframe.motors_on for link in links.values())
            for stop in (stops.hold, stops.land, stops.cut_motors):
                with pytest.raises(KeyError):
                    stop("d9")

    in_virtual_time(story())


@pytest.mark.parametrize("what", ["hold", "land", "cut_motors"])
def test_a_broken_or_silent_drone_never_keeps_a_stop_from_the_others(what: str) -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(4)}
        async with flying_fleet(links) as fleet:
            for drone in fleet.drones.values():
                drone.set_setpoint(setpoint(forward=0.4), now_s())
            links["d0"].broken = True
            links["d2"].loses = links["d2"].deaf = lambda datagram: True
            begun_s = now_s()
            getattr(fleet, what)()
            wanted = {"hold": b"stop", "land": b"land", "cut_motors": b"emergency"}[what]
            for drone_id in ("d1", "d2", "d3"):
                assert wanted in links[drone_id].since(begun_s)
            links["d0"].broken = False
            await asyncio.sleep(6.0)
            for drone_id in ("d0", "d1", "d3"):
                airframe = links[drone_id].airframe
                assert np.abs(airframe.velocity).max() < 0.02
                assert airframe.motors_on == (what == "hold")

    in_virtual_time(story())


def test_leaving_a_fleet_lands_all_at_once_and_waits_for_dead_ones_only_once() -> None:
    async def story() -> None:
        links = {f"d{k}": AirLink(seed=k) for k in range(4)}
        async with flying_fleet(links):
            for drone_id in ("d0", "d2", "d3"):
                links[drone_id].loses = links[drone_id].deaf = lambda datagram: True
            begun_s = now_s()
        assert now_s() - begun_s < 15.0
        assert links["d1"].airframe.phase == "standing"

    in_virtual_time(story())


def test_a_drone_that_does_not_answer_is_named_and_the_others_connect() -> None:
    async def story() -> None:
        links = {"d0": AirLink(seed=0), "d1": AirLink(seed=1)}
        links["d0"].loses = lambda datagram: True
        async with fleet_on(links) as fleet:
            failures = await fleet.connect(timeout_s=3.0)
            assert list(failures) == ["d0"]
            assert "127.9.9.1 did not answer within 3 s" in failures["d0"]
            assert fleet.drones["d0"].activity == "offline"
            assert fleet.drones["d1"].activity == "ground"

    in_virtual_time(story())
