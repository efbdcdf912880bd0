"""Asks a drone for less video where much of it is lost; no I/O, no clock.

One lost datagram of a picture spoils all pictures up to the next key picture. At 2.5 Mbit/s a key
picture fills some 25 datagrams and another some 7; at 1 Mbit/s 10 and 3. Of 100 key pictures 7
arrive whole against 35 where every tenth datagram is lost: coarse whole pictures instead of fine
broken ones.
"""

from __future__ import annotations

from collections import deque

_WINDOW_S = 5.0
# Fewer pictures than this, or in a shorter time, say little.
_LEAST_PICTURES, _LEAST_S = 6, 3.0
_MUCH_DAMAGE = 0.3
# A radio that has been clean for so long on the ground gets its full rate back.
_CLEAN_S = 60.0
_LOW, _DRONES_CHOICE = "setbitrate 1", "setbitrate 0"


class VideoRate:
    """What rate one drone's video should have.

    Attributes:
        low: True while the drone is asked for less than it would send by itself.
    """

    def __init__(self) -> None:
        self.low = False
        self._lately: deque[tuple[float, bool]] = deque()
        self._damage_s = 0.0
        self._asked_s = -_WINDOW_S

    def observe(self, at_s: float, damaged: bool) -> None:
        """Take a decoded picture."""
        self._lately.append((at_s, damaged))
        if damaged:
            self._damage_s = at_s
        while self._lately[0][0] < at_s - _WINDOW_S:
            self._lately.popleft()

    def order(self, now_s: float, *, flies: bool) -> str | None:
        """Return the command that is due, or None; it may be repeated, as it may get lost.

        Args:
            now_s: The time.
            flies: True in the air, where the rate is lowered but never raised.
        """
        if now_s - self._asked_s < _WINDOW_S:
            return None
        if self._much_is_damaged(now_s):
            self.low = True
            self._asked_s = now_s
            return _LOW
        if self.low and not flies and self._lately and now_s - self._damage_s > _CLEAN_S:
            self.low = False
            self._asked_s = now_s
            return _DRONES_CHOICE
        return None

    def _much_is_damaged(self, now_s: float) -> bool:
        lately = [(at_s, damaged) for at_s, damaged in self._lately if at_s > now_s - _WINDOW_S]
        if len(lately) < _LEAST_PICTURES or now_s - lately[0][0] < _LEAST_S:
            return False
        return sum(damaged for _, damaged in lately) > _MUCH_DAMAGE * len(lately)
