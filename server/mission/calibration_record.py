"""What is known of a camera's calibration, and what may be asked of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from server.vision.calibration import Calibration, Lack
from server.vision.calibration_sheet import SheetForm
from server.vision.calibration_views import Hint, PickProgress

CalibrationState = Literal["idle", "collecting", "solving", "solved", "refused", "ended"]
"""``refused``: the views do not determine the camera. ``ended``: before there was a result."""

Ending = Literal["cancelled", "capture", "flight", "offline", "closed", "failed"]
"""Why a calibration ended before there was a result."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationResult:
    """A camera as its views have it.

    Attributes:
        calibration: The camera and how well it is known.
        remark: How it was found, one line.
        toml: The same as a piece of a fleet file.
        coverage_png: A picture of what the views reached.
    """

    calibration: Calibration
    remark: str
    toml: str
    coverage_png: bytes


@dataclass(frozen=True, slots=True)
class Applied:
    """What became of a result that was to be used; the console uses it from then on.

    Attributes:
        file: The fleet file it was written into, None where there is none, or it was not written.
        backup: That file as it was before.
        problem: Why it was not written, empty otherwise.
    """

    file: Path | None = None
    backup: Path | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationRecord:
    """A calibration as it stands.

    Attributes:
        drone_id: Whose camera it is.
        state: How far it is.
        board: The board, as it is written on the command line.
        progress: The views so far.
        views_wanted: With so many views it ends by itself.
        views_least: With fewer it is refused.
        hint: What to do next; None while no picture comes, and when nothing is collected.
        spent_s: How long views were collected, seconds.
        lack: What the views lack, when it was refused.
        ending: Why it ended without a result.
        reason: The same for people; empty otherwise.
        result: The camera, once it is solved.
        applied: What became of the result, None before it was to be used.
        file: The fleet file a result would be written into, None where there is none.
    """

    drone_id: str
    state: CalibrationState
    board: str
    progress: PickProgress
    views_wanted: int
    views_least: int
    hint: Hint | None = None
    spent_s: float = 0.0
    lack: Lack | None = None
    ending: Ending | None = None
    reason: str = ""
    result: CalibrationResult | None = None
    applied: Applied | None = None
    file: Path | None = None


class CalibrationControl(Protocol):
    """What may be asked of the cameras' calibrations; on the event loop. One at a time goes on."""

    def record(self, drone_id: str) -> CalibrationRecord:
        """Return the newest calibration of a drone's camera; raises UnknownError."""
        ...

    def start(self, drone_id: str, *, go_on: bool = False) -> CalibrationRecord:
        """Begin to collect views, with ``go_on`` in addition to those of the one before.

        Raises:
            UnknownError: If there is no such drone.
            RefusedError: If another one goes on, a capture is active, a drone is in the air, or
                this one does not stand there and answer.
        """
        ...

    def finish(self, drone_id: str) -> CalibrationRecord:
        """Solve with the views there are; raises UnknownError or RefusedError."""
        ...

    def cancel(self, drone_id: str) -> CalibrationRecord:
        """End it without a result, or forget the result; raises UnknownError."""
        ...

    async def apply(self, drone_id: str) -> CalibrationRecord:
        """Use a result from now on and write it into the fleet file, where there is one.

        Raises:
            UnknownError: If there is no such drone.
            RefusedError: If there is no result, a capture is active or a drone is in the air.
        """
        ...

    def sheet(self, form: SheetForm) -> bytes:
        """Return the board to print; drawing takes a moment, so call it in a thread."""
        ...
