"""One drone's ordinary life: connection, take-off, setpoints, landing, video, keep-alive."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest
from virtual_air import AirLink, flying_drone, in_virtual_time, now_s, plain, setpoint, steer

from server.geometry.cameras import TELLO_INTRINSICS
from server.swarm.config import DroneConfig, SafetyConfig
from server.swarm.drone import Drone, DroneError


def test_it_connects_takes_off_and_lands() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            assert drone.activity == "ground"
            assert not drone.airborne
            assert drone.telemetry is not None
            assert drone.telemetry.battery_pct == 100
            assert link.sdk.streaming
            await drone.take_off()
            assert drone.activity == "flying"
            assert link.airframe.position[2] == pytest.approx(0.8, abs=0.05)
            await drone.land()
            assert drone.activity == "ground"
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_connecting_outlasts_lost_datagrams_and_binary_rubbish() -> None:
    async def story() -> None:
        link = AirLink()
        begun_s = now_s()
        link.loses = lambda datagram: now_s() < begun_s + 3.5
        drone = Drone(DroneConfig(), link, clock=now_s)
        async with drone:
            link.reach_driver("reply", b"\xcc\x58\x00\x7c")
            async with asyncio.timeout(10.0):
                await drone.connect()
            assert drone.activity == "ground"

    in_virtual_time(story())


@pytest.mark.parametrize(
    ("wanted", "axis", "sign"),
    [
        (setpoint(forward=0.3), 0, 1),
        (setpoint(forward=-0.3), 0, -1),
        (setpoint(left=0.3), 1, 1),
        (setpoint(left=-0.3), 1, -1),
        (setpoint(up=0.2), 2, 1),
        (setpoint(up=-0.2), 2, -1),
    ],
)
def test_setpoints_move_the_right_way_at_the_right_speed(
    wanted: object, axis: int, sign: int
) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            # Heading along world +X: body and world axes are the same.
            assert abs(link.airframe.yaw_rad) < 1e-6
            assert isinstance(wanted, type(setpoint()))
            await steer(drone, wanted, 2.0)
            before = link.airframe.position.copy()
            await steer(drone, wanted, 1.0)
            moved = link.airframe.position - before
            speed = float(wanted.velocity_m_s[axis])
            assert np.sign(moved[axis]) == sign
            assert moved[axis] == pytest.approx(speed, abs=0.03)
            assert np.abs(np.delete(moved, axis)).max() < 0.02

    in_virtual_time(story())


@pytest.mark.parametrize("turn", [0.5, -0.5])
def test_a_yaw_rate_turns_counter_clockwise_when_positive(turn: float) -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await steer(drone, setpoint(turn=turn), 2.0)
            before = link.airframe.yaw_rad
            await steer(drone, setpoint(turn=turn), 1.0)
            assert link.airframe.yaw_rad - before == pytest.approx(turn, abs=0.05)
            assert drone.telemetry is not None
            assert drone.telemetry.yaw_rad == pytest.approx(link.airframe.yaw_rad, abs=0.12)

    in_virtual_time(story())


def test_a_setpoint_that_is_not_renewed_becomes_hover() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            assert drone.set_setpoint(setpoint(forward=0.4), now_s())
            await asyncio.sleep(0.3)
            assert link.airframe.sticks[1] > 0
            await asyncio.sleep(0.3)
            assert link.airframe.sticks == (0, 0, 0, 0)
            await asyncio.sleep(2.0)
            assert np.abs(link.airframe.velocity).max() < 0.01
            assert link.sent[-1][1] == b"rc 0 0 0 0"

    in_virtual_time(story())


def test_a_setpoint_dated_in_the_future_lives_no_longer() -> None:
    """A caller with another clock must not make a drone fly on for ever."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            drone.set_setpoint(setpoint(forward=0.4), now_s() + 1e6)
            await asyncio.sleep(1.0)
            assert link.airframe.sticks == (0, 0, 0, 0)

    in_virtual_time(story())


def test_its_camera_changes_on_the_ground_only() -> None:
    async def story() -> None:
        camera = replace(TELLO_INTRINSICS, fx=900.0)
        async with flying_drone(AirLink(), up=False) as drone:
            drone.calibrate(camera)
            assert drone.config.intrinsics == camera
            await drone.take_off()
            with pytest.raises(DroneError, match="in the air"):
                drone.calibrate(TELLO_INTRINSICS)
            assert drone.config.intrinsics == camera

    in_virtual_time(story())


def test_setpoints_are_refused_on_the_ground_and_when_not_finite() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            assert not drone.set_setpoint(setpoint(forward=0.3), now_s())
            await drone.take_off()
            assert not drone.set_setpoint(setpoint(forward=math.nan), now_s())
            await asyncio.sleep(0.3)
            assert link.airframe.sticks == (0, 0, 0, 0)

    in_virtual_time(story())


@pytest.mark.parametrize("edu", [True, False])
def test_a_lost_take_off_is_not_repeated(edu: bool) -> None:
    """An EDU gets copies that count as one, the consumer drone gets the order once."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False, config=DroneConfig(edu=edu)) as drone:
            link.loses = lambda datagram: datagram == b"takeoff"
            with pytest.raises(DroneError, match="not seen to take off"):
                await drone.take_off()
            ordered = [d for _, d in link.sent if plain(d) == b"takeoff"]
            if edu:
                assert len({d[:4] for d in ordered}) == 1, "one label"
                assert len(set(ordered)) == len(ordered) == 5, "numbered copies"
            else:
                assert ordered == [b"takeoff"]
            assert drone.activity == "ground"
            link.loses = lambda datagram: False
            await drone.take_off()
            assert drone.activity == "flying"

    in_virtual_time(story())


def test_a_take_off_whose_reply_is_lost_is_seen_by_its_height() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.deaf = lambda datagram: plain(datagram) == b"ok"
            await drone.take_off()
            assert drone.activity == "flying"

    in_virtual_time(story())


def test_an_ok_of_a_drone_that_stays_on_the_ground_is_not_believed() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.loses = lambda datagram: datagram == b"takeoff"
            attempt = asyncio.create_task(drone.take_off())
            await asyncio.sleep(1.0)
            link.reach_driver("reply", b"ok")
            with pytest.raises(DroneError, match="not seen to take off"):
                await attempt
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_the_drones_refusal_is_reported_in_its_words() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.airframe.temperature_c = 120.0
            link.deaf = lambda datagram: b"temph" in datagram  # Too old a report to know better.
            with pytest.raises(DroneError, match="high temp"):
                await drone.take_off()
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_a_cancelled_take_off_leaves_a_drone_that_hovers_and_lands_on_demand() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            attempt = asyncio.create_task(drone.take_off())
            await asyncio.sleep(1.5)
            attempt.cancel()
            await asyncio.gather(attempt, return_exceptions=True)
            await asyncio.sleep(20.0)
            # Still steered: a drone that nobody speaks to has landed by itself by now.
            assert drone.activity == "flying"
            assert link.airframe.phase == "flying"
            await drone.land()
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_safety_rules_refuse_a_take_off() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.airframe.battery_pct = 15.0
            await asyncio.sleep(0.3)
            with pytest.raises(DroneError, match="battery at 15 %"):
                await drone.take_off()
            assert b"takeoff" not in link.since(0.0)

    in_virtual_time(story())


def test_low_battery_lands_a_flying_drone_even_while_it_is_steered() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            link.airframe.battery_pct = 14.0
            await steer(drone, setpoint(forward=0.3), 8.0)
            assert drone.activity == "ground"
            assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_without_state_reports_a_drone_first_hovers_then_lands() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            link.deaf = lambda datagram: b"bat:" in datagram
            await steer(drone, setpoint(forward=0.3), 1.5)
            assert drone.activity == "holding"
            assert link.airframe.sticks == (0, 0, 0, 0)
            await steer(drone, setpoint(forward=0.3), 2.5)
            assert drone.activity == "landing"
            await asyncio.sleep(5.0)
            assert link.airframe.phase == "standing"
            # Down, but nobody has seen it: the order stands.
            assert drone.activity == "landing"
            link.deaf = lambda datagram: False
            await asyncio.sleep(4.0)
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_a_drone_found_in_the_air_is_made_to_hover() -> None:
    async def story() -> None:
        link = AirLink()
        link.sdk.receive(b"command", ("127.0.0.1", 1), now_s())
        link.sdk.receive(b"takeoff", ("127.0.0.1", 1), now_s())
        for _ in range(500):
            link.airframe.step(0.02)
            link.sdk.tick(now_s())
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(3.0)
            assert drone.activity == "flying"
            assert drone.airborne
        assert link.airframe.phase == "standing", "leaving lands it"

    in_virtual_time(story())


def test_leaving_lands_a_flying_drone() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link):
            assert link.airframe.phase == "flying"
        assert link.airframe.phase == "standing"

    in_virtual_time(story())


def test_leaving_gives_up_on_a_drone_that_is_gone() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link):
            link.loses = lambda datagram: True
            link.deaf = lambda datagram: True
            begun_s = now_s()
        assert now_s() - begun_s < 12.0
        assert link.since(begun_s).count(b"land") > 5

    in_virtual_time(story())


def test_on_the_ground_it_is_kept_awake_and_in_the_air_rc_never_pauses() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            begun_s = now_s()
            await asyncio.sleep(40.0)
            times = [at_s for at_s, _ in link.sent if at_s >= begun_s]
            assert max(np.diff([begun_s, *times, now_s()])) < 5.0
            await drone.take_off()
            begun_s = now_s()
            await asyncio.sleep(30.0)
            times = [at_s for at_s, d in link.sent if at_s >= begun_s and d.startswith(b"rc ")]
            assert max(np.diff([begun_s, *times, now_s()])) < 0.2
            assert link.airframe.phase == "flying"
            assert drone.activity == "flying"

    in_virtual_time(story())


def test_a_drone_switched_off_and_on_comes_back() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.deaf = lambda datagram: True
            await asyncio.sleep(4.0)
            assert drone.activity == "offline"
            link.sdk.client = None  # It has forgotten us.
            link.deaf = lambda datagram: False
            await asyncio.sleep(3.0)
            assert drone.activity == "ground"
            assert link.sdk.client is not None

    in_virtual_time(story())


def test_video_goes_off_and_on_and_is_asked_for_again_when_silent() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            drone.set_video(False)
            await asyncio.sleep(0.1)
            assert not link.sdk.streaming
            begun_s = now_s()
            await asyncio.sleep(10.0)
            assert b"streamon" not in link.since(begun_s)
            drone.set_video(True)
            await asyncio.sleep(0.1)
            assert link.sdk.streaming
            begun_s = now_s()
            await asyncio.sleep(9.0)
            assert 2 <= link.since(begun_s).count(b"streamon") <= 5

    in_virtual_time(story())


def test_waiting_for_a_picture_ends_when_the_drone_is_closed() -> None:
    async def story() -> None:
        async with flying_drone(AirLink(), up=False) as drone:
            waiting = asyncio.create_task(drone.next_frame(-1))
            await asyncio.sleep(0.1)
        with pytest.raises(DroneError, match="closed"):
            await waiting

    in_virtual_time(story())


def test_unreadable_state_reports_are_counted() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.reach_driver("state", b"bat:nan;")
            await asyncio.sleep(0.1)
            assert drone.bad_states == 1
            assert drone.activity == "ground"

    in_virtual_time(story())


def test_a_stricter_rule_set_is_obeyed() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(
            link, up=False, safety=SafetyConfig(battery_take_off_pct=100)
        ) as drone:
            link.airframe.battery_pct = 98.9
            await asyncio.sleep(0.3)
            with pytest.raises(DroneError, match="needs 100 %"):
                await drone.take_off()

    in_virtual_time(story())
