"""Matches replies to commands; bytes and times in, replies out; no I/O, no clock.

Most replies carry no identity, so at most one command is outstanding and owed replies are counted.
Motion commands to an EDU go in its loss-proof form instead: several copies of one labelled
datagram, which the drone carries out once and whose reply carries the label.
"""

from __future__ import annotations

from collections import deque

from server.swarm.protocol import (
    LABELS,
    ProtocolError,
    Reply,
    decode_reply,
    encode_command,
    encode_labelled,
    split_label,
)


class CommandChannel:
    """Matches replies to commands: at most one command is outstanding.

    Plain replies carry no identity. Every command therefore has an epoch, and the channel keeps
    count of replies that are still owed to nobody: those of commands given up (they may come late)
    and of datagrams sent past the channel (stops and repeats). While such a reply is owed, the next
    one to arrive is taken for it and dropped. The price is that a command may time out although it
    was answered; that is harmless, a wrong ``ok`` is not. A labelled command is answered by its
    label alone, or by the complaint of a drone that does not know labels.

    Attributes:
        epoch: Counts commands; a result belongs to a command only when the epoch still agrees.
        discarded: Replies dropped that nobody waits for and none was owed.
        garbage: Datagrams that were no reply at all.
        replied_s: When the newest reply came, whatever it answers; None before the first.
        valued_s: When the newest came that was the answer to a question.
        labels_known: True once the drone answered to a label, False once it complained about one,
            None before either.
    """

    def __init__(self, first_label: int = 0) -> None:
        """Build it; labels count from ``first_label``, which should differ from start to start."""
        self.epoch = 0
        self.discarded = 0
        self.garbage = 0
        self.replied_s: float | None = None
        self.valued_s: float | None = None
        self.labels_known: bool | None = None
        self._outstanding: str | None = None
        self._label: int | None = None
        self._next_label = first_label % LABELS
        self._owed_until_s: deque[float] = deque(maxlen=256)

    @property
    def outstanding(self) -> str | None:
        """The command that waits for its reply."""
        return self._outstanding

    def begin(self, text: str) -> bytes:
        """Make ``text`` the outstanding command and return its datagram.

        Raises:
            ProtocolError: If another command is outstanding or ``text`` cannot be sent.
        """
        if self._outstanding is not None:
            raise ProtocolError(f"{text!r} while {self._outstanding!r} is outstanding")
        datagram = encode_command(text)
        self._outstanding, self._label = text, None
        self.epoch += 1
        return datagram

    def begin_labelled(self, text: str, copies: int) -> tuple[bytes, ...]:
        """Make ``text`` the outstanding command and return its loss-proof copies.

        Raises:
            ProtocolError: If another command is outstanding or ``text`` cannot be sent.
        """
        self.begin(text)
        self._label = self.new_label()
        return tuple(encode_labelled(self._label, copy + 1, text) for copy in range(copies))

    def new_label(self) -> int:
        """Return a label that none of the last hundred commands had."""
        label = self._next_label
        self._next_label = (label + 1) % LABELS
        return label

    def owe(self, now_s: float, patience_s: float, copies: int = 1) -> None:
        """Note that ``copies`` replies may come until ``now_s + patience_s`` that answer nobody."""
        self._owed_until_s.extend([now_s + patience_s] * copies)

    def give_up(self, now_s: float, patience_s: float) -> None:
        """End the wait for the outstanding command; its reply, if it still comes, is dropped."""
        if self._outstanding is not None:
            labelled = self._label is not None
            self._outstanding = self._label = None
            self.epoch += 1
            if not labelled:  # A labelled reply is known for what it is whenever it comes.
                self.owe(now_s, patience_s)

    def receive(self, datagram: bytes, now_s: float) -> Reply | None:
        """Return the reply when it answers the outstanding command, else None."""
        label, body = split_label(datagram)
        try:
            reply = decode_reply(body)
        except ProtocolError:
            self.garbage += 1
            return None
        self.replied_s = now_s
        if reply.kind == "value":
            self.valued_s = now_s
        if label is not None:
            self.labels_known = True
            mine = label == self._label and reply.kind != "forced_stop"
            return self._answered(reply) if mine else self._dropped()
        if reply.kind == "forced_stop":
            return self._dropped()
        if reply.kind == "error" and names_label(reply.text):
            self.labels_known = False
            return self._answered(reply) if self._label is not None else self._dropped()
        self._owed_until_s = deque(
            (until for until in self._owed_until_s if until > now_s), maxlen=256
        )
        if self._owed_until_s:
            self._owed_until_s.popleft()
            return None
        if self._outstanding is None or self._label is not None:
            return self._dropped()
        return self._answered(reply)

    def _answered(self, reply: Reply) -> Reply:
        self._outstanding = self._label = None
        return reply

    def _dropped(self) -> None:
        self.discarded += 1


def names_label(text: str) -> bool:
    """Return whether a refusal is that of a drone which took a label for a command."""
    _, colon, word = text.partition(":")
    word = word.strip()
    return bool(colon) and word.startswith("Re") and word[2:6].isdigit()
