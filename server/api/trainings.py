"""The fields trained anew on a capture's pictures: what there is, and deleting one.

The list is read from the run folders, so a console that was started anew shows the same; what is
under way at the moment is told by the book of jobs.
"""

from __future__ import annotations

import asyncio
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, cast

from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import BaseModel

from server.api.files import FoundFile, files_below
from server.api.paging import PAGED, Cursor, Limit, link_next, page_of
from server.api.problems import described, json_safe
from server.api.results import Artifact, artifact_of
from server.jobs.book import JobBook, JobRecord
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import MissionControl, RefusedError, UnknownError
from server.store.deletion import StillTrainedError, doom_training
from server.store.row import RunRow, changed_unix_s, read_row
from server.store.trainings import Training, read_training, training_asked_for, trainings_on

TrainingState = Literal["queued", "running", "succeeded", "failed", "cancelled", "interrupted"]
_MOST_FILES = 200


class TrainingView(BaseModel):
    """A field trained anew, as it stands.

    ``id`` is its run's, by which ``artifacts`` has its files; ``files`` are the first of them.
    ``seconds`` and ``seed`` are what was asked for, null where the run does not tell, ``metrics``
    what the judgement found. ``job`` can be cancelled; it is null once it is over, and for a
    training that this console did not start. ``progress`` is the share of ``phase`` done, 0 to 1,
    as of ``updated_at``; ``ahead`` is how many trainings come before one that waits.
    """

    id: str
    capture: str
    state: TrainingState
    phase: str
    progress: float
    error: str | None
    job: str | None
    ahead: int
    created_at: datetime
    updated_at: datetime
    seconds: float | None
    seed: int | None
    object_only: bool
    metrics: dict[str, object] | None
    size_bytes: int
    files: list[Artifact]


@dataclass(frozen=True, slots=True)
class _Kept:
    """A training's run folder."""

    row: RunRow
    training: Training
    changed_unix_s: float
    files: list[FoundFile]


def make_trainings_router(
    mission: MissionControl, book: JobBook, busy: BusyCaptures, prefix: str
) -> APIRouter:
    """Return the routes ``/captures/{id}/trainings``.

    Addresses of files begin with ``prefix``, the path that a proxy puts before all of ours.
    """
    router = APIRouter(prefix="/api/v1/captures", tags=["results"])

    @router.get(
        "/{capture_id}/trainings",
        operation_id="listTrainings",
        responses={200: PAGED, **described(404, 422)},
    )
    async def list_trainings(
        capture_id: str, response: Response, limit: Limit = 200, cursor: Cursor = None
    ) -> list[TrainingView]:
        """Return the fields trained anew on a capture's pictures, newest first."""
        mission.capture(capture_id)
        folders = await asyncio.to_thread(trainings_on, mission.run_folder(capture_id))
        places = {folder.name: folder for folder in folders}
        jobs = book.trainings_on(capture_id)
        ids = sorted({*places, *jobs}, reverse=True)
        page, after = page_of(ids, str, limit, cursor)
        link_next(response, f"/api/v1/captures/{capture_id}/trainings", after, limit=limit)
        shown = [places[each] for each in page if each in places]
        kept = await asyncio.to_thread(_read, shown)
        views = (_view(each, capture_id, kept.get(each), jobs.get(each), prefix) for each in page)
        return [_placed(view, jobs.get(view.id), book) for view in views if view is not None]

    @router.delete(
        "/{capture_id}/trainings/{training_id}",
        operation_id="deleteTraining",
        status_code=204,
        responses=described(404, 409),
    )
    async def delete_one(capture_id: str, training_id: str) -> Response:
        """Delete a field trained anew, and all its files, for good; the capture stays."""
        mission.capture(capture_id)
        with busy.hold(capture_id, "is losing a training"):
            doomed = await _doom(capture_id, training_id)
        try:
            await asyncio.to_thread(shutil.rmtree, doomed)
        except OSError as error:
            raise RefusedError(f"not all of it could be deleted: {error}") from error
        return Response(status_code=204)

    async def _doom(capture_id: str, training_id: str) -> Path:
        if training_id in book.at_work():
            raise RefusedError("this training is not over; cancel it first")
        folders = await asyncio.to_thread(trainings_on, mission.run_folder(capture_id))
        folder = next((each for each in folders if each.name == training_id), None)
        if folder is None:
            raise UnknownError(f"no training {training_id!r} on {capture_id}")
        try:
            return await asyncio.to_thread(doom_training, folder)
        except StillTrainedError as error:
            raise RefusedError(str(error)) from error
        except (OSError, ValueError) as error:
            raise RefusedError(f"{training_id} cannot be deleted: {error}") from error

    return router


def _read(folders: list[Path]) -> dict[str, _Kept]:
    kept: dict[str, _Kept] = {}
    for folder in folders:
        row, training = read_row(folder), read_training(folder)
        if row is not None and training is not None:
            ended = row.ended_unix_s
            changed = changed_unix_s(folder) if ended is None else ended
            kept[row.id] = _Kept(row, training, changed, files_below(folder, _MOST_FILES))
    return kept


def _view(
    training_id: str, capture_id: str, kept: _Kept | None, job: JobRecord | None, prefix: str
) -> TrainingView | None:
    """Return what is told of a training; None for one that is over and has left no folder."""
    if kept is not None:
        view = _from_folder(capture_id, kept, prefix)
    elif job is not None and not job.over:
        view = _from_job(training_id, capture_id, job)
    else:
        return None
    if job is None or (job.over and view.state == "succeeded"):
        return view  # It may have been gone on with since.
    now = {
        "state": job.state,
        "phase": job.phase,
        "progress": job.progress,
        "error": job.error,
        "created_at": job.created_at,
        "updated_at": job.updated_at,
    }
    return view.model_copy(update=now | {"job": None if job.over else job.id})


def _placed(view: TrainingView, job: JobRecord | None, book: JobBook) -> TrainingView:
    """Return a training with its place in the queue."""
    if job is None or job.state != "queued":
        return view
    return view.model_copy(update={"ahead": book.ahead_of(job.id)})


def _from_folder(capture_id: str, kept: _Kept, prefix: str) -> TrainingView:
    row, training = kept.row, kept.training
    return TrainingView(
        id=row.id,
        capture=capture_id,
        state=cast(TrainingState, row.state),
        phase="",
        progress=1.0 if training.finished else 0.0,
        error=training.error,
        job=None,
        ahead=0,
        created_at=datetime.fromtimestamp(row.begun_unix_s, UTC),
        updated_at=datetime.fromtimestamp(kept.changed_unix_s, UTC),
        seconds=training.seconds,
        seed=training.seed,
        object_only=training.object_only,
        metrics=cast("dict[str, object] | None", json_safe(training.metrics)),
        size_bytes=row.size_bytes,
        files=[artifact_of(row.id, file, prefix) for file in kept.files],
    )


def _from_job(training_id: str, capture_id: str, job: JobRecord) -> TrainingView:
    """Return a training that waits: it has no folder yet."""
    asked = training_asked_for(job.spec.parameters, job.spec.seed)
    return TrainingView(
        id=training_id,
        capture=capture_id,
        state=job.state,
        phase=job.phase,
        progress=job.progress,
        error=job.error,
        job=job.id,
        ahead=0,
        created_at=job.created_at,
        updated_at=job.updated_at,
        seconds=asked.seconds,
        seed=asked.seed,
        object_only=asked.object_only,
        metrics=None,
        size_bytes=0,
        files=[],
    )
