"""The Tello's text protocol: bytes and times in, values and bytes out; no I/O, no clock.

This is the only module that knows the drone's units (cm, dm/s, degrees, milli-g) and its three
sign conventions:

* ``rc a b c d``: a right+, b forward+, c up+, d clockwise+, each a stick position of -100..100;
* state: body FRD (forward, right, down), yaw clockwise+, pitch nose-up+, roll right-side-down+;
* ours: body FLU, metres, radians, yaw counter-clockwise+.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Literal

import numpy as np

from server.stages import Setpoint, Telemetry

STANDARD_GRAVITY_M_S2 = 9.80665

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


class CommandChannel:
    """Matches replies to commands: at most one command is outstanding.

    Replies carry no identity. Every command therefore has an epoch, and the channel keeps count of
    replies that are still owed to nobody: those of commands given up (they may come late) and of
    datagrams sent past the channel (stops and repeats). While such a reply is owed, the next one
    to arrive is taken for it and dropped. The price is that a command may time out although it was
    answered; that is harmless, a wrong ``ok`` is not.

    Attributes:
        epoch: Counts commands; a result belongs to a command only when the epoch still agrees.
        discarded: Replies dropped as late, stray or unasked.
        garbage: Datagrams that were no reply at all.
    """

    def __init__(self) -> None:
        self.epoch = 0
        self.discarded = 0
        self.garbage = 0
        self._outstanding: str | None = None
        self._owed_until_s: deque[float] = deque()

    @property
    def outstanding(self) -> str | None:
        """The command that waits for its reply."""
        return self._outstanding

    def begin(self, text: str) -> bytes:
        """Make ``text`` the outstanding command and return its datagram.

        Raises:
            ProtocolError: If another command is outstanding or ``text`` cannot be sent.
        """
        if self._outstanding is not None:
            raise ProtocolError(f"{text!r} while {self._outstanding!r} is outstanding")
        datagram = encode_command(text)
        self._outstanding = text
        self.epoch += 1
        return datagram

    def owe(self, now_s: float, patience_s: float, copies: int = 1) -> None:
        """Note that ``copies`` replies may come until ``now_s + patience_s`` that answer nobody."""
        self._owed_until_s.extend([now_s + patience_s] * copies)

    def give_up(self, now_s: float, patience_s: float) -> None:
        """End the wait for the outstanding command; its reply, if it still comes, is dropped."""
        if self._outstanding is not None:
            self._outstanding = None
            self.epoch += 1
            self.owe(now_s, patience_s)

    def receive(self, datagram: bytes, now_s: float) -> Reply | None:
        """Return the reply when it answers the outstanding command, else None."""
        try:
            reply = decode_reply(datagram)
        except ProtocolError:
            self.garbage += 1
            return None
        self._owed_until_s = deque(until for until in self._owed_until_s if until > now_s)
        if reply.kind == "forced_stop":
            self.discarded += 1
            return None
        if self._owed_until_s:
            self._owed_until_s.popleft()
            self.discarded += 1
            return None
        if self._outstanding is None:
            self.discarded += 1
            return None
        self._outstanding = None
        return reply
