"""Captures: start, watch, pause, resume, abort."""

from __future__ import annotations

import asyncio
from datetime import datetime
from pathlib import Path
from typing import Annotated, cast
from urllib.parse import quote

from fastapi import APIRouter, Body, Depends
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from server.api.command import CommandDesk
from server.api.json_numbers import WHOLE, Number
from server.api.paging import PAGED, Cursor, Limit, link_next, page_of
from server.api.problems import ProblemError, described, json_safe
from server.api.translate import CaptureState
from server.jobs.book import JobBook
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import (
    MOST_PICTURES,
    CaptureRecord,
    CaptureRequest,
    MissionControl,
    Mode,
    RefusedError,
)
from server.mission.events import FieldView
from server.store.deletion import StillTrainedError
from server.store.runs import is_starred, star_run

_PREFIX = "/api/v1/captures"
# What people call a capture becomes part of a folder's name: no separators, no control characters.
_NAME = r"^[^\x00-\x1f\x7f/\\]*$"


_MOST_OVERRIDES = 40
_Item = Annotated[str, StringConstraints(min_length=1, max_length=80)]
# A reason is one line of the record: letters, not layout.
_Reason = Annotated[
    str,
    StringConstraints(
        strip_whitespace=True, min_length=3, max_length=300, pattern=r"^[^\x00-\x1f\x7f]*$"
    ),
]


class CaptureSpec(BaseModel):
    """What to capture; every field may be left out.

    ``overrides`` names checklist items that shall not keep the capture on the ground, by key
    (``drone-2.level``) or for all drones by item (``level``), each with the reason why.
    """

    model_config = ConfigDict(extra="forbid")

    mode: Mode = "optimized"
    drones: Annotated[int, Field(strict=True, ge=1, le=8), WHOLE] | None = None
    pictures: Annotated[int, Field(strict=True, ge=1, le=MOST_PICTURES), WHOLE] = 24
    train_seconds: Number = Field(default=60.0, ge=0.0, le=86_400.0)
    name: str = Field(default="", max_length=80, pattern=_NAME)
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32), WHOLE] = 0
    overrides: dict[_Item, _Reason] = Field(default_factory=dict, max_length=_MOST_OVERRIDES)


class MorePictures(BaseModel):
    """How many pictures more a capture under way shall take."""

    model_config = ConfigDict(extra="forbid")

    count: Annotated[int, Field(strict=True, ge=1, le=MOST_PICTURES), WHOLE]


class FieldViewWish(BaseModel):
    """Where to see the field from while it is trained.

    ``azimuth_rad`` is counter-clockwise from the world's +X about the object's middle,
    ``elevation_rad`` above it, ``distance`` a share of the pictures' median distance.
    """

    model_config = ConfigDict(extra="forbid")

    azimuth_rad: Number = Field(ge=-1e4, le=1e4)
    elevation_rad: Number = Field(ge=-1.5, le=1.5)
    distance: Number = Field(default=1.0, ge=0.2, le=4.0)


class CaptureView(BaseModel):
    """A capture as it stands."""

    id: str
    state: CaptureState
    phase: str
    progress: float
    eta_s: float | None
    run: str
    error: str | None
    mode: str
    name: str
    round_index: int
    rounds: int
    images: int
    images_total: int
    overrides: dict[str, str]
    started_at: datetime
    updated_at: datetime
    metrics: dict[str, object] | None
    starred: bool


def view_from_record(record: CaptureRecord) -> CaptureView:
    """Return what the console tells about a capture."""
    status = record.status
    metrics = None if record.metrics is None else json_safe(record.metrics)
    return CaptureView(
        id=status.id,
        # The event's state is a plain word; the view checks that it is one of ours.
        state=cast(CaptureState, status.state),
        phase=status.phase,
        progress=status.progress,
        eta_s=status.eta_s,
        run=status.run,
        error=status.error,
        mode=status.mode,
        name=record.request.name,
        round_index=status.round_index,
        rounds=status.rounds,
        images=status.images,
        images_total=status.images_total,
        overrides=dict(record.request.overrides),
        started_at=record.started_at,
        updated_at=status.at,
        metrics=cast("dict[str, object] | None", metrics),
        starred=is_starred(Path(status.run)),
    )


def make_captures_router(
    mission: MissionControl, desk: CommandDesk, book: JobBook, busy: BusyCaptures
) -> APIRouter:
    """Return the routes below ``/captures``."""
    router = APIRouter(prefix=_PREFIX, tags=["captures"])
    admitted = Depends(desk.admit)

    @router.post(
        "",
        operation_id="startCapture",
        status_code=202,
        responses=described(409, 422),
    )
    async def start_capture(
        response: Response,
        spec: Annotated[CaptureSpec | None, Body()] = None,
        client: str = admitted,
    ) -> CaptureView:
        """Begin a capture; one runs at a time."""
        asked = spec or CaptureSpec()
        request = CaptureRequest(
            mode=asked.mode,
            drones=asked.drones,
            pictures=asked.pictures,
            train_seconds=asked.train_seconds,
            name=asked.name,
            seed=asked.seed,
            overrides=asked.overrides,
        )
        try:
            record = await mission.start_capture(request)
        except ValueError as error:
            # Within the bounds of every fleet, but not of this one.
            raise RefusedError(str(error)) from error
        desk.note_flight(client)
        response.headers["Location"] = f"{_PREFIX}/{quote(record.status.id, safe='')}"
        return view_from_record(record)

    @router.get("", operation_id="listCaptures", responses={200: PAGED, **described(422)})
    async def list_captures(
        response: Response,
        state: CaptureState | None = None,
        limit: Limit = 200,
        cursor: Cursor = None,
    ) -> list[CaptureView]:
        """Return the known captures, newest first."""
        found = (r for r in mission.captures() if state in (None, r.status.state))
        page, after = page_of(found, lambda record: record.status.id, limit, cursor)
        link_next(response, _PREFIX, after, limit=limit, state=state)
        return [view_from_record(record) for record in page]

    @router.get("/{capture_id}", operation_id="getCapture", responses=described(404))
    async def get_capture(capture_id: str) -> CaptureView:
        """Return one capture."""
        return view_from_record(mission.capture(capture_id))

    @router.delete(
        "/{capture_id}",
        operation_id="deleteCapture",
        status_code=204,
        responses=described(404, 409),
    )
    async def delete_capture(capture_id: str) -> Response:
        """Delete a capture that is over, its files and the fields trained anew on it, for good."""
        mission.capture(capture_id)
        for run_id, job in book.trainings_on(capture_id).items():
            if not job.over:
                raise RefusedError(f"{run_id} trains on it; cancel that or wait for its end")
        with busy.hold(capture_id, "is being deleted"):
            try:
                await mission.delete_capture(capture_id)
            except StillTrainedError as error:
                raise RefusedError(str(error)) from error
        return Response(status_code=204)

    @router.put(
        "/{capture_id}/star",
        operation_id="starCapture",
        status_code=204,
        responses=described(404, 409),
    )
    async def star_capture(capture_id: str) -> Response:
        """Keep it: retention deletes no capture with a star."""
        await _star(mission.capture(capture_id), True)
        return Response(status_code=204)

    @router.delete(
        "/{capture_id}/star",
        operation_id="unstarCapture",
        status_code=204,
        responses=described(404, 409),
    )
    async def unstar_capture(capture_id: str) -> Response:
        """Let retention have it again."""
        await _star(mission.capture(capture_id), False)
        return Response(status_code=204)

    @router.get("/{capture_id}/metrics", operation_id="getCaptureMetrics", responses=described(404))
    async def get_metrics(capture_id: str) -> dict[str, object]:
        """Return how well held-out pictures were reproduced, once that was measured."""
        view = view_from_record(mission.capture(capture_id))
        if view.metrics is None:
            raise ProblemError(404, f"{capture_id} has no metrics yet", "no_metrics")
        return view.metrics

    # Whoever sees a danger may let the drones hover or land; flying on is for who is in command.
    @router.post("/{capture_id}/pause", operation_id="pauseCapture", responses=described(404, 409))
    async def pause_capture(capture_id: str) -> CaptureView:
        """Hold position and stop the mission's clock."""
        return view_from_record(await mission.pause_capture(capture_id))

    @router.post(
        "/{capture_id}/resume",
        operation_id="resumeCapture",
        responses=described(404, 409),
    )
    async def resume_capture(capture_id: str, client: str = admitted) -> CaptureView:
        """Go on with a paused capture."""
        with busy.hold(capture_id, "is being resumed"):
            record = await mission.resume_capture(capture_id)
        desk.note_flight(client)
        return view_from_record(record)

    @router.post(
        "/{capture_id}/pictures",
        operation_id="addPictures",
        responses=described(404, 409, 422),
    )
    async def add_pictures(
        capture_id: str, more: MorePictures, client: str = admitted
    ) -> CaptureView:
        """Take more pictures than was asked for, from where they add most to those taken."""
        record = await mission.add_pictures(capture_id, more.count)
        desk.note_flight(client)
        return view_from_record(record)

    @router.put(
        "/{capture_id}/view",
        operation_id="viewField",
        status_code=204,
        responses=described(404, 409, 422),
    )
    async def view_field(capture_id: str, wish: FieldViewWish) -> Response:
        """See the field from here while it is trained; all who watch see the same."""
        view = FieldView(wish.azimuth_rad, wish.elevation_rad, wish.distance)
        await mission.view_field(capture_id, view)
        return Response(status_code=204)

    @router.delete(
        "/{capture_id}/view",
        operation_id="orbitField",
        status_code=204,
        responses=described(404, 409),
    )
    async def orbit_field(capture_id: str) -> Response:
        """Let the view go round the object again."""
        await mission.view_field(capture_id, None)
        return Response(status_code=204)

    @router.post("/{capture_id}/abort", operation_id="abortCapture", responses=described(404, 409))
    async def abort_capture(capture_id: str) -> CaptureView:
        """Land all drones and end; what was taken stays."""
        return view_from_record(await mission.abort_capture(capture_id))

    return router


async def _star(record: CaptureRecord, starred: bool) -> None:
    try:
        # It waits for the disk, which the loop that flies must not.
        await asyncio.to_thread(star_run, Path(record.status.run), starred)
    except OSError as error:
        raise RefusedError(f"{record.status.run}: {error.strerror}") from error
