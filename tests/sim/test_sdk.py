"""The simulated drone's side of the text protocol, against the replies of real ones."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.sim.config import DynamicsConfig
from server.sim.dynamics import Airframe
from server.sim.sdk import AUTO_LAND_S, TextSdk

STEP_S = 0.02
ME = ("127.0.0.1", 40000)


class Tello:
    """A simulated drone and its clock."""

    def __init__(self, *, entered: bool = True) -> None:
        config = DynamicsConfig(drift_sigma_m_s=0.0, yaw_walk_deg=0.0, gyro_bias_deg_s=0.0)
        self.airframe = Airframe(np.zeros(3), 0.0, config, np.random.default_rng(0))
        self.sdk = TextSdk(self.airframe, "0TQTEST0000001")
        self.now_s = 0.0
        if entered:
            assert self.say("command") == ["ok"]

    def say(self, text: str | bytes) -> list[str]:
        """Send a datagram; return the replies that come at once."""
        data = text if isinstance(text, bytes) else text.encode()
        out = self.sdk.receive(data, ME, self.now_s)
        assert all(receiver == ME for _, receiver in out)
        return [reply.decode() for reply, _ in out]

    def wait(self, seconds: float, renew: str = "") -> list[str]:
        """Let time pass; return the replies that come meanwhile."""
        replies: list[str] = []
        for step in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            if renew and step % 50 == 0:
                self.say(renew)
            self.airframe.step(STEP_S)
            replies += [reply.decode() for reply, _ in self.sdk.tick(self.now_s)]
        return replies

    def take_off(self) -> None:
        assert self.say("takeoff") == []
        assert self.wait(8.0) == ["ok"]


def test_it_is_silent_before_command() -> None:
    tello = Tello(entered=False)
    assert tello.say("takeoff") == []
    assert tello.say("battery?") == []
    assert tello.sdk.client is None
    assert tello.say("command") == ["ok"]
    assert tello.sdk.client == ME[0]
    assert tello.say("command") == ["ok"], "repeating it is harmless"


def test_motion_is_answered_at_its_end_and_not_queued() -> None:
    tello = Tello()
    assert tello.say("takeoff") == []
    assert tello.wait(0.5) == []
    assert tello.say("up 50") == ["error Not joystick"]
    assert tello.say("land") == ["error Not joystick"]
    assert tello.wait(8.0) == ["ok"]
    assert tello.say("land") == []
    assert tello.wait(5.0) == ["ok"]


def test_stop_interrupts_what_runs() -> None:
    tello = Tello()
    tello.take_off()
    assert tello.say("forward 300") == []
    tello.wait(0.5)
    assert tello.say("stop") == ["forced stop", "ok"]
    assert tello.wait(3.0) == []
    assert tello.say("stop") == ["ok"]
    assert tello.airframe.phase == "flying"


def test_emergency_works_any_time() -> None:
    tello = Tello()
    tello.say("takeoff")
    tello.wait(1.0)
    assert "forced stop" in tello.say("emergency")
    assert not tello.airframe.motors_on
    tello.wait(2.0)
    assert tello.say("up 30") == ["error Motor stop"]


def test_refusals() -> None:
    tello = Tello()
    assert tello.say("land") == ["error"]
    assert tello.say("up 50") == ["error Motor stop"]
    assert tello.say("up 19") == ["out of range"]
    assert tello.say("go 20 -20 20 50") == ["out of range"]
    assert tello.say("speed 101") == ["out of range"]
    assert tello.say("go 100 0 0 5") == ["out of range"]
    assert tello.say("setbitrate 2") == ["unknown command: setbitrate"]
    assert tello.say("up") == ["unknown command: up"]
    assert tello.say("up x") == ["unknown command: up"]
    tello.take_off()
    assert tello.say("takeoff") == ["error"]


def test_a_hot_or_empty_drone_does_not_take_off() -> None:
    tello = Tello()
    tello.airframe.temperature_c = 101.0
    assert tello.say("takeoff") == ["error, high temp"]
    tello = Tello()
    tello.airframe.battery_pct = 5.0
    assert tello.say("takeoff") == ["error"]


@pytest.mark.parametrize(
    ("order", "axis", "sign"),
    [
        ("forward 100", 0, 1),
        ("back 100", 0, -1),
        ("left 100", 1, 1),
        ("right 100", 1, -1),
        ("up 100", 2, 1),
        ("down 40", 2, -1),
        ("go 100 0 0 60", 0, 1),
        ("go 0 100 0 60", 1, 1),
        ("go 0 0 100 60", 2, 1),
    ],
)
def test_moves_go_where_they_say(order: str, axis: int, sign: int) -> None:
    tello = Tello()
    tello.take_off()
    before = tello.airframe.position.copy()
    assert tello.say(order) == []
    assert tello.wait(14.0) == ["ok"]
    moved = tello.airframe.position - before
    metres = 0.4 if order == "down 40" else 1.0
    assert moved[axis] == pytest.approx(sign * metres, abs=0.08)
    assert np.abs(np.delete(moved, axis)).max() < 0.08


@pytest.mark.parametrize(("order", "sign"), [("cw 90", -1), ("ccw 90", 1)])
def test_turns(order: str, sign: int) -> None:
    tello = Tello()
    tello.take_off()
    assert tello.say(order) == []
    assert tello.wait(9.0) == ["ok"]
    assert tello.airframe.yaw_rad == pytest.approx(sign * math.pi / 2, abs=math.radians(3))


@pytest.mark.parametrize("text", ["rc 10 20 30 40", "rc 1 2 3", "rc a b c d", "rc 0 0 0 101", "rc"])
def test_rc_never_answers(text: str) -> None:
    tello = Tello()
    assert tello.say(text) == []


def test_bad_rc_changes_nothing() -> None:
    tello = Tello()
    tello.say("rc 10 -20 30 -40")
    tello.say("rc 0 0 0 101")
    assert tello.airframe.sticks == (10, -20, 30, -40)


READS = {
    "battery?": r"\d+",
    "speed?": r"\d+\.\d",
    "time?": r"\d+s",
    "wifi?": r"\d+",
    "sdk?": r"20",
    "sn?": r"[A-Z0-9]{14}",
    "height?": r"-?\d+dm",
    "temp?": r"\d+~\d+C",
    "attitude?": r"pitch:-?\d+;roll:-?\d+;yaw:-?\d+;",
    "acceleration?": r"agx:-?\d+\.\d\d;agy:-?\d+\.\d\d;agz:-?\d+\.\d\d;",
    "baro?": r"-?\d+\.\d{6}",
    "tof?": r"\d+mm",
}


@pytest.mark.parametrize("read", READS)
def test_reads_look_like_a_real_drones(read: str) -> None:
    (reply,) = Tello().say(read)
    assert re.fullmatch(READS[read] + "\r\n", reply)


def test_unknown_reads() -> None:
    assert Tello().say("colour?") == ["unknown command: colour?"]


def test_video_switch() -> None:
    tello = Tello()
    assert not tello.sdk.streaming
    assert tello.say("streamon") == ["ok"]
    assert tello.sdk.streaming
    assert tello.sdk.key_picture_due
    assert tello.say("streamoff") == ["ok"]
    assert not tello.sdk.streaming


@pytest.mark.parametrize("form", [b"Re01%02d ", b"Re\x01\x07\x01%02d"])
def test_copies_under_one_label_are_carried_out_once(form: bytes) -> None:
    """Both known forms of the loss-proof head are seven bytes with the label at 2 and 3."""
    tello = Tello()
    heads = [(form % copy)[:7].ljust(7) for copy in range(1, 6)]
    for head in heads:
        assert tello.sdk.receive(head + b"takeoff", ME, tello.now_s) == []
    out: list[bytes] = []
    for _ in range(500):
        tello.airframe.step(STEP_S)
        out += [reply for reply, _ in tello.sdk.tick(tello.now_s)]
    assert out == [heads[0] + b"ok"]
    late = tello.sdk.receive(heads[4] + b"takeoff", ME, tello.now_s)
    assert [reply for reply, _ in late] == [heads[4] + b"ok"], "not the error of a second take-off"


# Silence -----------------------------------------------------------------------------------------


def test_fifteen_seconds_of_silence_land_it() -> None:
    tello = Tello()
    tello.take_off()
    tello.say("rc 0 0 0 0")
    assert tello.wait(AUTO_LAND_S - 1.0) == []
    assert tello.airframe.phase == "flying"
    tello.wait(1.5)
    assert tello.airframe.phase == "landing"
    tello.say("rc 0 50 50 0")
    assert tello.airframe.sticks == (0, 0, 0, 0)
    assert tello.say("up 50") == ["error Auto land"]
    assert tello.say("stop") == ["ok"]
    assert tello.airframe.phase == "landing", "nothing stops it"
    tello.wait(5.0)
    assert tello.airframe.phase == "standing"
    assert tello.say("takeoff") == []


@pytest.mark.parametrize("renew", ["rc 0 0 0 0", "command", "battery?"])
def test_any_command_keeps_it_in_the_air(renew: str) -> None:
    tello = Tello()
    tello.take_off()
    tello.wait(40.0, renew)
    assert tello.airframe.phase == "flying"


def test_an_empty_battery_lands_it_whatever_is_said() -> None:
    tello = Tello()
    tello.take_off()
    tello.airframe.battery_pct = 4.0
    tello.wait(6.0, "rc 0 0 0 0")
    assert tello.airframe.phase == "standing"


# Rubbish -----------------------------------------------------------------------------------------

WORDS = [
    "command",
    "takeoff",
    "land",
    "stop",
    "emergency",
    "rc 0 50 0 0",
    "up 50",
    "cw 90",
    "go 100 0 0 50",
    "flip l",
    "battery?",
    "streamon",
    "speed 50",
    "Re01001 land",
    "",
]


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.one_of(st.sampled_from(WORDS).map(str.encode), st.binary(max_size=30), st.floats(0, 3)),
        max_size=20,
    )
)
def test_no_talk_upsets_it(talk: list[bytes | float]) -> None:
    tello = Tello()
    for item in talk:
        if not isinstance(item, bytes):
            tello.wait(item)
        else:
            for reply, _ in tello.sdk.receive(item, ME, tello.now_s):
                assert reply
    tello.say("emergency")
    tello.wait(3.0)
    assert tello.airframe.phase == "standing"
    assert np.isfinite(tello.airframe.position).all()
