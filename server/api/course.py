"""What every drone reported over the last quarter of an hour, for whoever opens a page late."""

from __future__ import annotations

from server.mission.events import DroneReported

# A plot is a few hundred pixels wide, and a Tello flies for less than it shows.
_EVERY_S = 5
_LONGEST_S = 900


class Course:
    """Every drone's reports, thinned to one in five seconds; bounded by time and the fleet."""

    def __init__(self) -> None:
        self._reports: dict[tuple[int, str], DroneReported] = {}

    def record(self, report: DroneReported) -> None:
        """Keep ``report`` if it is due; the newest of a second stands for it."""
        second = int(report.at.timestamp())
        if second % _EVERY_S:
            return
        self._reports[second, report.drone_id] = report
        while (oldest := next(iter(self._reports)))[0] <= second - _LONGEST_S:
            del self._reports[oldest]

    def reports(self) -> list[DroneReported]:
        """Return what is kept, oldest first."""
        return list(self._reports.values())
