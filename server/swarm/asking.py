"""Commands that wait for their reply, one at a time, and what is sent past them.

The stops never wait here: they interrupt whoever does and go out by another way.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence

from server.swarm.burst import Burst
from server.swarm.channel import CommandChannel
from server.swarm.config import TimingConfig
from server.swarm.protocol import Reply, encode_command

_LOG = logging.getLogger(__name__)

# How long a reply of a stop or of a command given up may still come.
STRAY_S = 1.0
_READ_ATTEMPTS = 3


class Asking:
    """One drone's exchanges of command and reply.

    Attributes:
        channel: Matches replies to commands.
        turn: Held by whoever exchanges commands; the others wait.
    """

    def __init__(
        self,
        drone_id: str,
        send: Callable[[bytes], None],
        clock: Callable[[], float],
        timing: TimingConfig,
    ) -> None:
        # A drone remembers labels longer than a restart of ours takes, so they begin anywhere.
        self.channel = CommandChannel(first_label=int(clock() * 1000.0))
        self.turn = asyncio.Lock()
        self._drone_id = drone_id
        self._send = send
        self._clock = clock
        self._timing = timing
        self._answer: asyncio.Future[Reply] | None = None

    def receive(self, datagram: bytes, arrived_s: float) -> None:
        """Take a datagram from the command port."""
        reply = self.channel.receive(datagram, arrived_s)
        if reply is not None and self._answer is not None and not self._answer.done():
            self._answer.set_result(reply)

    def interrupt(self) -> None:
        """Make whoever waits for a reply wait no longer."""
        self.channel.give_up(self._clock(), STRAY_S)
        if self._answer is not None and not self._answer.done():
            self._answer.cancel()

    def send_unanswered(self, *datagrams: bytes) -> None:
        """Send harmless commands whose replies nobody waits for."""
        for datagram in datagrams:
            self._send(datagram)
            self.channel.owe(self._clock(), STRAY_S)

    async def exchange(
        self,
        text: str,
        timeout_s: float,
        settled: Callable[[], bool] | None = None,
        patience_s: float = STRAY_S,
    ) -> Reply | None:
        """Send a command once and return its reply; None on timeout, stop or ``settled()``.

        For ``patience_s`` after the wait one reply is taken for a late answer to this command.
        """
        datagram = self.channel.begin(text)
        return await self._answered(lambda: self._send(datagram), timeout_s, settled, patience_s)

    async def exchange_labelled(
        self, text: str, burst: Burst, timeout_s: float, settled: Callable[[], bool]
    ) -> Reply | None:
        """Send a command in loss-proof copies through ``burst``; else like ``exchange``."""
        copies: Sequence[tuple[bytes, ...]] = [
            (datagram,) for datagram in self.channel.begin_labelled(text, burst.copies)
        ]
        return await self._answered(lambda: burst.send_each(copies), timeout_s, settled, 0.0)

    async def _answered(
        self,
        send: Callable[[], None],
        timeout_s: float,
        settled: Callable[[], bool] | None,
        patience_s: float,
    ) -> Reply | None:
        epoch = self.channel.epoch
        answer = asyncio.get_running_loop().create_future()
        self._answer = answer
        deadline_s = self._clock() + timeout_s
        try:
            send()
            while not answer.done() and self._clock() < deadline_s:
                if settled is not None and settled():
                    break
                await asyncio.wait((answer,), timeout=self._timing.beat_s)
            return answer.result() if answer.done() and not answer.cancelled() else None
        finally:
            self._answer = None
            if self.channel.epoch == epoch:
                self.channel.give_up(self._clock(), patience_s)

    async def until_ok(self, text: str) -> None:
        """Send a command that may be carried out twice until it is answered with ok."""
        unanswered = 0
        async with self.turn:
            while True:
                # A late answer is as good as a prompt one. Were it dropped, each answer would be
                # taken for that of the attempt before, and none ever for its own.
                reply = await self.exchange(text, self._timing.retry_s, patience_s=0.0)
                if reply is not None and reply.kind == "ok":
                    self.channel.owe(self._clock(), STRAY_S, unanswered)
                    return
                unanswered += reply is None
                if reply is not None:
                    _LOG.warning("%s: answers %s to %s", self._drone_id, reply.text, text)
                    await asyncio.sleep(self._timing.retry_s)

    async def read(self, question: str, valid: Callable[[Reply], bool]) -> Reply | None:
        """Ask for a value, ``sn?`` and the like.

        Args:
            question: What to ask.
            valid: Says whether a reply answers this question and not the one before.

        Returns:
            The answer, None when no attempt was answered.
        """
        unanswered = 0
        async with self.turn:
            while unanswered < _READ_ATTEMPTS:
                reply = await self.exchange(question, self._timing.retry_s, patience_s=0.0)
                if reply is not None and valid(reply):
                    break
                unanswered += 1
            else:
                reply = None
            self.channel.owe(self._clock(), STRAY_S, unanswered)
        return reply

    def command(self, text: str) -> None:
        """Send a harmless command by its text; its reply is not waited for."""
        self.send_unanswered(encode_command(text))
