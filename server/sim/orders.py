"""Motion commands: from their words to what the airframe is to do; pure.

Arguments are centimetres, degrees and centimetres per second; ``go`` and ``curve`` count forward,
left and up as positive. Decimals are accepted and the range of turns is not checked, as on real
drones.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

from server.sim.dynamics import Airframe
from server.sim.manoeuvres import RadiusError
from server.sim.words import OutOfRangeError, SdkLevel, UnknownCommandError, numbers, one_of

# Word: (unit vector forward, left, up).
_MOVES = {
    "forward": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "down": (0.0, 0.0, -1.0),
}
_DISTANCE = (20.0, 500.0)
_OFFSET = (-500.0, 500.0)
_GO_SPEED = (10.0, 100.0)
_CURVE_SPEED = (10.0, 60.0)
_TURN = (-1e6, 1e6)
_TOO_NEAR_CM = 20.0
_FLIP_BATTERY_PCT = 50.0
_PADS = {"2.0": re.compile(r"m[1-8]"), "3.0": re.compile(r"m([1-8]|-[12])")}


class RefusedError(Exception):
    """The drone does not do it; the text is its reply."""


def order_of(
    word: str, arguments: Sequence[str], airframe: Airframe, speed_cm_s: float, level: SdkLevel
) -> Callable[[], None]:
    """Return what carries out a motion command, after checking its arguments.

    Args:
        word: The command's first word.
        arguments: Its other words.
        airframe: What is to move.
        speed_cm_s: Speed of moves that name none.
        level: What the drone knows of mission pads.

    Raises:
        OutOfRangeError: If an argument is outside its range.
        RefusedError: If the drone cannot do it whatever the state of its motors.
        UnknownCommandError: If it is no motion command.
    """
    if word in ("takeoff", "land"):
        numbers(arguments, ())
        return airframe.take_off if word == "takeoff" else airframe.land
    if word in _MOVES:
        (distance_cm,) = numbers(arguments, (_DISTANCE,))
        x, y, z = (distance_cm / 100.0 * unit for unit in _MOVES[word])
        return lambda: airframe.fly(x, y, z, speed_cm_s / 100.0)
    if word in ("cw", "ccw"):
        (angle_deg,) = numbers(arguments, (_TURN,))
        left_rad = math.radians(angle_deg if word == "ccw" else -angle_deg)
        return lambda: airframe.turn(left_rad)
    if word == "flip":
        direction = one_of(arguments, "lrfb")
        return lambda: _flip(airframe, direction)
    if word == "go":
        return _go(arguments, airframe, level)
    if word == "curve":
        return _curve(arguments, airframe, level)
    if word == "jump":
        _check_pads(arguments[-2:], level)
        ranges = ((_OFFSET),) * 3 + (_GO_SPEED, (-360.0, 360.0))
        numbers(arguments[:-2], ranges)
        return _find_no_pad
    raise UnknownCommandError


def _flip(airframe: Airframe, direction: str) -> None:
    if airframe.battery_pct < _FLIP_BATTERY_PCT:
        raise RefusedError("error")
    airframe.flip(direction)


def _go(arguments: Sequence[str], airframe: Airframe, level: SdkLevel) -> Callable[[], None]:
    to_pad = len(arguments) == 5
    if to_pad:
        _check_pads(arguments[4:], level)
    x, y, z, speed = numbers(arguments[:4], (_OFFSET,) * 3 + (_GO_SPEED,))
    if to_pad:
        return _find_no_pad
    if len(arguments) > 4:
        raise UnknownCommandError
    _check_far((x, y, z))
    return lambda: airframe.fly(x / 100, y / 100, z / 100, speed / 100)


def _curve(arguments: Sequence[str], airframe: Airframe, level: SdkLevel) -> Callable[[], None]:
    to_pad = len(arguments) == 8
    if to_pad:
        _check_pads(arguments[7:], level)
    elif len(arguments) > 7:
        raise UnknownCommandError
    x1, y1, z1, x2, y2, z2, speed = numbers(arguments[:7], (_OFFSET,) * 6 + (_CURVE_SPEED,))
    _check_far((x1, y1, z1))
    _check_far((x2, y2, z2))
    if to_pad:
        return _find_no_pad
    via, end = (x1 / 100, y1 / 100, z1 / 100), (x2 / 100, y2 / 100, z2 / 100)

    def fly_arc() -> None:
        try:
            airframe.fly_arc(via, end, speed / 100)
        except RadiusError as error:
            raise RefusedError("error Radius is too large!") from error

    return fly_arc


def _check_far(offset_cm: Sequence[float]) -> None:
    if max(map(abs, offset_cm)) <= _TOO_NEAR_CM:
        raise OutOfRangeError


def _check_pads(pads: Sequence[str], level: SdkLevel) -> None:
    form = _PADS.get(level)
    if form is None or not pads or not all(map(form.fullmatch, pads)):
        raise UnknownCommandError


def _find_no_pad() -> None:
    # No mission pads lie on the simulated floor.
    raise RefusedError("error No valid marker")
