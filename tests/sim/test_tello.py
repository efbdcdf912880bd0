"""A whole simulated drone, without sockets and clock: power, faults, state, video."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from server.sim.config import DynamicsConfig, SimConfig
from server.sim.faults import parse_fault
from server.sim.radio import Radio
from server.sim.tello import STEP_S, Outgoing, Tello
from server.sim.words import SdkLevel

ME = ("10.0.0.2", 40000)
CALM = DynamicsConfig.calm()


class Flight:
    """A drone with the time passing by."""

    def __init__(self, *faults: str, config: SimConfig | None = None) -> None:
        config = config or SimConfig(drones=1, dynamics=CALM)
        config = replace(config, faults=tuple(map(parse_fault, faults)))
        self.tello = Tello(config, 0)
        self.now_s = 50.0
        self.heard: list[tuple[float, Outgoing]] = []
        self._keep(self.tello.advance(self.now_s))

    def say(self, text: str) -> list[str]:
        out = self.tello.receive(text.encode(), ME, self.now_s)
        self._keep(out)
        return [o.datagram.decode("latin1") for o in out if o.kind == "reply"]

    def wait(self, seconds: float) -> list[str]:
        """Let time pass in silence but for the sticks; return the replies."""
        begun = len(self.heard)
        for step in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self._keep(self.tello.advance(self.now_s))
            if step % 100 == 50:
                self._keep(self.tello.receive(b"rc 0 0 0 0", ME, self.now_s))
        new = [outgoing for _, outgoing in self.heard[begun:]]
        return [o.datagram.decode("latin1") for o in new if o.kind == "reply"]

    def states(self, since_s: float) -> list[bytes]:
        return [o.datagram for at, o in self.heard if o.kind == "state" and at >= since_s]

    def up(self) -> None:
        assert self.say("command") == ["ok"]
        assert self.say("takeoff") == []
        assert self.wait(6.0) == ["ok"]

    def _keep(self, out: list[Outgoing]) -> None:
        self.heard += [(self.now_s, outgoing) for outgoing in out]


def test_silent_until_command_then_ten_reports_a_second() -> None:
    flight = Flight()
    flight.wait(2.0)
    assert flight.heard == []
    assert flight.say("takeoff") == []
    begun_s = flight.now_s
    assert flight.say("command") == ["ok"]
    flight.wait(10.0)
    states = flight.states(begun_s)
    assert 99 <= len(states) <= 101
    first_s = min(at for at, o in flight.heard if o.kind == "state")
    assert first_s - begun_s <= 0.1 + 1e-6
    assert {o.to for _, o in flight.heard if o.kind == "state"} == {(ME[0], 8890)}


def test_after_a_stall_it_has_flown_on_but_reports_no_burst() -> None:
    flight = Flight()
    flight.up()
    before_m = flight.tello.airframe.position[2]
    assert flight.say("up 100") == []
    flight.now_s += 8.0
    out = flight.tello.advance(flight.now_s)
    assert [o.kind for o in out] == ["reply", "state"]
    assert flight.tello.airframe.position[2] - before_m == pytest.approx(1.0, abs=0.08)


def test_port_moves_state_and_video() -> None:
    flight = Flight()
    flight.say("command")
    assert flight.say("port 9001 9002") == ["ok"]
    assert flight.say("streamon") == ["ok"]
    begun_s = flight.now_s
    flight.wait(0.5)
    assert {o.to[1] for at, o in flight.heard if o.kind == "state" and at > begun_s} == {9001}
    video = flight.tello.video(b"picture")
    assert video == Outgoing(b"picture", (ME[0], 9002), "video")
    flight.say("streamoff")
    assert flight.tello.video(b"picture") is None


def test_a_reboot_in_the_air_falls_is_silent_and_needs_command_again() -> None:
    flight = Flight()
    flight.up()
    flight.say("streamon")
    begun_s = flight.now_s
    assert flight.say("reboot") == [], "no answer when it works"
    flight.wait(2.0)
    assert flight.tello.airframe.phase == "standing"
    assert not flight.tello.powered
    assert flight.say("command") == []
    assert flight.states(begun_s + 0.1) == []
    flight.wait(8.0)
    assert flight.tello.powered
    assert flight.say("battery?") == [], "the other protocol's until it is told"
    assert flight.say("command") == ["ok"]
    assert not flight.tello.wants_pictures
    assert flight.tello.airframe.motor_time_s == 0.0


@pytest.mark.parametrize("order", ["ap some secret", "wifi some secret"])
def test_a_new_network_answers_with_a_nul_and_restarts(order: str) -> None:
    flight = Flight()
    flight.say("command")
    assert flight.say(order) == ["OK,drone will reboot in 3s\0"]
    flight.wait(2.5)
    assert flight.tello.powered
    flight.wait(1.0)
    assert not flight.tello.powered
    flight.wait(8.0)
    assert flight.say("command") == ["ok"]
    assert flight.tello.sdk.station == order.startswith("ap")


@pytest.mark.parametrize(("level", "seen"), [("2.0", False), ("3.0", True)])
def test_sdk_2_sends_no_video_in_a_network_of_others(level: SdkLevel, seen: bool) -> None:
    flight = Flight(config=SimConfig(drones=1, sdk=level, station=True))
    flight.say("command")
    assert flight.say("streamon") == ["ok"]
    assert flight.tello.wants_pictures == seen


def test_power_cut_falls_and_comes_back_only_with_a_duration() -> None:
    for word, back in (("power_cut@air+5", False), ("power_cut@air+5+3", True)):
        flight = Flight(word)
        flight.up()
        assert not flight.tello.powered
        flight.wait(2.0)
        assert flight.tello.airframe.phase == "standing"
        flight.wait(15.0)
        assert flight.tello.powered == back


def test_without_power_it_cannot_restart() -> None:
    flight = Flight("power_cut@1", "reboot@2")
    flight.wait(15.0)
    assert not flight.tello.powered


def test_an_empty_battery_falls_and_a_low_one_lands() -> None:
    flight = Flight()
    flight.up()
    flight.tello.inject(parse_fault("low_battery=4"), flight.now_s)
    flight.wait(1.0)
    assert flight.tello.airframe.phase == "landing"
    assert flight.say("up 50") == ["error Auto land"]
    flight.wait(5.0)
    assert flight.tello.airframe.phase == "standing"
    empty = Flight()
    empty.up()
    empty.tello.inject(parse_fault("low_battery=0"), empty.now_s)
    empty.wait(0.1)
    assert empty.tello.airframe.phase == "falling"
    empty.wait(2.0)
    assert not empty.tello.powered


def test_heat_keeps_it_down_and_too_much_switches_it_off() -> None:
    flight = Flight("high_temperature")
    flight.say("command")
    flight.wait(1.0)
    assert flight.say("takeoff") == ["error, high temp"]
    flight.tello.airframe.heat_c = 106.0
    flight.wait(0.1)
    assert not flight.tello.powered


def test_ok_but_it_stayed_down() -> None:
    flight = Flight("stays_down@0+10")
    flight.say("command")
    assert flight.say("takeoff") == []
    assert flight.wait(6.0) == ["ok"]
    assert flight.tello.airframe.position[2] == 0.0
    assert flight.say("up 50") == ["error Motor stop"]
    flight.wait(6.0)
    assert flight.say("takeoff") == []
    assert flight.wait(6.0) == ["ok"]
    assert flight.tello.airframe.phase == "flying"


def test_no_valid_imu_for_a_while() -> None:
    flight = Flight("no_valid_imu@air+8+5")
    flight.up()
    flight.wait(4.0)
    assert flight.say("forward 50") == ["error No valid imu"]
    flight.wait(6.0)
    assert flight.say("forward 50") == []


@pytest.mark.parametrize(("word", "metres"), [("gust=0.5@air+8", 1.0), ("drift_away=0.2", 0.8)])
def test_winds_carry_it_off_in_a_direction_of_the_seed(word: str, metres: float) -> None:
    ends = []
    for seed in (1, 1, 2):
        flight = Flight(word, config=SimConfig(drones=1, seed=seed, dynamics=CALM))
        flight.up()
        flight.wait(2.0)
        before = flight.tello.airframe.position
        flight.wait(4.0)
        moved = flight.tello.airframe.position - before
        assert np.linalg.norm(moved[:2]) == pytest.approx(metres, abs=0.15)
        assert abs(moved[2]) < 0.05
        ends.append(moved)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.linalg.norm(ends[0] - ends[2]) > 0.05


def test_late_replies_come_late_and_in_order() -> None:
    flight = Flight("late_replies=1.5")
    assert flight.say("command") == []
    assert flight.say("battery?") == []
    assert flight.wait(1.4) == []
    assert flight.wait(0.2) == ["ok", "100\r\n"]


def test_garbage_comes_after_command_and_now_and_then() -> None:
    flight = Flight("garbage=2")
    first = flight.say("command")
    assert first[0] == "ok"
    assert first[1].startswith("\xcc")
    more = [reply for reply in flight.wait(20.0) if reply.startswith("\xcc")]
    assert 20 < len(more) < 60


def spoilt(radio: Radio[Any]) -> dict[str, float]:
    """Return what is wrong with a radio, by the names of its attributes."""
    names = ("loss", "delay_s", "reorder", "duplicate")
    return {name: getattr(radio, name) for name in names if getattr(radio, name) != 0.0}


def test_faults_of_the_radio_reach_both_channels() -> None:
    flight = Flight("loss=0.5", "delay=0.3@0+5", "reorder=0.1", "duplicate=0.2")
    everything = {"loss": 0.5, "delay_s": 0.3, "reorder": 0.1, "duplicate": 0.2}
    assert spoilt(flight.tello.uplink) == pytest.approx(everything)
    assert spoilt(flight.tello.downlink) == pytest.approx(everything)
    flight.wait(5.1)
    del everything["delay_s"]
    assert spoilt(flight.tello.uplink) == pytest.approx(everything)
    assert spoilt(flight.tello.downlink) == pytest.approx(everything)


@pytest.mark.parametrize(
    ("kind", "name", "together"),
    [
        ("loss", "loss", 0.6),
        ("delay", "delay_s", 0.7),
        ("reorder", "reorder", 0.6),
        ("duplicate", "duplicate", 0.6),
    ],
)
def test_a_fault_of_one_way_spares_the_other(kind: str, name: str, together: float) -> None:
    """With one of both ways, shares are independent chances and seconds add up."""
    up, down = Flight(f"{kind}_up=0.2@0+5").tello, Flight(f"{kind}_down=0.2").tello
    assert (spoilt(up.uplink), spoilt(up.downlink)) == (pytest.approx({name: 0.2}), {})
    assert (spoilt(down.uplink), spoilt(down.downlink)) == ({}, pytest.approx({name: 0.2}))
    flight = Flight(f"{kind}=0.5", f"{kind}_up=0.2@0+5")
    assert spoilt(flight.tello.uplink) == pytest.approx({name: together})
    assert spoilt(flight.tello.downlink) == pytest.approx({name: 0.5})
    flight.wait(5.1)
    assert spoilt(flight.tello.uplink) == pytest.approx({name: 0.5})


def test_no_video_is_a_dark_camera() -> None:
    flight = Flight("no_video@1+2")
    flight.say("command")
    flight.say("streamon")
    seen = []
    for _ in range(4):
        seen.append(flight.tello.wants_pictures)
        flight.wait(1.0)
    assert seen == [True, False, False, True]


def test_a_fault_may_be_injected_before_the_take_off_it_counts_from() -> None:
    flight = Flight()
    flight.tello.inject(parse_fault("power_cut@air+3"), flight.now_s)
    flight.wait(5.0)
    assert flight.tello.powered
    flight.say("command")
    flight.say("takeoff")
    flight.wait(3.5)
    assert not flight.tello.powered


def test_drones_of_one_simulation_differ_and_repeat() -> None:
    config = SimConfig(seed=4)
    first = [Tello(config, index).airframe.position for index in range(4)]
    again = [Tello(config, index).airframe.position for index in range(4)]
    np.testing.assert_array_equal(first, again)
    assert len({tuple(np.round(p, 3)) for p in first}) == 4
