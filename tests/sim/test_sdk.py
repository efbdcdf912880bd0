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
from server.sim.words import LEVELS, SdkLevel

STEP_S = 0.02
ME = ("127.0.0.1", 40000)


class Tello:
    """A simulated drone and its clock."""

    def __init__(
        self, *, entered: bool = True, level: SdkLevel = "3.0", friendly: bool = False
    ) -> None:
        calm = DynamicsConfig.calm()
        self.airframe = Airframe(np.zeros(3), 0.0, calm, np.random.default_rng(0))
        self.sdk = TextSdk(self.airframe, "0TQTEST0000001", level, friendly_reads=friendly)
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
    assert tello.say("setpace 2") == ["unknown command: setpace"]
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
    "sdk?": r"30",
    "sn?": r"[A-Z0-9]{14}",
    "height?": r"-?\d+dm",
    "temp?": r"\d+~\d+C",
    "attitude?": r"pitch:-?\d+;roll:-?\d+;yaw:-?\d+;",
    "acceleration?": r"agx:-?\d+\.\d\d;agy:-?\d+\.\d\d;agz:-?\d+\.\d\d;",
    "baro?": r"-?\d+\.\d{6}",
    "tof?": r"\d+mm",
    "hardware?": r"TELLO",
}
FRIENDLY = READS | {
    "speed?": r"\d+",
    "time?": r"\d+",
    "height?": r"\d+",
    "temp?": r"\d+",
    "baro?": r"-?\d+",
}


@pytest.mark.parametrize("read", READS)
def test_reads_look_like_a_real_drones(read: str) -> None:
    (reply,) = Tello().say(read)
    assert re.fullmatch(READS[read] + "\r\n", reply)


@pytest.mark.parametrize("read", FRIENDLY)
def test_friendly_reads_are_plain_numbers_where_clients_want_them(read: str) -> None:
    (reply,) = Tello(friendly=True).say(read)
    assert re.fullmatch(FRIENDLY[read] + "\r\n", reply)


SINCE = {
    "1.3": ["battery?", "height?", "temp?", "tof?", "speed 50", "streamon", "flip l"],
    "2.0": ["sdk?", "sn?", "stop", "mon", "ap a b"],
    "3.0": ["hardware?", "motoron", "port 8890 11111", "setfps low", "setbitrate 3", "keepalive"],
}


@pytest.mark.parametrize("level", LEVELS)
def test_each_level_knows_its_words_and_no_later_ones(level: SdkLevel) -> None:
    for since, words in SINCE.items():
        for word in words:
            (reply,) = Tello(level=level).say(word)
            known = LEVELS.index(since) <= LEVELS.index(level)  # pyright: ignore[reportArgumentType]
            assert reply.startswith("unknown command: " + word.split()[0]) != known, word


@pytest.mark.parametrize(
    ("level", "off", "on"),
    [
        ("1.3", "pitch:", None),
        ("2.0", "mid:-1;x:0;y:0;z:0;mpry:0,0,0;pitch:", "mid:-1;x:0;"),
        ("3.0", "mid:-2;x:-200;y:-200;z:-200;mpry:", "mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;"),
    ],
)
def test_the_state_report_of_each_level(level: SdkLevel, off: str, on: str | None) -> None:
    tello = Tello(level=level)
    line = tello.sdk.state().decode()
    assert line.startswith(off)
    assert line.endswith(";\r\n")
    fields = [field.split(":") for field in line.strip().rstrip(";").split(";")]
    assert all(len(field) == 2 for field in fields)
    assert len(fields) == (16 if level == "1.3" else 21)
    if on is not None:
        assert tello.say("mon") == ["ok"]
        assert tello.say("mdirection 2") == ["ok"]
        assert tello.sdk.state().decode().startswith(on)
        assert tello.say("moff") == ["ok"]
        assert tello.say("mdirection 2") == ["error"]


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
    assert out == [head + b"ok" for head in heads], "one flight, an answer under every head"
    late = tello.sdk.receive(heads[4] + b"takeoff", ME, tello.now_s)
    assert [reply for reply, _ in late] == [heads[4] + b"ok"], "not the error of a second take-off"


def test_a_label_that_comes_round_again_is_a_new_command() -> None:
    tello = Tello()
    assert tello.say("Re0101 takeoff") == []
    assert tello.wait(8.0) == ["Re0101 ok"]
    assert tello.say("Re0102 takeoff") == ["Re0102 ok"]
    tello.wait(11.0, "rc 0 0 0 0")
    assert tello.say("Re0101 land") == []
    assert tello.wait(5.0) == ["Re0101 ok"]
    assert tello.airframe.phase == "standing"


def test_a_consumer_drone_does_not_know_the_loss_proof_form() -> None:
    assert Tello(level="1.3").say("Re0101 takeoff") == ["unknown command: Re0101"]


# Motion beyond straight ways ---------------------------------------------------------------------


def test_a_curve_passes_through_its_points() -> None:
    tello = Tello()
    tello.take_off()
    start = tello.airframe.position.copy()
    assert tello.say("curve 100 100 0 200 0 0 50") == []
    nearest = math.inf
    replies: list[str] = []
    for _ in range(1000):
        replies += tello.wait(STEP_S)
        way = tello.airframe.position - start
        nearest = min(nearest, float(np.linalg.norm(way - [1.0, 1.0, 0.0])))
    assert replies == ["ok"]
    assert nearest < 0.1
    np.testing.assert_allclose(tello.airframe.position - start, [2.0, 0.0, 0.0], atol=0.06)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3, 1.1, 2.0, -2.9])
def test_a_curve_of_the_smallest_radius_is_flown_whatever_the_heading(yaw_rad: float) -> None:
    tello = Tello()
    tello.airframe.yaw_rad = yaw_rad
    tello.take_off()
    assert tello.say("curve 50 50 0 100 0 0 40") == []


@pytest.mark.parametrize(
    ("order", "reply"),
    [
        ("curve 30 30 0 60 0 0 30", "error Radius is too large!"),
        ("curve 100 0 0 200 0 0 30", "error Radius is too large!"),
        ("curve 250 1 0 500 0 0 30", "error Radius is too large!"),
        ("curve 100 100 0 200 0 0 61", "out of range"),
        ("curve 10 10 0 200 0 0 50", "out of range"),
        ("curve 100 100 0 200 0 0", "unknown command: curve"),
        ("go 100 0 50 50 m1", "error No valid marker"),
        ("go 100 0 50 50 m-2", "error No valid marker"),
        ("go 100 0 50 50 m9", "unknown command: go"),
        ("curve 100 100 0 200 0 0 50 m3", "error No valid marker"),
        ("jump 100 0 50 50 0 m1 m2", "error No valid marker"),
        ("jump 100 0 50 50 0 m1", "unknown command: jump"),
        ("flip x", "unknown command: flip"),
    ],
)
def test_motion_that_is_refused(order: str, reply: str) -> None:
    tello = Tello()
    tello.take_off()
    assert tello.say(order) == [reply]
    assert tello.say("up 20") == [], "a refusal leaves nothing running"


@pytest.mark.parametrize("direction", "lrfb")
def test_a_flip_turns_it_over_once_and_needs_half_a_battery(direction: str) -> None:
    tello = Tello()
    tello.take_off()
    level = tello.airframe.T_world_cam()[:3, :3]
    assert tello.say(f"flip {direction}") == []
    tello.wait(0.6)
    # The angle between two rotations, from the trace of one in the other's frame.
    cosine = (np.trace(level.T @ tello.airframe.T_world_cam()[:3, :3]) - 1.0) / 2.0
    assert math.degrees(math.acos(max(-1.0, cosine))) > 120.0
    assert tello.wait(2.0) == ["ok"]
    tello.airframe.battery_pct = 49.0
    assert tello.say(f"flip {direction}") == ["error"]


def test_idling_motors_cool_the_board_and_only_on_the_ground() -> None:
    tello = Tello()
    tello.airframe.temperature_c = 84.0
    assert tello.say("motoroff") == ["error"]
    assert tello.say("motoron") == ["ok"]
    assert tello.say("motoron") == ["error"]
    tello.wait(20.0)
    assert tello.airframe.temperature_c < 83.0
    assert tello.airframe.position[2] == 0.0
    assert tello.say("motoroff") == ["ok"]
    tello.take_off()
    assert tello.say("motoron") == ["error"]


def test_a_throw_that_does_not_come_stops_the_motors() -> None:
    tello = Tello()
    assert tello.say("throwfly") == ["ok"]
    assert tello.airframe.spinning
    tello.wait(5.5)
    assert not tello.airframe.spinning


def test_without_hold_on_the_floor_only_sticks_fly_it() -> None:
    tello = Tello()
    tello.take_off()
    tello.airframe.sees_floor = False
    assert tello.say("forward 50") == ["error No valid imu"]
    assert tello.say("cw 90") == ["error No valid imu"]
    tello.say("rc 0 60 0 0")
    tello.wait(2.0)
    assert tello.airframe.velocity[0] > 0.2
    assert tello.airframe.readings()["vgx"] == 0
    assert tello.say("land") == []


# Settings ----------------------------------------------------------------------------------------


def test_settings_that_change_the_stream() -> None:
    tello = Tello()
    settings = tello.sdk.settings
    assert tello.say("setfps low") == ["ok"]
    assert tello.say("setbitrate 2") == ["ok"]
    assert tello.say("setresolution low") == ["ok"]
    assert (settings.fps, settings.bitrate_kbit_s, settings.size_px) == (5.0, 2000, (640, 480))
    assert tello.say("downvision 1") == ["ok"]
    assert settings.size_px == (320, 240)
    assert tello.say("setbitrate 0") == ["ok"]
    assert settings.bitrate_kbit_s is None
    assert tello.say("setbitrate 6") == ["out of range"]
    assert tello.say("setbitrate 0.5") == ["unknown command: setbitrate"]
    assert tello.say("setfps fast") == ["unknown command: setfps"]
    assert tello.say("port 8891 1024") == ["out of range"]
    assert tello.say("port 8891 11112") == ["ok"]
    assert (settings.state_port, settings.video_port) == (8891, 11112)


@pytest.mark.parametrize(
    ("order", "reply"),
    [
        ("EXT led 1 2 3", "unknow command: led"),
        ("EXT mled g", "unknow command: mled"),
        ("EXT", "command error: 254"),
        ("EXT colour", "command error: 254"),
        ("multiwifi a b", "unknown command: multiwifi"),
        ("wifisetchannel 3", "unknown command: wifisetchannel"),
    ],
)
def test_it_has_no_expansion_board(order: str, reply: str) -> None:
    assert Tello().say(order) == [reply]


def test_state_and_video_stay_with_the_first_client_until_it_falls_silent() -> None:
    tello = Tello()
    other = ("127.0.0.7", 9)
    assert tello.sdk.receive(b"command", other, tello.now_s) == [(b"ok", other)]
    assert tello.sdk.client == ME[0]
    tello.now_s += 16.0
    assert tello.sdk.receive(b"command", other, tello.now_s) == [(b"ok", other)]
    assert tello.sdk.client == other[0]


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
