"""The drone's side of the text protocol (SDK 1.3, 2.0, 3.0): datagrams in and out; no I/O.

Motion commands are answered when they are finished, and not queued. ``rc`` is never answered.
Silent until ``command``. Nobody throws the drone after ``throwfly``, no mission pads lie on its
floor and it has no expansion board.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from server.sim.copies import Copies, split_head
from server.sim.dynamics import Airframe
from server.sim.orders import RefusedError, order_of
from server.sim.reads import read_reply, state_line
from server.sim.settings import Settings
from server.sim.words import (
    OutOfRangeError,
    SdkLevel,
    UnknownCommandError,
    numbers,
    reads_of,
    words_of,
)

Sender = tuple[str, int]
Outgoing = tuple[bytes, Sender]

AUTO_LAND_S = 15.0

_NETWORK_REBOOT_S = 3.0
_TAKE_OFF_BATTERY_PCT = 10.0
_TAKE_OFF_HOTTEST_C = 100.0
_EMPTY_PCT = 5.0
_THROW_S = 5.0
_BOARD_WORDS = frozenset({"led", "mled", "tof?", "version?"})
_STICK = (-100.0, 100.0)


@dataclass(slots=True)
class _Asker:
    """Whom a command's reply goes to.

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
        settings: Ports, picture form and what else a client may set.
        auto_landing: True while the drone lands because nobody spoke to it.
        restart_at_s: When the drone restarts because it was told to, None: it does not.
        station: True when it is to join a network after the restart.
    """

    def __init__(
        self,
        airframe: Airframe,
        serial: str,
        level: SdkLevel = "3.0",
        *,
        friendly_reads: bool = False,
        station: bool = False,
    ) -> None:
        """Power the protocol side on.

        Args:
            airframe: The body it drives.
            serial: Its serial number, 14 characters.
            level: The SDK it speaks.
            friendly_reads: True to answer reads with plain whole numbers.
            station: True in a network of others; SDK 2.0 then sends no video.
        """
        self.client: str | None = None
        self.settings = Settings()
        self.auto_landing = False
        self.restart_at_s: float | None = None
        self.station = station
        self._airframe = airframe
        self._serial = serial
        self._level: SdkLevel = level
        self._friendly = friendly_reads
        self._blind = station and level == "2.0"
        self._words, self._reads = words_of(level), reads_of(level)
        self._copies = Copies()
        self._running: _Asker | None = None
        self._now_s = 0.0
        self._heard_s = 0.0
        self._owner_heard_s = 0.0
        self._throw_until_s: float | None = None

    @property
    def streaming(self) -> bool:
        """True while video is switched on and can be had."""
        return self.settings.streaming and not self._blind

    @property
    def key_picture_due(self) -> bool:
        """Set by ``streamon``; whoever encodes clears it."""
        return self.settings.key_picture_due

    @key_picture_due.setter
    def key_picture_due(self, due: bool) -> None:
        self.settings.key_picture_due = due

    # Datagrams -------------------------------------------------------------------------------

    def receive(self, datagram: bytes, sender: Sender, now_s: float) -> list[Outgoing]:
        """Take one datagram and return the replies due at once."""
        self._now_s = now_s
        # Consumer drones take the loss-proof head for an unknown word.
        head, command = (b"", datagram) if self._level == "1.3" else split_head(datagram)
        text = command.decode("ascii", "replace").strip("\0\r\n ")
        if self.client is None and text != "command":
            return []
        if head:
            answers = self._copies.take(head, now_s)
            if answers is not None:
                return [(answer, sender) for answer in answers]
        self._heard_s = now_s
        if sender[0] == self.client:
            self._owner_heard_s = now_s
        out: list[Outgoing] = []
        asker = _Asker(head, sender)
        reply = self._carry_out(text, asker, out)
        if reply is not None:
            out += self._reply(asker, reply)
        return out

    def tick(self, now_s: float) -> list[Outgoing]:
        """Return the replies due after the airframe made a step; watches the 15 s of silence."""
        airframe = self._airframe
        out: list[Outgoing] = []
        self._now_s = now_s
        if airframe.finished:
            if self._running is not None:
                out += self._reply(self._running, "ok")
                self._running = None
                # Its time under way does not count as silence.
                self._heard_s = now_s
            if airframe.phase == "standing":
                self.auto_landing = False
        if self._throw_until_s is not None and now_s >= self._throw_until_s:
            self._throw_until_s = None
            airframe.spinning = False
        if self._running is None and airframe.phase == "flying" and not self.auto_landing:
            low = airframe.battery_pct <= _EMPTY_PCT
            if low or now_s - self._heard_s > AUTO_LAND_S:
                self.auto_landing = True
                airframe.land()
        return out

    def state(self) -> bytes:
        """Return the state report."""
        return state_line(self._airframe, self._level, self.settings.looks_for_pads)

    def _reply(self, asker: _Asker, text: str) -> list[Outgoing]:
        body = text.encode("ascii", "replace")
        if not asker.head:
            return [(body, asker.sender)]
        answers = self._copies.answer(asker.head, body, self._now_s)
        return [(answer, asker.sender) for answer in answers]

    # Commands --------------------------------------------------------------------------------

    def _carry_out(self, text: str, asker: _Asker, out: list[Outgoing]) -> str | None:
        """Carry out a command; return its reply, or None when there is none or none yet."""
        word, *arguments = text.split() or [""]
        try:
            if text.endswith("?") and not arguments:
                return self._read(text[:-1])
            if word not in self._words:
                raise UnknownCommandError
            match word:
                case "rc":
                    self._steer(arguments)
                    return None
                case "stop" | "emergency":
                    return self._interrupt(word, out)
                case "command":
                    return self._enter(asker.sender[0])
                case "motoron" | "motoroff" | "throwfly":
                    return self._idle(word, arguments)
                case "wifi" | "ap" | "reboot":
                    return self._restart(word, arguments)
                case "EXT":
                    return _without_board(arguments)
            reply = self.settings.set(word, arguments)
            return self._move(word, arguments, asker) if reply is None else reply
        except OutOfRangeError:
            return "out of range"
        except UnknownCommandError:
            return f"unknown command: {word[:40]}"

    def _read(self, name: str) -> str:
        if name not in self._reads:
            return f"unknown command: {name[:40]}?"
        return read_reply(
            name,
            self._airframe,
            speed_cm_s=self.settings.speed_cm_s,
            serial=self._serial,
            level=self._level,
            friendly=self._friendly,
        )

    def _enter(self, address: str) -> str:
        # Everybody gets an answer, but state and video stay with the first until it falls silent.
        if self.client is None or self._now_s - self._owner_heard_s > AUTO_LAND_S:
            self.client = address
            self._owner_heard_s = self._now_s
        return "ok"

    def _steer(self, arguments: Sequence[str]) -> None:
        try:
            a, b, c, d = numbers(arguments, (_STICK,) * 4)
        except (OutOfRangeError, UnknownCommandError):
            return  # ``rc`` never answers, not even nonsense.
        if not self.auto_landing:
            self._airframe.sticks = (a, b, c, d)

    def _interrupt(self, word: str, out: list[Outgoing]) -> str:
        if self._running is not None:
            out += self._reply(self._running, "forced stop")
            self._running = None
        if word == "emergency":
            self._airframe.cut()
            self.auto_landing = False
        elif not self.auto_landing:
            self._airframe.stop()
        return "ok"

    def _idle(self, word: str, arguments: Sequence[str]) -> str:
        numbers(arguments, ())
        airframe = self._airframe
        on = word != "motoroff"
        if airframe.phase != "standing" or self._running is not None or airframe.spinning == on:
            return "error"
        airframe.spinning = on
        self._throw_until_s = self._now_s + _THROW_S if word == "throwfly" else None
        return "ok"

    def _restart(self, word: str, arguments: Sequence[str]) -> str | None:
        if len(arguments) != (0 if word == "reboot" else 2):
            raise UnknownCommandError
        if word == "reboot":
            self.restart_at_s = self._now_s
            return None
        self.station = word == "ap"
        self.restart_at_s = self._now_s + _NETWORK_REBOOT_S
        return "OK,drone will reboot in 3s\0"

    def _move(self, word: str, arguments: Sequence[str], asker: _Asker) -> str | None:
        airframe = self._airframe
        order = order_of(word, arguments, airframe, self.settings.speed_cm_s, self._level)
        if self.auto_landing:
            return "error Auto land"
        if self._running is not None:
            return "error Not joystick"
        if word == "takeoff":
            if airframe.phase != "standing" or airframe.battery_pct < _TAKE_OFF_BATTERY_PCT:
                return "error"
            if airframe.temperature_c >= _TAKE_OFF_HOTTEST_C:
                return "error, high temp"
        elif not airframe.motors_on:
            return "error" if word == "land" else "error Motor stop"
        elif word != "land" and not airframe.sees_floor:
            return "error No valid imu"
        try:
            order()
        except RefusedError as refusal:
            return str(refusal)
        self._running = asker
        return None


def _without_board(arguments: Sequence[str]) -> str:
    """Return what a drone without the expansion board answers to a command for it."""
    if arguments and arguments[0] in _BOARD_WORDS:
        return f"unknow command: {arguments[0]}"
    return "command error: 254"
