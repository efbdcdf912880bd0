"""Drones that are not where, who or how the console believes, in virtual time."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from virtual_air import AirLink, flying_drone, in_virtual_time, now_s, setpoint, steer

from server.swarm.config import DroneConfig, SafetyConfig, StationConfig, TimingConfig
from server.swarm.drone import Drone, DroneError
from server.swarm.failsafes import FailsafeTable
from server.swarm.search import StationSearch


def test_a_drone_found_in_the_air_hovers_and_takes_no_setpoint() -> None:
    """The console died in flight and was started anew."""

    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await steer(drone, setpoint(forward=0.4), 1.0)
            link.loses = lambda datagram: True  # Dead: not even its last stop arrives.
        link.loses = lambda datagram: False
        async with Drone(DroneConfig(), link, None, TimingConfig(), clock=now_s) as anew:
            await anew.connect()
            await asyncio.sleep(2.0)
            assert anew.activity == "flying"
            assert not anew.set_setpoint(setpoint(forward=0.4), now_s())
            assert link.airframe.sticks == (0, 0, 0, 0)
            anew.hold()
            anew.rearm()
            assert not anew.set_setpoint(setpoint(forward=0.4), now_s())
            await anew.land()
            await anew.take_off()
            assert anew.set_setpoint(setpoint(forward=0.4), now_s())

    in_virtual_time(story())


def test_a_drone_that_was_away_takes_off_only_once_it_has_said_who_it_is() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            await asyncio.sleep(2.0)
            assert drone.facts.serial
            link.deaf = lambda datagram: True
            await asyncio.sleep(5.0)
            link.loses = lambda datagram: datagram == b"sn?"
            link.deaf = lambda datagram: False
            await asyncio.sleep(1.0)
            with pytest.raises(DroneError, match="not told its serial number since"):
                await drone.take_off()
            link.loses = lambda datagram: False
            await asyncio.sleep(15.0)
            await drone.take_off()

    in_virtual_time(story())


def test_landing_is_told_again_soon_and_with_centred_sticks_while_nothing_is_heard() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link) as drone:
            await steer(drone, setpoint(forward=0.4), 1.0)
            begun_s = now_s()
            link.loses = lambda datagram: now_s() < begun_s + 0.45
            drone.land_now()
            await asyncio.sleep(0.7)
            assert link.airframe.phase == "landing"
            assert link.airframe.sticks == (0, 0, 0, 0)

    in_virtual_time(story())


def test_a_take_off_that_failed_is_landed_should_it_come_late() -> None:
    async def story() -> None:
        link = AirLink()
        async with flying_drone(link, up=False) as drone:
            link.loses = lambda datagram: datagram == b"takeoff"
            with pytest.raises(DroneError):
                await drone.take_off()
            link.loses = lambda datagram: False
            link.reach_drone(b"takeoff")
            await asyncio.sleep(20.0)
            assert link.airframe.phase == "standing"
            assert drone.activity == "ground"

    in_virtual_time(story())


class FakeLink:
    """A station link that only remembers where it is."""

    def __init__(self, address: str) -> None:
        self.address = address

    async def move_to(self, address: str) -> None:
        self.address = address


A, B = "0TQAAAAAAAAAA1", "0TQAAAAAAAAAA2"


@pytest.mark.parametrize("found", [{A: "127.8.8.6"}, {A: "127.8.8.6", B: "127.8.8.5"}])
async def test_no_drone_keeps_an_address_that_another_one_has(
    found: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    links: Any = {"a": FakeLink("127.8.8.5"), "b": FakeLink("127.8.8.6")}
    drones: Any = {
        drone_id: SimpleNamespace(
            config=DroneConfig(id=drone_id, link="station", address="", serial=serial)
        )
        for drone_id, serial in (("a", A), ("b", B))
    }

    async def search(*_: object, **__: object) -> dict[str, str]:
        return found

    monkeypatch.setattr("server.swarm.search.find_stations", search)
    await StationSearch(StationConfig(), drones, links)._find(["a", "b"])
    assert links["a"].address == "127.8.8.6"
    assert links["b"].address == found.get(B, ""), "its LAND would reach the other one"


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"max_speed_m_s": 50.0}, "max_speed_m_s"),
        ({"evade_m_s": 0.6}, "evade_m_s"),
        ({"coast_s": 1e-3}, "coast_s"),
        ({"brake_s": 1e-6}, "brake_s"),
        ({"fence_radius_m": 1000.0}, "fence_radius_m"),
        ({"ceiling_m": 500.0}, "ceiling_m"),
        ({"state_fresh_s": 1e6, "state_lost_s": 2e6}, "state_fresh_s"),
    ],
)
def test_a_limit_that_protects_nobody_is_refused(changes: dict[str, float], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        SafetyConfig(**changes)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("event", ["state_age_s", "battery_pct", "mission_silence_s"])
@given(threshold=st.sampled_from([1e-3, 1e5]), action=st.sampled_from(["land", "cut", "hold"]))
def test_rows_a_flight_cannot_do_without_must_land_in_time(
    event: str, threshold: float, action: str
) -> None:
    with pytest.raises(ValueError, match=f"{event} must land"):
        FailsafeTable(**{event: {action: threshold}})  # pyright: ignore[reportArgumentType]


def test_an_ordinary_lean_must_not_cut_the_motors() -> None:
    with pytest.raises(ValueError, match=r"lean_deg\.cut must be at least 45"):
        FailsafeTable(lean_deg={"cut": 20.0})
