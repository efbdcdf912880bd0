"""What ``/metrics`` tells about the video: how much was looked at and how late it was."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from server.mission.events import FrameAnnotated

# Four drones' pictures of a minute.
_LATENCIES_KEPT = 7200


@dataclass(frozen=True, slots=True)
class DroneVideo:
    """One drone's pictures since the start.

    Attributes:
        decoded: Pictures that were decoded.
        annotated: Pictures of those that were searched and annotated.
    """

    decoded: int
    annotated: int


class VideoCounts:
    """Counts annotated pictures; fed from the event stream.

    A drone's events carry its own counts, so that events that were lost on the way here do not
    make them wrong.

    Attributes:
        drones: Counts by drone id.
        latencies: How many latencies were observed since the start.
        latency_sum_s: Their sum, seconds.
    """

    def __init__(self) -> None:
        self.drones: dict[str, DroneVideo] = {}
        self.latencies = 0
        self.latency_sum_s = 0.0
        self._newest_s: deque[float] = deque(maxlen=_LATENCIES_KEPT)

    def record(self, event: FrameAnnotated) -> None:
        """Count a picture."""
        decoded = event.sequence + 1
        self.drones[event.drone_id] = DroneVideo(decoded, decoded - event.skipped)
        self.latencies += 1
        self.latency_sum_s += event.latency_s
        self._newest_s.append(event.latency_s)

    def latency_quantiles(self, quantiles: tuple[float, ...]) -> list[tuple[float, float]]:
        """Return quantile and seconds for each of ``quantiles`` over the newest pictures.

        Returns:
            An empty list before the first picture.
        """
        if not self._newest_s:
            return []
        values = np.quantile(np.array(self._newest_s), quantiles)
        return [(q, float(value)) for q, value in zip(quantiles, values, strict=True)]
