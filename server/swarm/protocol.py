"""The Tello's text protocol: bytes and times in, values and bytes out; no I/O, no clock.

This is the only module that knows the drone's units (cm, dm/s, degrees, milli-g) and its three
sign conventions:

* ``rc a b c d``: a right+, b forward+, c up+, d clockwise+, each a stick position of -100..100;
* state: body FRD (forward, right, down), yaw clockwise+, pitch nose-up+, roll right-side-down+;
* ours: body FLU, metres, radians, yaw counter-clockwise+.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from server.stages import Setpoint, Telemetry

STANDARD_GRAVITY_M_S2 = 9.80665

# Loss-proof commands carry one of this many labels, in a head of this many bytes.
LABELS = 100
_HEAD_BYTES = 7

# The range finder reports these when it measured nothing (too near, too far).
_TOF_SENTINELS_CM = (10, 6553)

# Stick positions and the steady speeds they give: a rig calibration of a real drone (1 m runs,
# three repeats), linear beyond its last point as its author extrapolates. Below _STICK_DEAD the
# drone does not move at all.
_STICK_DEAD = 10.0
_STICK = np.array([_STICK_DEAD, 20.0, 30.0, 40.0, 50.0, 70.0, 100.0])
_FORWARD_M_S = np.array([0.0, 0.069, 0.128, 0.192, 0.287, 0.41, 0.61])
_RIGHT_M_S = np.array([0.0, 0.099, 0.174, 0.258, 0.362, 0.53, 0.80])
_UP_M_S = np.array([0.0, 0.042, 0.082, 0.124, 0.178, 0.26, 0.40])
_TURN_RAD_S = np.deg2rad([0.0, 9.1, 16.9, 25.7, 35.1, 53.8, 88.6])

# Speeds below these become stick 0: jumping the dead zone to and fro would only shake the drone.
_STILL_M_S = 0.004
_STILL_RAD_S = math.radians(0.4)

# What refusals begin with, the misspellings of several firmwares included.
_FAILURES = (
    "error",
    "out of range",
    "unknown command",
    "unknow command",
    "unkown command",
    "command error",
    "unactive",
)

ReplyKind = Literal["ok", "error", "value", "forced_stop"]


class ProtocolError(ValueError):
    """A datagram is not what the protocol allows; the text says what is wrong."""


@dataclass(frozen=True, slots=True)
class Reply:
    """One reply of a drone.

    Attributes:
        kind: ``ok``; ``error`` (with ``out of range``, ``unknown command`` and the like);
            ``forced_stop`` (a manoeuvre was interrupted, also arrives unasked); else ``value``.
        text: The reply without line ends and trailing NULs.
    """

    kind: ReplyKind
    text: str


def encode_command(text: str) -> bytes:
    """Return the datagram of a command.

    Raises:
        ProtocolError: If ``text`` is empty or not printable ASCII.
    """
    if not text or not text.isascii() or not text.isprintable():
        raise ProtocolError(f"a command must be printable ASCII, not {text!r}")
    return text.encode("ascii")


def encode_labelled(label: int, copy: int, text: str) -> bytes:
    """Return a command in the EDU's loss-proof form, ``ReNNkk command``.

    The drone carries out the first copy of a label that reaches it and answers the others with the
    same reply. The form is the vendor's own programs'; the guides do not tell of it.

    Args:
        label: NN, 0-99; commands in flight or just past must have different ones.
        copy: kk, 1-99.
        text: The command.

    Raises:
        ProtocolError: If a number is out of range or ``text`` cannot be sent.
    """
    if not 0 <= label < LABELS or not 1 <= copy <= 99:
        raise ProtocolError(f"label {label} or copy {copy} is out of range")
    return b"Re%02d%02d %s" % (label, copy, encode_command(text))


def split_label(datagram: bytes) -> tuple[int | None, bytes]:
    """Return label and body of a reply; the label is None when it carries none."""
    head = datagram[:_HEAD_BYTES]
    if len(head) == _HEAD_BYTES and head.startswith(b"Re") and head.endswith(b" "):
        digits = head[2:6]
        if digits.isdigit():
            return int(digits[:2]), datagram[_HEAD_BYTES:]
    return None, datagram


def encode_rc(sticks: tuple[int, int, int, int]) -> bytes:
    """Return the datagram for stick positions (right, forward, up, clockwise), each -100..100.

    Raises:
        ProtocolError: If a stick is outside its range.
    """
    if any(not -100 <= stick <= 100 for stick in sticks):
        raise ProtocolError(f"a stick lies outside -100..100: {sticks}")
    return b"rc %d %d %d %d" % sticks


def decode_reply(datagram: bytes) -> Reply:
    """Read a datagram that came from the command port.

    Raises:
        ProtocolError: If it is empty or holds anything but printable ASCII, such as packets of
            the drone's other, binary protocol.
    """
    body = datagram.rstrip(b"\0\r\n ")
    if not body:
        raise ProtocolError("empty reply")
    if any(not 0x20 <= byte < 0x7F for byte in body):
        raise ProtocolError("reply with non-printable bytes")
    text = body.decode("ascii")
    folded = text.lower()
    if folded == "forced stop":
        return Reply("forced_stop", text)
    # "OK,drone will reboot in 3s" is an ok, too.
    if folded == "ok" or folded.startswith("ok,") or folded.endswith(" ok"):
        return Reply("ok", text)
    if folded.startswith(_FAILURES):
        return Reply("error", text)
    return Reply("value", text)


def decode_state(datagram: bytes, drone_id: str, received_s: float) -> Telemetry:
    r"""Read a state report.

    Args:
        datagram: ``pitch:0;roll:0;...;\r\n`` with or without the mission pad fields.
        drone_id: Whose it is.
        received_s: When it arrived.

    Raises:
        ProtocolError: If a field is missing or not a finite number.
    """
    try:
        text = datagram.decode("ascii")
    except UnicodeDecodeError:
        raise ProtocolError("state report with non-ASCII bytes") from None
    pairs: dict[str, str] = {}
    for item in text.strip("\0\r\n ").split(";"):
        name, colon, value = item.partition(":")
        if colon:
            pairs[name.strip()] = value

    def number(name: str) -> float:
        try:
            value = float(pairs[name])
        except KeyError:
            raise ProtocolError(f"state report without {name}") from None
        except ValueError:
            raise ProtocolError(f"state report with {name}:{pairs[name]!r}") from None
        if not math.isfinite(value):
            raise ProtocolError(f"state report with {name}:{pairs[name]!r}")
        return value

    milli_g = STANDARD_GRAVITY_M_S2 / 1000.0
    tof_cm = number("tof")
    return Telemetry(
        drone_id=drone_id,
        received_s=received_s,
        yaw_rad=-math.radians(number("yaw")),
        pitch_rad=math.radians(number("pitch")),
        roll_rad=math.radians(number("roll")),
        velocity_m_s=np.array([number("vgx"), -number("vgy"), -number("vgz")]) / 10.0,
        # Documented as cm/s^2, but at rest z reads about -1000: it is milli-g, FRD.
        acceleration_m_s2=np.array([number("agx"), -number("agy"), -number("agz")]) * milli_g,
        height_m=number("h") / 100.0,
        tof_m=None if tof_cm in _TOF_SENTINELS_CM else tof_cm / 100.0,
        baro_m=number("baro"),
        battery_pct=round(number("bat")),
        temperature_c=number("temph"),
        motor_time_s=number("time"),
    )


def rc_from_setpoint(setpoint: Setpoint) -> tuple[int, int, int, int]:
    """Return the stick positions (right, forward, up, clockwise) that give a setpoint's speeds.

    Inverts the measured stick curve piecewise linearly, dead zone included. A horizontal velocity
    beyond what the sticks can give is scaled down as a whole, so that its direction stays.

    Raises:
        ProtocolError: If the setpoint is not finite.
    """
    forward, left, up = (float(v) for v in setpoint.velocity_m_s)
    turn = float(setpoint.yaw_rate_rad_s)
    if not all(math.isfinite(v) for v in (forward, left, up, turn)):
        raise ProtocolError(f"setpoint is not finite: {forward}, {left}, {up}, {turn}")
    excess = max(abs(forward) / _FORWARD_M_S[-1], abs(left) / _RIGHT_M_S[-1], 1.0)
    return (
        _stick(-left / excess, _RIGHT_M_S, _STILL_M_S),
        _stick(forward / excess, _FORWARD_M_S, _STILL_M_S),
        _stick(up, _UP_M_S, _STILL_M_S),
        _stick(-turn, _TURN_RAD_S, _STILL_RAD_S),
    )


def _stick(speed: float, curve: np.ndarray, still: float) -> int:
    if abs(speed) < still:
        return 0
    return int(math.copysign(round(float(np.interp(abs(speed), curve, _STICK))), speed))


# Answers to reads --------------------------------------------------------------------------------

# A number and the unit that most firmwares append to it.
_READ = re.compile(r"([+-]?\d{1,9}(?:\.\d{1,9})?)\s*(s|dm|cm|mm|m|C|%)?", re.IGNORECASE)
_METRES = {"dm": 0.1, "cm": 0.01, "mm": 0.001, "m": 1.0}


def read_number(text: str, unit: str = "") -> float:
    """Read ``87``, ``24s``, ``100.0``: a number that may carry ``unit``.

    Raises:
        ProtocolError: If it is no number or has another unit.
    """
    match = _READ.fullmatch(text.strip())
    if match is None or (match[2] or unit).lower() != unit.lower():
        raise ProtocolError(f"not a number{f' in {unit}' if unit else ''}: {text!r}")
    return float(match[1])


def read_length_m(text: str, plain: str) -> float:
    """Read a length, ``15dm``, ``875mm`` or a bare number in the unit ``plain``; metres.

    Raises:
        ProtocolError: If it is no length.
    """
    match = _READ.fullmatch(text.strip())
    metres = None if match is None else _METRES.get((match[2] or plain).lower())
    if match is None or metres is None:
        raise ProtocolError(f"not a length: {text!r}")
    return float(match[1]) * metres


def read_temperature_c(text: str) -> tuple[float, float]:
    """Read ``85~88C`` or ``86``: the lowest and highest temperature, degrees Celsius.

    Raises:
        ProtocolError: If it is neither.
    """
    low, tilde, high = text.strip().partition("~")
    highest = read_number(high if tilde else low, "C")
    return (read_number(low, "C") if tilde else highest), highest


def read_fields(text: str) -> dict[str, float]:
    """Read ``pitch:0;roll:-1;yaw:0;`` and the like, in the drone's own units and axes.

    Raises:
        ProtocolError: If it holds anything but named numbers, or none.
    """
    values: dict[str, float] = {}
    for item in text.strip().strip(";").split(";"):
        name, colon, value = item.partition(":")
        if not colon or not name.strip():
            raise ProtocolError(f"not a list of named numbers: {text!r}")
        values[name.strip()] = read_number(value)
    return values


def read_serial(text: str) -> str:
    """Read a serial number.

    Raises:
        ProtocolError: If it is not 10-20 capital letters and digits.
    """
    serial = text.strip()
    if not re.fullmatch(r"[0-9A-Z]{10,20}", serial):
        raise ProtocolError(f"not a serial number: {text!r}")
    return serial
