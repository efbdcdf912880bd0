"""What a client may set on a drone: speed, ports, the form of its pictures; pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from server.sim.words import UnknownCommandError, numbers, one_of

_FPS = {"high": 30.0, "middle": 15.0, "low": 5.0}
_HIGH_PX = (960, 720)
_LOW_PX = (640, 480)
_DOWN_PX = (320, 240)
_PORT = (1025.0, 65535.0)


@dataclass(slots=True)
class Settings:
    """Settings since power-on.

    Attributes:
        speed_cm_s: Speed of moves that name none, cm/s.
        streaming: True between ``streamon`` and ``streamoff``.
        key_picture_due: True until somebody has sent the key picture that ``streamon`` asks for.
        state_port: The client's port for state reports.
        video_port: The client's port for video.
        fps: Pictures per second.
        bitrate_kbit_s: Upper bound of the video rate, kbit/s; None: the drone's own choice.
        high_resolution: True for 720 lines, False for 480.
        looks_down: True while the grey downward camera sends instead of the one ahead.
        looks_for_pads: True while mission pads are looked for.
    """

    speed_cm_s: float = 100.0
    streaming: bool = False
    key_picture_due: bool = False
    state_port: int = 8890
    video_port: int = 11111
    fps: float = 30.0
    bitrate_kbit_s: int | None = None
    high_resolution: bool = True
    looks_down: bool = False
    looks_for_pads: bool = False

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        if self.looks_down:
            return _DOWN_PX
        return _HIGH_PX if self.high_resolution else _LOW_PX

    def set(self, word: str, arguments: Sequence[str]) -> str | None:
        """Carry out a command that sets something; return its reply, None if it is no such one.

        Raises:
            OutOfRangeError: If an argument is outside its range.
            UnknownCommandError: If the arguments are not those of the command.
        """
        match word:
            case "streamon" | "streamoff":
                numbers(arguments, ())
                self.streaming = self.key_picture_due = word == "streamon"
            case "speed":
                (self.speed_cm_s,) = numbers(arguments, ((10.0, 100.0),))
            case "port":
                state, video = numbers(arguments, (_PORT, _PORT))
                self.state_port, self.video_port = int(state), int(video)
            case "setfps":
                self.fps = _FPS[one_of(arguments, tuple(_FPS))]
            case "setbitrate":
                (mbit,) = numbers(arguments, ((0.0, 5.0),))
                if mbit != int(mbit):
                    raise UnknownCommandError
                self.bitrate_kbit_s = 1000 * int(mbit) or None
            case "setresolution":
                self.high_resolution = one_of(arguments, ("high", "low")) == "high"
            case "downvision":
                self.looks_down = one_of(arguments, ("0", "1")) == "1"
            case "mon" | "moff":
                numbers(arguments, ())
                self.looks_for_pads = word == "mon"
            case "mdirection":
                one_of(arguments, ("0", "1", "2"))
                if not self.looks_for_pads:
                    return "error"
            case "keepalive":
                numbers(arguments, ())
            case _:
                return None
        return "ok"
