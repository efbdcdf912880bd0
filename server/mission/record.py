"""What a capture tells about itself: its status for everybody, and ``capture.json`` on disk."""

from __future__ import annotations

import json
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig
from server.mission.events import CaptureChanged
from server.mission.phases import Phase, Progress
from server.stages import SeedGeometry
from server.store.run_writer import RunWriter
from server.store.runs import RunFolder

# A disk that takes longer than this to write a record is not waited for.
_PATIENCE_S = 20.0
# Of the whole capture's bar the flight gets this much, the training the rest.
_FLIGHT_SHARE = 0.6


class CaptureRecorder:
    """Keeps the record of one capture.

    Attributes:
        state: queued, running, paused, succeeded, failed or aborted.
        error: What went wrong, None when nothing did.
        seconds: Seconds spent so far, by phase.
        entered: When each phase was entered for the first time, ISO 8601 UTC.
        overrides: Reason by overridden checklist item.
        dropped: Why each drone that dropped out did so.
    """

    def __init__(self, request: CaptureRequest, run: RunFolder, config: FlightConfig) -> None:
        self.state = "queued"
        self.error: str | None = None
        self.seconds: dict[str, float] = {}
        self.entered: dict[str, str] = {}
        self.overrides: dict[str, str] = {}
        self.dropped: dict[str, str] = {}
        self._request = request
        self._run = run
        self._writer = RunWriter(run)
        self._config = _plain(asdict(config))
        self._started_at = datetime.now(UTC)

    def enter(self, phase: Phase) -> None:
        """Note when a phase begins; what comes again keeps its first time."""
        self.entered.setdefault(phase.value, datetime.now(UTC).isoformat())

    def add_seconds(self, phase: Phase, seconds: float) -> None:
        """Count time spent in a phase."""
        self.seconds[phase.value] = self.seconds.get(phase.value, 0.0) + seconds

    def status(
        self,
        progress: Progress,
        images: int,
        wanted: int,
        commanded: int,
        train_total_s: float,
        train_left_s: float,
    ) -> CaptureChanged:
        """Return the capture as it stands.

        Args:
            progress: Its place in its course.
            images: Pictures on disk.
            wanted: Pictures wanted in all.
            commanded: Viewpoints the drones were sent to.
            train_total_s: Expected length of the reconstruction.
            train_left_s: What is left of it.
        """
        fraction, eta_s = self._time_left(progress, train_total_s, train_left_s)
        return CaptureChanged(
            id=self._run.id,
            state=self.state,
            phase=progress.phase.value,
            progress=fraction,
            eta_s=eta_s,
            run=str(self._run.path),
            error=self.error,
            mode=self._request.mode,
            round_index=progress.round_index,
            rounds=progress.rounds,
            images=images,
            images_total=wanted,
            commanded=commanded,
            entered=dict(self.entered),
        )

    def save(self, status: CaptureChanged, progress: Progress, seed: SeedGeometry | None) -> None:
        """Write ``capture.json`` soon; ``complete`` in it says that no picture follows."""
        landed = progress.phase in (Phase.TRAIN, Phase.DONE, Phase.ENDED)
        self._writer.write_state(
            {
                "id": self._run.id,
                "request": asdict(self._request),
                "started_at": self._started_at.isoformat(),
                "complete": landed,
                "status": asdict(status) | {"at": datetime.now(UTC).isoformat()},
                "seconds": {key: round(value, 2) for key, value in self.seconds.items()},
                "overrides": dict(self.overrides),
                "dropped": dict(self.dropped),
                "seed": _seed_json(seed),
                "config": self._config,
            }
        )

    def log(self, fields: dict[str, Any]) -> None:
        """Append what happened to the run's own log soon."""
        self._writer.log(fields)

    async def settled(self) -> None:
        """Wait until everything told so far is on disk, unless the disk takes far too long."""
        await self._writer.settled(_PATIENCE_S)

    def _time_left(
        self, progress: Progress, train_total_s: float, train_left_s: float
    ) -> tuple[float, float | None]:
        """Return progress and seconds left: flight counted in phases, training by its own clock."""
        if progress.over:
            return 1.0, 0.0
        elapsed_s = sum(self.seconds.values())
        if progress.phase is Phase.TRAIN:
            total_s = elapsed_s + train_total_s
            return max(0.0, 1.0 - train_left_s / max(total_s, 1.0)), train_left_s
        flight = progress.fraction()
        if progress.round_index < 1 or elapsed_s <= 0.0 or progress.phase is Phase.GROUNDED:
            return _FLIGHT_SHARE * flight, None
        flight_left_s = elapsed_s * (1.0 - flight) / max(flight, 1e-3)
        return _FLIGHT_SHARE * flight, flight_left_s + train_left_s


def _seed_json(seed: SeedGeometry | None) -> dict[str, Any] | None:
    if seed is None:
        return None
    boxes = (seed.outer, *seed.boxes)
    lists = [[box.lower.tolist(), box.upper.tolist()] for box in boxes]
    return {
        "outer": lists[0],
        "boxes": lists[1:],
        "confidences": seed.box_confidences,
        "views": seed.views,
    }


def _plain(value: Any) -> Any:
    """Return ``value`` with everything JSON cannot hold turned into text or lists."""
    return json.loads(json.dumps(value, default=str))
