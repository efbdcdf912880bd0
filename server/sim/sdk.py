r"""The drone's side of the text protocol (EDU, SDK 2.0): datagrams in, datagrams out; no I/O.

Motion commands are answered when they are finished, and not queued. ``rc`` is never answered.
Silent until ``command``. Heads of the vendor's loss-proof form (``Re`` + two label bytes + three
more, then the command) are carried over to the replies and copies are carried out once.

Flips, curves and mission pads are not simulated: ``flip``, ``curve``, ``jump`` and pad commands
answer ``error``.
"""

from __future__ import annotations

import math
import re
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from server.sim.dynamics import Airframe

Sender = tuple[str, int]
Outgoing = tuple[bytes, Sender]

AUTO_LAND_S = 15.0

_HEAD_BYTES = 7
_LABELS_KEPT = 32
_UNSIMULATED = frozenset({"flip", "curve", "jump", "mon", "moff", "mdirection"})
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")

# Word: (unit vector forward, left, up).
_MOVES = {
    "forward": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}


class _OutOfRangeError(Exception):
    """An argument is outside its documented range."""


class _UnknownCommandError(Exception):
    """Unknown word, wrong number of arguments or not a number."""


@dataclass(slots=True)
class _Running:
    """A motion command that waits for its end.

    Attributes:
        head: The loss-proof head its reply starts with.
        sender: Who gets the reply.
    """

    head: bytes
    sender: Sender


class TextSdk:
    """Answers one drone's commands and drives its airframe.

    Attributes:
        client: Address that owns state and video, None before the first ``command``.
        streaming: True between ``streamon`` and ``streamoff``.
        auto_landing: True while the drone lands because nobody spoke to it.
        key_picture_due: Set by ``streamon``; whoever encodes clears it.
    """

    def __init__(self, airframe: Airframe, serial: str) -> None:
        self.client: str | None = None
        self.streaming = False
        self.auto_landing = False
        self.key_picture_due = False
        self._airframe = airframe
        self._serial = serial
        self._running: _Running | None = None
        self._heard_s = 0.0
        self._speed_cm_s = 100.0
        self._labels: OrderedDict[bytes, bytes | None] = OrderedDict()

    # Datagrams -------------------------------------------------------------------------------

    def receive(self, datagram: bytes, sender: Sender, now_s: float) -> list[Outgoing]:
        """Take one datagram and return the replies due at once."""
        head = b""
        if datagram.startswith(b"Re"):
            head, datagram = datagram[:_HEAD_BYTES], datagram[_HEAD_BYTES:]
            label = head[2:4]
            if label in self._labels:
                known = self._labels[label]
                # A copy of a command that is still running is answered once, at its end.
                return [] if known is None else [(head + known, sender)]
            self._labels[label] = None
            if len(self._labels) > _LABELS_KEPT:
                self._labels.popitem(last=False)
        text = datagram.decode("ascii", "replace").strip("\0\r\n ")
        if self.client is None and text != "command":
            return []
        self._heard_s = now_s
        out: list[Outgoing] = []
        reply = self._carry_out(text, _Running(head, sender), out)
        if reply is not None:
            out.append(self._reply(_Running(head, sender), reply))
        return out

    def tick(self, now_s: float) -> list[Outgoing]:
        """Return the replies due after the airframe made a step; watches the 15 s of silence."""
        out: list[Outgoing] = []
        if self._airframe.finished:
            if self._running is not None:
                out.append(self._reply(self._running, "ok"))
                self._running = None
                # Its time under way does not count as silence.
                self._heard_s = now_s
            if self._airframe.phase == "standing":
                self.auto_landing = False
        idle = self._running is None and self._airframe.phase == "flying"
        low = self._airframe.battery_pct <= 5.0
        silent = now_s - self._heard_s > AUTO_LAND_S
        if idle and not self.auto_landing and (low or silent):
            self.auto_landing = True
            self._airframe.land()
        return out

    def _reply(self, running: _Running, text: str) -> Outgoing:
        body = text.encode("ascii", "replace")
        if running.head:
            self._labels[running.head[2:4]] = body
        return running.head + body, running.sender

    # Commands --------------------------------------------------------------------------------

    def _carry_out(self, text: str, asker: _Running, out: list[Outgoing]) -> str | None:
        """Carry out a command; return its reply, or None when there is none or none yet."""
        word, *arguments = text.split() or [""]
        try:
            if text.endswith("?"):
                return self._read(text[:-1])
            match word:
                case "rc":
                    self._steer(arguments)
                    return None
                case "stop" | "emergency":
                    return self._interrupt(word, out)
                case "command":
                    self.client = asker.sender[0]
                    return "ok"
                case "streamon" | "streamoff":
                    self.key_picture_due = word == "streamon"
                    self.streaming = word == "streamon"
                    return "ok"
                case "speed":
                    (self._speed_cm_s,) = _numbers(arguments, ((10.0, 100.0),))
                    return "ok"
            if word in _UNSIMULATED:
                return "error"
            return self._move(word, arguments, asker)
        except _OutOfRangeError:
            return "out of range"
        except _UnknownCommandError:
            return f"unknown command: {word}"

    def _steer(self, arguments: Sequence[str]) -> None:
        try:
            a, b, c, d = _numbers(arguments, ((-100.0, 100.0),) * 4)
        except (_OutOfRangeError, _UnknownCommandError):
            return  # ``rc`` never answers, not even nonsense.
        if not self.auto_landing:
            self._airframe.sticks = (a, b, c, d)

    def _interrupt(self, word: str, out: list[Outgoing]) -> str:
        if self._running is not None:
            out.append(self._reply(self._running, "forced stop"))
            self._running = None
        if word == "emergency":
            self._airframe.cut()
            self.auto_landing = False
        elif not self.auto_landing:
            self._airframe.stop()
        return "ok"

    def _move(self, word: str, arguments: Sequence[str], asker: _Running) -> str | None:
        order = self._order(word, arguments)
        airframe = self._airframe
        if self.auto_landing:
            return "error Auto land"
        if self._running is not None:
            return "error Not joystick"
        if word == "takeoff":
            if airframe.phase != "standing" or airframe.battery_pct < 10.0:
                return "error"
            if airframe.temperature_c >= 100.0:
                return "error, high temp"
        elif not airframe.motors_on:
            return "error" if word == "land" else "error Motor stop"
        order()
        self._running = asker
        return None

    def _order(self, word: str, arguments: Sequence[str]) -> Callable[[], None]:
        """Return what carries out a motion command, after checking its arguments."""
        airframe = self._airframe
        if word == "takeoff":
            _numbers(arguments, ())
            return airframe.take_off
        if word == "land":
            _numbers(arguments, ())
            return airframe.land
        if word in _MOVES:
            (distance_cm,) = _numbers(arguments, ((20.0, 500.0),))
            x, y, z = (distance_cm / 100.0 * unit for unit in _MOVES[word])
            speed_m_s = self._speed_cm_s / 100.0
            return lambda: airframe.fly(x, y, z, speed_m_s)
        if word in ("cw", "ccw"):
            # Real drones do not check this range.
            (angle_deg,) = _numbers(arguments, ((-1e6, 1e6),))
            left_rad = math.radians(angle_deg if word == "ccw" else -angle_deg)
            return lambda: airframe.turn(left_rad)
        if word == "go":
            ranges = ((-500.0, 500.0),) * 3 + ((10.0, 100.0),)
            x, y, z, speed = _numbers(arguments, ranges)
            if max(abs(x), abs(y), abs(z)) <= 20.0:
                raise _OutOfRangeError
            return lambda: airframe.fly(x / 100, y / 100, z / 100, speed / 100)
        raise _UnknownCommandError

    # Reads -----------------------------------------------------------------------------------

    def _read(self, name: str) -> str:
        readings = self._airframe.readings()
        match name:
            case "battery":
                body = f"{readings['bat']:.0f}"
            case "speed":
                body = f"{self._speed_cm_s:.1f}"
            case "time":
                body = f"{readings['time']:.0f}s"
            case "wifi":
                body = "90"
            case "sdk":
                body = "20"
            case "sn":
                body = self._serial
            case "height":
                body = f"{readings['h'] / 10:.0f}dm"
            case "temp":
                body = f"{readings['templ']:.0f}~{readings['temph']:.0f}C"
            case "attitude":
                body = "pitch:{pitch:.0f};roll:{roll:.0f};yaw:{yaw:.0f};".format(**readings)
            case "acceleration":
                body = "agx:{agx:.2f};agy:{agy:.2f};agz:{agz:.2f};".format(**readings)
            case "baro":
                body = f"{readings['baro']:.6f}"
            case "tof":
                body = f"{10 * readings['tof']:.0f}mm"
            case _:
                return f"unknown command: {name}?"
        return body + "\r\n"


def state_line(airframe: Airframe) -> bytes:
    """Return the state report of an EDU drone with mission pad detection off."""
    text = "mid:-1;x:0;y:0;z:0;mpry:0,0,0;"
    for name, value in airframe.readings().items():
        text += (
            f"{name}:{value:.2f};"
            if name in ("baro", "agx", "agy", "agz")
            else (f"{name}:{value:.0f};")
        )
    return text.encode("ascii") + b"\r\n"


def _numbers(arguments: Sequence[str], ranges: Sequence[tuple[float, float]]) -> list[float]:
    if len(arguments) != len(ranges) or not all(map(_NUMBER.fullmatch, arguments)):
        raise _UnknownCommandError
    numbers = [float(argument) for argument in arguments]
    for number, (low, high) in zip(numbers, ranges, strict=True):
        if not low <= number <= high:
            raise _OutOfRangeError
    return numbers
