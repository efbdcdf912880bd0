"""Getting to know a drone, and again after it was switched off, moved or exchanged."""

from __future__ import annotations

import asyncio

import pytest
from virtual_air import AirLink, fleet_on, flying_drone, in_virtual_time, now_s

from server.swarm.config import DroneConfig
from server.swarm.drone import Drone, DroneError

SERIAL = "0TQSIM00000001"


def test_a_drone_tells_who_it_is() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(1.0)
            facts = drone.facts
            assert facts.serial == SERIAL
            assert facts.sdk == 30
            assert facts.hardware == "TELLO"
            assert facts.wifi_snr == 90
            assert facts.battery_pct == 100
            age_s = facts.age_s(now_s())
            assert age_s is not None
            assert 0.0 <= age_s < 1.2
            begun_s = now_s()
            await asyncio.sleep(30.0)
            asked = [d for d in link.since(begun_s) if d.endswith(b"?")]
            assert not asked, "once told is enough"

    in_virtual_time(story())


def test_a_drone_too_old_to_tell_is_known_by_that() -> None:
    async def story() -> None:
        link = AirLink(sdk="1.3")
        async with flying_drone(link, up=False, config=DroneConfig(edu=False)) as drone:
            await asyncio.sleep(2.0)
            assert drone.facts.sdk == 13
            assert drone.facts.serial is None
            assert drone.facts.battery_pct == 100
            await drone.take_off()
            assert drone.activity == "flying"

    in_virtual_time(story())


@pytest.mark.parametrize("seed", range(5))
def test_facts_outlast_losses(seed: int) -> None:
    async def story() -> None:
        link = AirLink(seed=seed, faults=("loss=0.2", "duplicate=0.2", "garbage"))
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(60.0)
            facts = drone.facts
            serial = f"0TQSIM{seed:04d}0001"
            assert (facts.serial, facts.sdk, facts.hardware) == (serial, 30, "TELLO")
            assert (facts.wifi_snr, facts.battery_pct) == (90, 100)

    in_virtual_time(story())


def test_the_right_drone_is_accepted_and_another_one_refused() -> None:
    async def story() -> None:
        async with flying_drone(AirLink(), up=False, config=DroneConfig(serial=SERIAL)) as drone:
            assert drone.stranger == ""
            await drone.take_off()
        wrong = DroneConfig(serial="0TQDG3UEDBSP12")
        async with Drone(wrong, AirLink(), clock=now_s) as drone:
            with pytest.raises(DroneError, match=f"{SERIAL}, not 0TQDG3UEDBSP12"):
                await drone.connect()
            await asyncio.sleep(1.0)
            with pytest.raises(DroneError, match="another drone answers"):
                await drone.take_off()

    in_virtual_time(story())


def test_a_drone_that_hides_who_it_is_is_refused_where_that_matters() -> None:
    async def story() -> None:
        config = DroneConfig(edu=False, serial=SERIAL)
        async with Drone(config, AirLink(sdk="1.3"), clock=now_s) as drone:
            with pytest.raises(DroneError, match="has not told its serial number"):
                await drone.connect()

    in_virtual_time(story())


def test_a_fleet_names_the_stranger() -> None:
    async def story() -> None:
        links = {"d0": AirLink(), "d1": AirLink(seed=1)}
        async with fleet_on(links, serials=("0TQDG3UEDBSP12", "")) as fleet:
            failures = await fleet.connect()
            assert list(failures) == ["d0"]
            assert "another drone answers" in failures["d0"]
            assert fleet.drones["d1"].activity == "ground"

    in_virtual_time(story())


def test_a_firewall_that_eats_the_state_reports_is_guessed() -> None:
    async def story() -> None:
        link = AirLink()
        link.deaf = lambda datagram: b"bat:" in datagram
        async with fleet_on({"d0": link}) as fleet:
            failures = await fleet.connect(timeout_s=4.0)
            assert list(failures) == ["d0"]
            for words in ("d0 at 127.9.9.1 answers", "UDP port 8890", "firewall"):
                assert words in failures["d0"]

    in_virtual_time(story())


@pytest.mark.parametrize("fault", ["reboot@5", "power_cut@5+6"])
def test_after_a_reboot_on_the_ground_everything_is_as_before(fault: str) -> None:
    async def story() -> None:
        link = AirLink(faults=(fault,))
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(12.0)
            assert drone.activity == "offline"
            begun_s = now_s()
            await asyncio.sleep(15.0)
            assert drone.activity == "ground"
            assert link.sdk.streaming, "video, too"
            assert b"sn?" in link.since(begun_s), "it might be another one"
            age_s = drone.facts.age_s(now_s())
            assert age_s is not None
            assert age_s < 15.0
            await drone.take_off()
            assert link.airframe.phase == "flying"

    in_virtual_time(story())


@pytest.mark.parametrize("seed", range(4))
def test_after_a_reboot_in_flight_it_is_found_on_the_ground(seed: int) -> None:
    """It fell; deaf to all but ``command`` it must not be told to land for ever."""

    async def story() -> None:
        link = AirLink(seed=seed, faults=("reboot@air+6", "loss=0.1"))
        async with flying_drone(link) as drone:
            await asyncio.sleep(6.0)
            assert link.airframe.phase in ("falling", "standing")
            await asyncio.sleep(25.0)
            assert drone.activity == "ground"
            assert link.sdk.streaming
            await drone.take_off()
            assert link.airframe.phase == "flying"

    in_virtual_time(story())


def test_a_drone_exchanged_while_it_was_off_does_not_take_off() -> None:
    async def story() -> None:
        link = AirLink(faults=("reboot@5",))
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(2.0)
            link.tello._serial = "0TQDG3UEDBSP12"
            await asyncio.sleep(20.0)
            assert drone.activity == "ground"
            with pytest.raises(DroneError, match=f"0TQDG3UEDBSP12, not {SERIAL}"):
                await drone.take_off()

    in_virtual_time(story())


def test_a_drone_that_comes_after_somebody_waited_in_vain_is_taken_in() -> None:
    async def story() -> None:
        link = AirLink(faults=("power_cut@0+10",))
        async with Drone(DroneConfig(), link, clock=now_s) as drone:
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(5.0):
                    await drone.connect()
            await asyncio.sleep(20.0)
            assert drone.activity == "ground"
            assert link.sdk.streaming
            assert drone.facts.serial == SERIAL

    in_virtual_time(story())


def test_video_that_stops_is_asked_for_within_two_seconds() -> None:
    async def story() -> None:
        link = AirLink(camera=lambda at_s: [b"\0\0\0\1\x61" + bytes(100)])
        async with flying_drone(link, up=False):
            await asyncio.sleep(10.0)
            begun_s = now_s()
            assert b"streamon" not in link.since(begun_s - 9.0), "it is there"
            link.sdk.receive(b"streamoff", ("192.168.10.2", 1), now_s())
            await asyncio.sleep(2.3)
            assert link.sdk.streaming

    in_virtual_time(story())


# Ports --------------------------------------------------------------------------------------------


def test_a_station_is_told_where_to_send() -> None:
    async def story() -> None:
        config = DroneConfig(link="station", address="10.0.0.3", state_port=8892, video_port=11113)
        link = AirLink(station=True)
        async with flying_drone(link, up=False, config=config):
            assert link.sdk.settings.state_port == 8892
            assert link.sdk.settings.video_port == 11113

    in_virtual_time(story())


def test_a_station_that_cannot_move_its_ports_is_told_in_one_line() -> None:
    async def story() -> None:
        config = DroneConfig(link="station", address="10.0.0.3", state_port=8892)
        async with Drone(config, AirLink(sdk="2.0"), clock=now_s) as drone:
            with pytest.raises(DroneError, match="SDK 20 cannot send to other ports"):
                await drone.connect()

    in_virtual_time(story())
