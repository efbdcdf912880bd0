"""Sends the newest order several times in quick succession; datagrams get lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence


class Burst:
    """Sends datagrams at once and again after fixed delays; a new burst ends the one before."""

    def __init__(self, send: Callable[[bytes], None], delays_s: tuple[float, ...]) -> None:
        """Build it; ``delays_s`` are counted from the first sending, in seconds."""
        self._send = send
        self._delays_s = delays_s
        self._pending: list[asyncio.TimerHandle] = []

    @property
    def copies(self) -> int:
        """How often a burst sends."""
        return 1 + len(self._delays_s)

    def send(self, datagrams: tuple[bytes, ...]) -> None:
        """Send ``datagrams`` before this returns, and then once per delay."""
        self.send_each([datagrams] * self.copies)

    def send_each(self, groups: Sequence[tuple[bytes, ...]]) -> None:
        """Send the first group before this returns, then one further group per delay."""
        self.cancel()
        loop = asyncio.get_running_loop()
        # The repeats come first: they must go out even when the sending below raises.
        self._pending = [
            loop.call_later(delay_s, self._send_all, group)
            for delay_s, group in zip(self._delays_s, groups[1:], strict=True)
        ]
        self._send_all(groups[0])

    def cancel(self) -> None:
        """Send no more repeats."""
        for repeat in self._pending:
            repeat.cancel()
        self._pending.clear()

    def _send_all(self, datagrams: tuple[bytes, ...]) -> None:
        for datagram in datagrams:
            self._send(datagram)
