"""Which faults of one drone are waiting, in force or over; pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from server.sim.faults import KINDS, Fault
from server.sim.sensors import Vector

_WINDS = ("gust", "drift_away")


@dataclass(slots=True, eq=False)
class _Entry:
    """A fault with its times on the simulation's clock.

    Attributes:
        fault: What goes wrong.
        begin_s: When; infinite while what it counts from has not happened.
        end_s: Until when.
        heading_rad: Direction of a wind, drawn when it begins.
    """

    fault: Fault
    begin_s: float = math.inf
    end_s: float = math.inf
    heading_rad: float | None = None


class FaultPlan:
    """The faults of one drone.

    Attributes:
        due_s: When ``turn`` is to be called next; infinite when nothing is due.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.due_s = math.inf
        self._waiting = [_Entry(fault) for fault in faults]
        self._in_force: list[_Entry] = []
        self._left_ground = False

    def start(self, now_s: float) -> None:
        """Set the time that faults since the start count from."""
        self._schedule("start", now_s)

    def leave_ground(self, now_s: float) -> None:
        """Set the time that faults since the first take-off count from."""
        self._left_ground = True
        self._schedule("air", now_s)

    def add(self, fault: Fault, now_s: float) -> None:
        """Plan a fault at run time; it counts from now, or from a take-off yet to come."""
        if fault.since == "start" or self._left_ground:
            fault = replace(fault, since="start")
            begin_s = now_s + fault.at_s
            self._waiting.append(_Entry(fault, begin_s, begin_s + fault.for_s))
        else:
            self._waiting.append(_Entry(fault))
        self._look_ahead()

    def turn(self, now_s: float) -> tuple[list[Fault], list[Fault]]:
        """Move on to ``now_s``; return the faults that begin and those that end."""
        begun = [entry for entry in self._waiting if entry.begin_s <= now_s]
        self._waiting = [entry for entry in self._waiting if entry.begin_s > now_s]
        ended = [entry for entry in self._in_force if entry.end_s <= now_s]
        self._in_force = [entry for entry in self._in_force if entry.end_s > now_s]
        self._in_force += [entry for entry in begun if not KINDS[entry.fault.kind].at_once]
        self._look_ahead()
        return [entry.fault for entry in begun], [entry.fault for entry in ended]

    def active(self, kind: str) -> bool:
        """Tell whether a fault of this kind is in force."""
        return any(entry.fault.kind == kind for entry in self._in_force)

    def total(self, *kinds: str) -> float:
        """Return the sum of the amounts in force of these kinds."""
        return sum(self._amounts(kinds))

    def share(self, *kinds: str) -> float:
        """Return the share that independent faults of these kinds take together."""
        return 1.0 - math.prod(1.0 - amount for amount in self._amounts(kinds))

    def most(self, kind: str) -> float | None:
        """Return the largest amount in force, None without any."""
        return max(self._amounts((kind,)), default=None)

    def wind(self, heading_rad: Callable[[], float]) -> Vector:
        """Return the world velocity that winds force on the drone, metres per second.

        Args:
            heading_rad: Draws the direction of a wind that has just begun.
        """
        x = y = 0.0
        for entry in self._in_force:
            if entry.fault.kind in _WINDS:
                if entry.heading_rad is None:
                    entry.heading_rad = heading_rad()
                x += entry.fault.amount * math.cos(entry.heading_rad)
                y += entry.fault.amount * math.sin(entry.heading_rad)
        return x, y, 0.0

    def _amounts(self, kinds: tuple[str, ...]) -> list[float]:
        return [entry.fault.amount for entry in self._in_force if entry.fault.kind in kinds]

    def _schedule(self, since: str, now_s: float) -> None:
        for entry in self._waiting:
            if entry.fault.since == since and math.isinf(entry.begin_s):
                entry.begin_s = now_s + entry.fault.at_s
                entry.end_s = entry.begin_s + entry.fault.for_s
        self._look_ahead()

    def _look_ahead(self) -> None:
        times = [entry.begin_s for entry in self._waiting]
        times += [entry.end_s for entry in self._in_force]
        self.due_s = min(times, default=math.inf)
