"""The text protocol against datagrams of real drones, and against rubbish."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.stages import Setpoint
from server.swarm.channel import CommandChannel
from server.swarm.protocol import (
    STANDARD_GRAVITY_M_S2,
    ProtocolError,
    decode_reply,
    decode_state,
    encode_command,
    encode_labelled,
    encode_rc,
    rc_from_setpoint,
    read_fields,
    read_length_m,
    read_number,
    read_serial,
    read_temperature_c,
    split_label,
)

EDU_STATE = (
    b"mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;pitch:3;roll:-1;yaw:21;vgx:2;vgy:-3;vgz:-4;"
    b"templ:84;temph:87;tof:62;h:80;bat:83;baro:94.48;time:50;agx:-10.00;agy:16.00;agz:-999.00;\r\n"
)
CONSUMER_STATE = EDU_STATE[EDU_STATE.index(b"pitch:") :]

REPLIES = [
    (b"ok", "ok"),
    (b"OK", "ok"),
    (b"ok\r\n", "ok"),
    (b"ok\0", "ok"),
    (b"OK,drone will reboot in 3s\0", "ok"),
    (b"led ok", "ok"),
    (b"matrix ok", "ok"),
    (b"error", "error"),
    (b"error Not joystick", "error"),
    (b"error Motor stop", "error"),
    (b"error Auto land", "error"),
    (b"error Auto Land", "error"),
    (b"error No valid imu", "error"),
    (b"error No valid marker", "error"),
    (b"Error. Not valid marker", "error"),
    (b"error, high temp", "error"),
    (b"error Radius is too large!", "error"),
    (b"out of range", "error"),
    (b"unknown command: setbitrate", "error"),
    (b"unknow command: led", "error"),
    (b"Unkown Command!", "error"),
    (b"command error: 254", "error"),
    (b"unactive", "error"),
    (b"forced stop", "forced_stop"),
    (b"Forced Stop\r\n", "forced_stop"),
    (b"87\r\n", "value"),
    (b"100.0\r\n", "value"),
    (b"24s\r\n", "value"),
    (b"15dm\r\n", "value"),
    (b"85~88C\r\n", "value"),
    (b"0TQDG3UEDBSP12", "value"),
    (b"pitch:0;roll:-1;yaw:0;\r\n", "value"),
    (b"-102.865509\r\n", "value"),
    (b"875mm\r\n", "value"),
]


@pytest.mark.parametrize(("datagram", "kind"), REPLIES)
def test_every_known_reply_is_sorted(datagram: bytes, kind: str) -> None:
    reply = decode_reply(datagram)
    assert reply.kind == kind
    assert reply.text == datagram.decode().strip("\0\r\n ")


@pytest.mark.parametrize(
    "datagram", [b"", b"\0\0", b"\r\n", b"\xcc\x58\x00\x7c\x68", b"ok\xcc", b"o\0k", b"\x1bok"]
)
def test_what_is_no_text_is_refused(datagram: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode_reply(datagram)


@given(st.one_of(st.binary(max_size=80), st.text(max_size=40).map(str.encode)))
def test_any_datagram_is_a_reply_or_a_protocol_error(datagram: bytes) -> None:
    try:
        reply = decode_reply(datagram)
    except ProtocolError:
        return
    assert reply.text.isascii()
    assert reply.text.isprintable()


@pytest.mark.parametrize("state", [EDU_STATE, CONSUMER_STATE, b"mid:257;" + CONSUMER_STATE])
def test_state_in_our_units_and_axes(state: bytes) -> None:
    telemetry = decode_state(state, "drone-3", 12.5)
    assert telemetry.drone_id == "drone-3"
    assert telemetry.received_s == 12.5
    # Clockwise, nose-up and right-down are the drone's; only the heading changes its sign.
    assert telemetry.yaw_rad == pytest.approx(-math.radians(21))
    assert telemetry.pitch_rad == pytest.approx(math.radians(3))
    assert telemetry.roll_rad == pytest.approx(math.radians(-1))
    # Decimetres per second forward, right, down become metres per second forward, left, up.
    np.testing.assert_allclose(telemetry.velocity_m_s, [0.2, 0.3, 0.4])
    milli_g = STANDARD_GRAVITY_M_S2 / 1000
    np.testing.assert_allclose(
        telemetry.acceleration_m_s2, np.array([-10.0, -16.0, 999.0]) * milli_g
    )
    assert telemetry.height_m == pytest.approx(0.8)
    assert telemetry.tof_m == pytest.approx(0.62)
    assert telemetry.baro_m == pytest.approx(94.48)
    assert telemetry.battery_pct == 83
    assert telemetry.temperature_c == 87
    assert telemetry.motor_time_s == 50


@pytest.mark.parametrize("sentinel", [b"10", b"6553"])
def test_range_sentinels_are_no_distance(sentinel: bytes) -> None:
    state = EDU_STATE.replace(b"tof:62", b"tof:" + sentinel)
    assert decode_state(state, "d", 0.0).tof_m is None


@pytest.mark.parametrize(
    ("state", "names"),
    [
        (EDU_STATE.replace(b"bat:83;", b""), "bat"),
        (EDU_STATE.replace(b"h:80", b"h:eighty"), "h"),
        (EDU_STATE.replace(b"yaw:21", b"yaw:nan"), "yaw"),
        (EDU_STATE.replace(b"vgx:2", b"vgx:inf"), "vgx"),
        (EDU_STATE[:60], "without"),
        (EDU_STATE.replace(b"mid", b"\xff\xfe"), "ASCII"),
        (b"", "without"),
        (b"ok", "without"),
    ],
)
def test_a_broken_state_report_names_what_is_wrong(state: bytes, names: str) -> None:
    with pytest.raises(ProtocolError, match=names):
        decode_state(state, "d", 0.0)


@given(st.data())
def test_damaged_state_reports_raise_nothing_but_protocol_errors(data: st.DataObject) -> None:
    state = bytearray(EDU_STATE)
    for _ in range(data.draw(st.integers(0, 6))):
        at = data.draw(st.integers(0, len(state) - 1))
        state[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=3))
        if not state:
            break
    try:
        telemetry = decode_state(bytes(state), "d", 0.0)
    except ProtocolError:
        return
    assert np.isfinite(telemetry.velocity_m_s).all()
    assert np.isfinite(telemetry.acceleration_m_s2).all()
    assert math.isfinite(telemetry.height_m)


@pytest.mark.parametrize("text", ["", "stop\n", "drön", "a\0b"])
def test_commands_are_printable_ascii(text: str) -> None:
    with pytest.raises(ProtocolError):
        encode_command(text)


def test_rc_is_written_as_the_guide_says() -> None:
    assert encode_rc((1, -2, 100, -100)) == b"rc 1 -2 100 -100"
    with pytest.raises(ProtocolError, match="outside"):
        encode_rc((0, 0, 101, 0))


# Stick inverse ------------------------------------------------------------------------------------


def sticks_for(
    forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0
) -> tuple[int, int, int, int]:
    return rc_from_setpoint(Setpoint(np.array([forward, left, up]), turn))


def test_each_axis_moves_its_own_stick_the_right_way() -> None:
    assert sticks_for() == (0, 0, 0, 0)
    # A stick of 50 was measured to give these speeds.
    assert sticks_for(forward=0.287) == (0, 50, 0, 0)
    assert sticks_for(left=0.362) == (-50, 0, 0, 0)
    assert sticks_for(up=0.178) == (0, 0, 50, 0)
    assert sticks_for(turn=math.radians(35.1)) == (0, 0, 0, -50)
    assert sticks_for(-0.287, -0.362, -0.178, -math.radians(35.1)) == (50, -50, -50, 50)


def test_small_speeds_jump_the_dead_zone_and_tiny_ones_are_still() -> None:
    for axis in ("forward", "left", "up", "turn"):
        sticks = [abs(sum(sticks_for(**{axis: speed}))) for speed in np.linspace(0.0, 0.1, 200)]
        moving = [stick for stick in sticks if stick]
        assert sticks[0] == 0
        assert min(moving) >= 10, "a stick inside the dead zone does nothing"


@given(
    axis=st.sampled_from(["forward", "left", "up", "turn"]),
    slow=st.floats(0.0, 3.0),
    more=st.floats(0.0, 3.0),
)
def test_a_faster_wish_never_gives_a_smaller_stick(axis: str, slow: float, more: float) -> None:
    sign = 1 if axis in ("forward", "up") else -1
    slow_stick = sign * sum(sticks_for(**{axis: slow}))
    fast_stick = sign * sum(sticks_for(**{axis: slow + more}))
    assert 0 <= slow_stick <= fast_stick <= 100
    assert sum(sticks_for(**{axis: -slow})) == -sign * slow_stick


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-5, 5), st.floats(-9, 9))
def test_sticks_are_always_in_range(forward: float, left: float, up: float, turn: float) -> None:
    sticks = sticks_for(forward, left, up, turn)
    assert all(-100 <= stick <= 100 for stick in sticks)
    assert encode_rc(sticks)


def test_a_horizontal_wish_beyond_the_sticks_keeps_its_direction() -> None:
    assert sticks_for(forward=6.1, left=-8.0) == (100, 100, 0, 0)
    assert sticks_for(forward=6.1, left=-4.0)[0] < 60


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_setpoint_that_is_not_finite_is_refused(bad: float) -> None:
    for axis in ("forward", "left", "up", "turn"):
        with pytest.raises(ProtocolError, match="finite"):
            sticks_for(**{axis: bad})


# Replies to commands ------------------------------------------------------------------------------


def test_a_reply_answers_the_outstanding_command() -> None:
    channel = CommandChannel()
    assert channel.begin("takeoff") == b"takeoff"
    assert channel.outstanding == "takeoff"
    with pytest.raises(ProtocolError, match="outstanding"):
        channel.begin("land")
    reply = channel.receive(b"ok", 1.0)
    assert reply is not None
    assert reply.kind == "ok"
    assert channel.outstanding is None


def test_a_late_reply_is_not_taken_for_the_next_command() -> None:
    channel = CommandChannel()
    channel.begin("streamon")
    epoch = channel.epoch
    channel.give_up(1.0, patience_s=2.0)
    assert channel.epoch > epoch
    channel.begin("takeoff")
    assert channel.receive(b"ok", 1.5) is None
    reply = channel.receive(b"error", 1.6)
    assert reply is not None
    assert reply.kind == "error"
    assert channel.discarded == 0


def test_a_late_reply_that_never_comes_is_forgotten() -> None:
    channel = CommandChannel()
    channel.begin("streamon")
    channel.give_up(1.0, patience_s=2.0)
    channel.begin("takeoff")
    assert channel.receive(b"ok", 3.1) is not None


def test_replies_of_stops_sent_past_the_channel_answer_nobody() -> None:
    channel = CommandChannel()
    channel.owe(1.0, 1.0, copies=3)
    channel.begin("command")
    assert [channel.receive(b"ok", 1.1) for _ in range(3)] == [None] * 3
    assert channel.receive(b"ok", 1.2) is not None


def test_a_stray_forced_stop_answers_nobody() -> None:
    channel = CommandChannel()
    channel.begin("takeoff")
    assert channel.receive(b"forced stop", 1.0) is None
    assert channel.outstanding == "takeoff"
    assert channel.receive(b"ok", 1.1) is not None


def test_binary_packets_are_counted_and_dropped() -> None:
    channel = CommandChannel()
    channel.begin("command")
    assert channel.receive(b"\xcc\x58\x00\x7c\x68\x54\x00", 1.0) is None
    assert channel.garbage == 1
    assert channel.outstanding == "command"


def test_an_unasked_reply_is_dropped() -> None:
    channel = CommandChannel()
    assert channel.receive(b"ok", 1.0) is None
    assert channel.discarded == 1


def is_answer(datagram: bytes) -> bool:
    try:
        return decode_reply(datagram).kind != "forced_stop"
    except ProtocolError:
        return False


@given(
    st.lists(
        st.one_of(
            st.sampled_from(["begin", "give_up", "owe"]),
            st.sampled_from([b"ok", b"forced stop", b"error", b"\xcc\x01"]),
            st.binary(max_size=6),
        ),
        max_size=40,
    )
)
def test_no_order_of_events_upsets_the_channel(events: list[str | bytes]) -> None:
    """A command is answered at most once, and never by a reply that is owed to another."""
    channel = CommandChannel()
    owed = 0
    for now_s, event in enumerate(events):
        if isinstance(event, bytes):
            was = channel.outstanding
            reply = channel.receive(event, float(now_s))
            if reply is not None:
                assert was is not None
                assert owed == 0
                assert channel.outstanding is None
            elif is_answer(event):
                owed = max(0, owed - 1)
        elif event == "begin":
            if channel.outstanding is None:
                channel.begin("command")
        elif event == "owe":
            channel.owe(float(now_s), 1e6)
            owed += 1
        else:
            owed += channel.outstanding is not None
            channel.give_up(float(now_s), 1e6)


# Labels -------------------------------------------------------------------------------------------


@given(st.integers(0, 99), st.integers(1, 99))
def test_a_label_survives_the_way_there_and_back(label: int, copy: int) -> None:
    datagram = encode_labelled(label, copy, "takeoff")
    assert datagram == f"Re{label:02d}{copy:02d} takeoff".encode()
    assert split_label(datagram) == (label, b"takeoff")


@pytest.mark.parametrize(("label", "copy"), [(-1, 1), (100, 1), (0, 0), (0, 100)])
def test_labels_out_of_range_are_refused(label: int, copy: int) -> None:
    with pytest.raises(ProtocolError, match="out of range"):
        encode_labelled(label, copy, "takeoff")


@given(st.binary(max_size=12))
def test_only_a_whole_head_is_a_label(datagram: bytes) -> None:
    label, body = split_label(datagram)
    if label is None:
        assert body == datagram
    else:
        assert datagram[:2] == b"Re"
        assert datagram[6:7] == b" "
        assert body == datagram[7:]


def test_a_labelled_reply_is_known_by_its_label_alone() -> None:
    channel = CommandChannel(first_label=7)
    channel.owe(0.0, 10.0, copies=3)
    copies = channel.begin_labelled("takeoff", 3)
    assert copies == (b"Re0701 takeoff", b"Re0702 takeoff", b"Re0703 takeoff")
    assert channel.receive(b"ok", 0.1) is None, "owed to somebody else"
    assert channel.receive(b"Re0601 ok", 0.2) is None, "an older one's"
    for _ in range(5):
        assert channel.receive(b"ok", 0.3) is None, "a plain one is not ours, owed or not"
    assert channel.labels_known
    reply = channel.receive(b"Re0702 ok", 0.4)
    assert reply is not None
    assert reply.kind == "ok"
    assert channel.receive(b"Re0703 ok", 0.5) is None
    assert channel.begin("battery?") == b"battery?"


def test_a_drone_that_does_not_know_labels_is_noticed() -> None:
    channel = CommandChannel(first_label=99)
    channel.begin_labelled("takeoff", 2)
    reply = channel.receive(b"unknown command: Re9901", 0.1)
    assert reply is not None
    assert reply.kind == "error"
    assert channel.labels_known is False
    channel.begin("takeoff")
    assert channel.receive(b"unknown command: Re9902", 0.2) is None, "the other copy's"
    reply = channel.receive(b"ok", 0.3)
    assert reply is not None
    assert channel.new_label() == 0, "labels begin anew after 99"


def test_a_labelled_command_given_up_is_owed_to_nobody() -> None:
    channel = CommandChannel()
    channel.begin_labelled("takeoff", 2)
    channel.give_up(0.0, 1.0)
    channel.begin("battery?")
    assert channel.receive(b"Re0001 ok", 0.1) is None
    reply = channel.receive(b"87", 0.2)
    assert reply is not None
    assert reply.text == "87"


# Reads --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("24s", "s", 24.0),
        ("24", "s", 24.0),
        ("87\r\n", "%", 87.0),
        ("100.0", "", 100.0),
        ("-102.865509", "", -102.865509),
        ("30", "", 30.0),
    ],
)
def test_numbers_are_read_with_and_without_their_unit(text: str, unit: str, value: float) -> None:
    assert read_number(text, unit) == value


@pytest.mark.parametrize("text", ["", "s", "24 m", "ok", "1e9", "0x1", "nan", "9" * 400, "24ss"])
def test_other_things_are_no_numbers_of_seconds(text: str) -> None:
    with pytest.raises(ProtocolError, match="not a number"):
        read_number(text, "s")


@pytest.mark.parametrize(
    ("text", "plain", "metres"),
    [("15dm", "cm", 1.5), ("150", "cm", 1.5), ("875mm", "mm", 0.875), ("87", "cm", 0.87)],
)
def test_lengths_are_read_in_both_formats(text: str, plain: str, metres: float) -> None:
    assert read_length_m(text, plain) == pytest.approx(metres)


def test_a_length_is_not_a_time() -> None:
    with pytest.raises(ProtocolError, match="not a length"):
        read_length_m("24s", "cm")


@pytest.mark.parametrize(
    ("text", "both"), [("85~88C", (85.0, 88.0)), ("86", (86.0, 86.0)), ("86C\r\n", (86.0, 86.0))]
)
def test_temperatures_are_read_in_both_formats(text: str, both: tuple[float, float]) -> None:
    assert read_temperature_c(text) == both


def test_named_numbers_are_read() -> None:
    assert read_fields("pitch:0;roll:-1;yaw:0;\r\n") == {"pitch": 0.0, "roll": -1.0, "yaw": 0.0}
    assert read_fields("agx:-5.00;agy:7.00;agz:-999.00;")["agz"] == -999.0
    for text in ("", "pitch:x;", "pitch", ":1;"):
        with pytest.raises(ProtocolError):
            read_fields(text)


@given(st.text(max_size=20))
def test_reads_of_anything_give_a_value_or_a_protocol_error(text: str) -> None:
    for read in (read_number, read_temperature_c, read_fields, read_serial):
        try:
            read(text)
        except ProtocolError:
            continue
