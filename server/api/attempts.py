"""How often an address may show a wrong token. Does no I/O; times are monotonic seconds."""

from __future__ import annotations

from collections import deque

_MOST_ADDRESSES = 1024


class Attempts:
    """Counts wrong tokens per address over a sliding while."""

    def __init__(self, most: int, while_s: float) -> None:
        """Allow ``most`` wrong tokens per address in any ``while_s`` seconds."""
        self._most, self._while_s = most, while_s
        self._wrong: dict[str, deque[float]] = {}

    def wait_s(self, address: str, now_s: float) -> float:
        """Return how long ``address`` has to wait before it may try again; 0 when it may now."""
        times = self._wrong.get(address)
        while times and now_s - times[0] >= self._while_s:
            times.popleft()
        if not times or len(times) < self._most:
            return 0.0
        return self._while_s - (now_s - times[0])

    def note(self, address: str, now_s: float) -> None:
        """Count a wrong token; whoever tried longest ago is forgotten when there are too many."""
        times = self._wrong.pop(address, deque())
        times.append(now_s)
        self._wrong[address] = times
        while len(self._wrong) > _MOST_ADDRESSES:
            del self._wrong[next(iter(self._wrong))]
