"""One direction of one drone's Wi-Fi: what arrives, when, how often; pure.

With nothing wrong datagrams arrive in the order they were sent. Each of the faults below draws from
the channel's own generator, and only while it is in force, so a seed repeats a whole flight.
"""

from __future__ import annotations

import random
from typing import Generic, TypeVar

T = TypeVar("T")

_COPY_GAP_S = 0.003
_HELD_BACK_S = (0.01, 0.08)


class Radio(Generic[T]):
    """A channel for datagrams, or for whatever stands for them.

    Attributes:
        loss: Share of datagrams that never arrive.
        latency_s: What every datagram takes, seconds.
        delay_s: Added to the latency of each.
        reorder: Share held back so that later ones overtake it.
        duplicate: Share that arrives twice.
        sent: Datagrams handed in.
        lost: Datagrams that never arrive.
    """

    def __init__(self, rng: random.Random, latency_s: float = 0.0, jitter_s: float = 0.0) -> None:
        """Make a channel.

        Args:
            rng: Decides on each datagram's fate.
            latency_s: What every datagram takes, seconds.
            jitter_s: Mean of a further, exponentially distributed time, seconds.
        """
        self.loss = 0.0
        self.delay_s = 0.0
        self.reorder = 0.0
        self.duplicate = 0.0
        self.sent = 0
        self.lost = 0
        self._rng = rng
        self.latency_s = latency_s
        self._jitter_s = jitter_s
        self._last_s = -1e9

    def send(self, datagram: T, now_s: float) -> list[tuple[float, T]]:
        """Return when (in seconds) the datagram arrives: never, once or twice."""
        self.sent += 1
        draw = self._rng.random
        if self.loss > 0.0 and draw() < self.loss:
            self.lost += 1
            return []
        arrive_s = now_s + self.latency_s + self.delay_s
        if self._jitter_s > 0.0:
            arrive_s += self._rng.expovariate(1.0 / self._jitter_s)
        if self.delay_s > 0.0:
            # A congested channel does not delay evenly.
            arrive_s += 0.25 * self.delay_s * draw()
        if self.reorder > 0.0 and draw() < self.reorder:
            arrive_s += self._rng.uniform(*_HELD_BACK_S)
        else:
            self._last_s = arrive_s = max(arrive_s, self._last_s)
        arrivals = [(arrive_s, datagram)]
        if self.duplicate > 0.0 and draw() < self.duplicate:
            arrivals.append((arrive_s + _COPY_GAP_S, datagram))
        return arrivals
