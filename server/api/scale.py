"""The scale of a capture from one length that somebody knows."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from server.api.json_numbers import WHOLE, Number
from server.api.problems import ProblemError, described
from server.jobs.book import JobBook
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import MissionControl, RefusedError
from server.store.scaling import PlacedMark, ScaleUnknownError, scale_by_length

_UNFINISHED = ("queued", "running", "paused")
_MOST_MARKS = 40


class MarkedEnd(BaseModel):
    """One end of the known length in one picture: picture by number, x and y in its pixels."""

    model_config = ConfigDict(extra="forbid")

    picture: Annotated[int, Field(strict=True, ge=0, lt=100_000), WHOLE]
    x: Number = Field(ge=-1.0, le=100_000.0)
    y: Number = Field(ge=-1.0, le=100_000.0)


_Marks = Annotated[list[MarkedEnd], Field(min_length=2, max_length=_MOST_MARKS)]


class KnownLength(BaseModel):
    """How long something really is, and where its two ends are, each in two pictures or more."""

    model_config = ConfigDict(extra="forbid")

    length_m: Number = Field(gt=0.0, le=100.0)
    length_sigma_m: Number = Field(default=0.002, ge=0.0, le=10.0)
    ends: tuple[_Marks, _Marks]


class ScaleView(BaseModel):
    """What was done: all lengths times ``factor``, known to ``sigma``; it seemed ``measured_m``."""

    factor: float
    sigma: float
    measured_m: float


def make_scale_router(mission: MissionControl, book: JobBook, busy: BusyCaptures) -> APIRouter:
    """Return the route ``/captures/{id}/scale``."""
    router = APIRouter(prefix="/api/v1/captures", tags=["results"])

    @router.post(
        "/{capture_id}/scale", operation_id="scaleCapture", responses=described(404, 409, 422)
    )
    async def scale_capture(capture_id: str, known: KnownLength) -> ScaleView:
        """Make everything that a finished capture left as large as the known length says."""
        _refuse_while_busy(mission, book, capture_id)
        with busy.hold(capture_id, "is being scaled"):
            ends = _placed(known.ends[0]), _placed(known.ends[1])
            run = mission.run_folder(capture_id)
            try:
                found = await asyncio.to_thread(
                    scale_by_length, run, ends, known.length_m, known.length_sigma_m
                )
            except ScaleUnknownError as error:
                raise ProblemError(422, str(error)) from error
            except (OSError, ValueError) as error:
                raise RefusedError(f"{capture_id} cannot be changed: {error}") from error
        return ScaleView(factor=found.factor, sigma=found.sigma, measured_m=found.measured_m)

    return router


def _refuse_while_busy(mission: MissionControl, book: JobBook, capture_id: str) -> None:
    """Raise RefusedError unless the capture is finished and nobody works, on it or in the air."""
    state = mission.capture(capture_id).status.state
    if state != "succeeded":
        # One that can still be gone on with keeps what it was begun with.
        raise RefusedError(f"{capture_id} is {state}; only a finished capture can be scaled")
    for record in mission.captures():
        if record.status.state in _UNFINISHED:
            raise RefusedError(f"{record.status.id} is {record.status.state}; wait for its end")
    if any(job.capture == capture_id and job.state in _UNFINISHED for job in book.jobs()):
        raise RefusedError(f"a training works on {capture_id}; wait for its end or cancel it")


def _placed(end: list[MarkedEnd]) -> list[PlacedMark]:
    return [(mark.picture, mark.x, mark.y) for mark in end]
