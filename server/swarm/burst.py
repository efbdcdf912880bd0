"""Sends the newest stop several times in quick succession; datagrams get lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable


class Burst:
    """Sends datagrams at once and again after fixed delays; a new burst ends the one before."""

    def __init__(self, send: Callable[[bytes], None], delays_s: tuple[float, ...]) -> None:
        """Build it; ``delays_s`` are counted from the first sending, in seconds."""
        self._send = send
        self._delays_s = delays_s
        self._pending: list[asyncio.TimerHandle] = []

    def send(self, datagrams: tuple[bytes, ...]) -> None:
        """Send ``datagrams`` before this returns, and then once per delay."""
        self.cancel()
        loop = asyncio.get_running_loop()
        # The repeats come first: they must go out even when the sending below raises.
        self._pending = [
            loop.call_later(delay_s, self._send_all, datagrams) for delay_s in self._delays_s
        ]
        self._send_all(datagrams)

    def cancel(self) -> None:
        """Send no more repeats."""
        for repeat in self._pending:
            repeat.cancel()
        self._pending.clear()

    def _send_all(self, datagrams: tuple[bytes, ...]) -> None:
        for datagram in datagrams:
            self._send(datagram)
