"""The vendor's loss-proof form of a command; pure.

A command may come several times under one label: ``ReNNkk command`` with a two-digit label and a
copy number, or the older form with the same seven bytes of which bytes 2 and 3 are the label. It is
carried out once; every copy is answered under its own head.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

_HEAD_BYTES = 7
_LABELS_KEPT = 32
_COPIES_KEPT = 16
# Labels come round again after a hundred commands, or start anywhere when a client restarts.
_REMEMBERED_S = 10.0


@dataclass(slots=True)
class _Known:
    """One label's command.

    Attributes:
        heads: Heads of the copies that wait for the answer.
        answer: The answer, None while it is carried out.
        until_s: When an answered label is forgotten.
    """

    heads: list[bytes] = field(default_factory=list)
    answer: bytes | None = None
    until_s: float = 0.0


def split_head(datagram: bytes) -> tuple[bytes, bytes]:
    """Return the loss-proof head, empty when there is none, and the command behind it."""
    if not datagram.startswith(b"Re"):
        return b"", datagram
    return datagram[:_HEAD_BYTES], datagram[_HEAD_BYTES:]


class Copies:
    """Remembers the latest labels."""

    def __init__(self) -> None:
        self._known: OrderedDict[bytes, _Known] = OrderedDict()

    def take(self, head: bytes, now_s: float) -> list[bytes] | None:
        """Take note of a copy.

        Returns:
            None when the command is new and to be carried out, else the answers due now: none
            while it is still being carried out.
        """
        label = head[2:4]
        known = self._known.get(label)
        if known is not None and (known.answer is None or now_s <= known.until_s):
            if known.answer is not None:
                return [head + known.answer]
            if head not in known.heads and len(known.heads) < _COPIES_KEPT:
                known.heads.append(head)
            return []
        self._known[label] = _Known([head])
        self._known.move_to_end(label)
        if len(self._known) > _LABELS_KEPT:
            self._known.popitem(last=False)
        return None

    def answer(self, head: bytes, body: bytes, now_s: float) -> list[bytes]:
        """Return the answers to all copies of a command that has just been answered."""
        known = self._known.get(head[2:4])
        if known is None:
            return [head + body]
        known.answer, known.until_s = body, now_s + _REMEMBERED_S
        heads, known.heads = known.heads, []
        return [copy + body for copy in heads or [head]]
