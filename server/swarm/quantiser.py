"""Tells by its quantisers that a decoded picture is made of rubbish; no I/O, no clock.

What follows a gap inside a picture may happen to decode, and then nothing complains. But its
quantiser wanders: every macroblock may change it, encoders change it a little from one to the next,
and rubbish changes it at random. The decoder tells the quantiser of each block of each picture
(FFmpeg's ``AVVideoEncParams``, whose layout is read here).
"""

from __future__ import annotations

import struct
from collections import deque

import numpy as np

# A picture is rubbish when its largest change exceeds twice the habit of its encoder by so much.
_SLACK = 3
_HABIT_FACTOR = 2.0
# The habit is what this percentage of so many pictures stays within.
_HABIT_PERCENT = 90
_PICTURES_KEPT = 60

# Number of blocks, padding, offset and size of a block in bytes.
_HEADER = struct.Struct("=I4xQQ")
# Of the 32 bit integers of a block: x, y, width, height, quantiser's difference to the picture's.
_QUANTISER = 4


def largest_jump(parameters: memoryview) -> int | None:
    """Return the largest change of the quantiser from one block to the next.

    Args:
        parameters: An ``AVVideoEncParams`` with its blocks.

    Returns:
        None when there are fewer than two blocks or the layout is another one.
    """
    length = parameters.nbytes
    if length < _HEADER.size:
        return None
    count, offset, size = _HEADER.unpack_from(parameters)
    whole = size >= 4 * (_QUANTISER + 1) and size % 4 == 0 and offset + count * size
    if count < 2 or not whole or whole > length:
        return None
    numbers = np.frombuffer(parameters, np.int32, count * size // 4, offset)
    quantisers = numbers.reshape(count, size // 4)[:, _QUANTISER]
    return int(np.abs(np.diff(quantisers)).max())


class QuantiserWatch:
    """Compares each picture of a stream with what its encoder usually does."""

    def __init__(self) -> None:
        self._lately: deque[int] = deque(maxlen=_PICTURES_KEPT)

    def is_rubbish(self, parameters: memoryview) -> bool:
        """Return whether a picture with these parameters is hardly what was encoded."""
        jump = largest_jump(parameters)
        if jump is None:
            return False
        # Not the maximum: rubbish now and then must not pass for a habit. But every picture counts,
        # or else a habit, once taken for rubbish, would be taken for it for ever.
        habit = float(np.percentile(self._lately, _HABIT_PERCENT)) if self._lately else 0.0
        self._lately.append(jump)
        return jump > _SLACK + _HABIT_FACTOR * habit
