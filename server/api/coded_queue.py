"""Coded pictures of one drone on their way to one client. Does no I/O and reads no clock.

A coded picture means nothing without the one before it, so none may be left out but up to the next
key picture. What waits is therefore a chain: it begins at a key picture or goes on from what was
sent last, has no gaps and nothing that was damaged on the air, and is given up as a whole when it
grows too long or the client could not decode it.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

from server.mission.events import FrameAnnotated
from server.stages import CodedPicture

# Half a second at 30 pictures per second; a client further behind goes on at a key picture.
_LONGEST = 15
# So many may be under way: a decoder may want one or two more before it shows the first.
_UNDER_WAY = 6


class CodedQueue:
    """The chain of one drone's pictures."""

    def __init__(self) -> None:
        self._waiting: deque[FrameAnnotated] = deque()
        self._under_way: deque[int] = deque()
        self._last: int | None = None

    def offer(self, event: FrameAnnotated) -> bool:
        """Take a picture; returns whether the client will be able to decode it."""
        coded = event.coded
        if event.damaged or not coded or not self._may_follow(coded):
            self._last = None
            return False
        if coded[0].key:
            self._waiting.clear()  # Newest wins, and this one needs none of them.
        elif len(self._waiting) >= _LONGEST:
            self._waiting.clear()
            self._last = None
            return False
        self._waiting.append(event)
        self._last = coded[-1].number
        return True

    def _may_follow(self, coded: tuple[CodedPicture, ...]) -> bool:
        unbroken = all(b.number == a.number + 1 for a, b in pairwise(coded))
        return unbroken and (coded[0].key or coded[0].number - 1 == self._last)

    def take(self) -> FrameAnnotated | None:
        """Return the next picture to send, None while there is none or enough are under way."""
        if not self._waiting or len(self._under_way) >= _UNDER_WAY:
            return None
        event = self._waiting.popleft()
        self._under_way.append(event.sequence)
        return event

    def shown(self, sequence: int, *, decoded: bool = True) -> None:
        """Note that the client has shown a picture, or could not decode it."""
        if sequence not in self._under_way:
            return
        while self._under_way.popleft() != sequence:
            pass
        if not decoded and not (self._waiting and self._waiting[0].coded[0].key):
            self._waiting.clear()
            self._last = None
