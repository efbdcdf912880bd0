"""One time axis per recording: monotonic times of one clock as nanoseconds since 1970.

The wall clock is read once, at the beginning. Should somebody set it during a flight, times in the
file still advance evenly.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from google.protobuf.timestamp_pb2 import Timestamp

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Where the two clocks met.

    Attributes:
        wall_ns: Nanoseconds since 1970.
        monotonic_s: The monotonic clock at that moment, seconds.
    """

    wall_ns: int
    monotonic_s: float

    @classmethod
    def now(cls, clock: Callable[[], float]) -> TimeBase:
        """Read both clocks."""
        return cls(time.time_ns(), clock())

    def ns(self, at_s: float) -> int:
        """Return a monotonic time as nanoseconds since 1970."""
        return self.wall_ns + round((at_s - self.monotonic_s) * _NS)


def timestamp(at_ns: int) -> Timestamp:
    """Return nanoseconds since 1970 as protobuf has them."""
    return Timestamp(seconds=at_ns // _NS, nanos=at_ns % _NS)
