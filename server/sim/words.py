"""The words of the text protocol, by SDK level, and their arguments; pure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

SdkLevel = Literal["1.3", "2.0", "3.0"]
LEVELS: tuple[SdkLevel, ...] = get_args(SdkLevel)

Range = tuple[float, float]

# The level that brought each word; reads without their question mark are listed apart.
_SINCE: Mapping[SdkLevel, str] = {
    "1.3": "command takeoff land streamon streamoff emergency rc speed wifi flip go curve"
    " up down left right forward back cw ccw",
    "2.0": "stop jump mon moff mdirection ap",
    "3.0": "motoron motoroff throwfly port setfps setbitrate setresolution reboot downvision"
    " keepalive EXT",
}
_READS_SINCE: Mapping[SdkLevel, str] = {
    "1.3": "battery speed time wifi height temp attitude baro acceleration tof",
    "2.0": "sdk sn",
    "3.0": "hardware active",
}

_NUMBER = re.compile(r"[+-]?\d{1,9}(\.\d{1,9})?")


class OutOfRangeError(ValueError):
    """An argument is outside its documented range."""


class UnknownCommandError(ValueError):
    """Unknown word, wrong number of arguments or not a number."""


def words_of(level: SdkLevel) -> frozenset[str]:
    """Return the command words that drones of this level know."""
    return _known(_SINCE, level)


def reads_of(level: SdkLevel) -> frozenset[str]:
    """Return the reads that drones of this level know, without their question marks."""
    return _known(_READS_SINCE, level)


def numbers(arguments: Sequence[str], ranges: Sequence[Range]) -> list[float]:
    """Return the arguments as numbers.

    Raises:
        UnknownCommandError: If there are too few, too many or one is no number.
        OutOfRangeError: If one is outside its range, ends included.
    """
    if len(arguments) != len(ranges) or not all(map(_NUMBER.fullmatch, arguments)):
        raise UnknownCommandError
    values = [float(argument) for argument in arguments]
    for value, (low, high) in zip(values, ranges, strict=True):
        if not low <= value <= high:
            raise OutOfRangeError
    return values


def one_of(arguments: Sequence[str], choices: Sequence[str]) -> str:
    """Return the only argument, which must be one of the choices.

    Raises:
        UnknownCommandError: If it is not.
    """
    if len(arguments) != 1 or arguments[0] not in choices:
        raise UnknownCommandError
    return arguments[0]


def _known(since: Mapping[SdkLevel, str], level: SdkLevel) -> frozenset[str]:
    known = LEVELS[: LEVELS.index(level) + 1]
    return frozenset(word for earlier in known for word in since[earlier].split())
