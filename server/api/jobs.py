"""Jobs: planning and training as they run in the background; and a training anew."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.json_numbers import WHOLE, Number
from server.api.paging import PAGED, Cursor, Limit, link_next, page_of
from server.api.problems import ProblemError, described, json_safe
from server.jobs.book import JobBook, JobRecord, JobState
from server.jobs.spec import JobSpec, Kind
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import MissionControl, RefusedError, UnknownError
from server.store.runs import free_run

JOBS = "/api/v1/jobs"
_UNFINISHED = ("queued", "running", "paused")


class JobView(BaseModel):
    """A job as it stands.

    ``progress`` is the share of ``phase`` done, 0 to 1; ``run`` is the folder of the run that it
    works for, ``capture`` the one whose pictures it trains on; ``result`` is what it ended with.
    """

    model_config = ConfigDict(from_attributes=True)

    id: str
    kind: Kind
    state: JobState
    phase: str
    progress: float
    run: str
    capture: str | None
    error: str | None
    created_at: datetime
    updated_at: datetime
    result: dict[str, object] | None


class TrainingSpec(BaseModel):
    """A training anew, on the pictures and poses of a capture that is over.

    Its results go into a run folder of their own, beside the capture's.
    """

    model_config = ConfigDict(extra="forbid")

    capture: Annotated[str, Field(min_length=1, max_length=120)]
    seconds: Annotated[Number, Field(ge=1.0, le=86_400.0)] = 60.0
    object_only: Annotated[bool, Field(strict=True)] = False
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32), WHOLE] = 0


def view_from_job(record: JobRecord) -> JobView:
    """Return what the console tells about a job."""
    view = JobView.model_validate(record)
    return view.model_copy(update={"result": json_safe(record.result)})


def make_jobs_router(mission: MissionControl, book: JobBook, busy: BusyCaptures) -> APIRouter:
    """Return the routes below ``/jobs``, and the one that asks for a training."""
    router = APIRouter(prefix="/api/v1", tags=["jobs"])

    def known(job_id: str) -> JobRecord:
        try:
            return book.job(job_id)
        except KeyError:
            raise UnknownError(f"there is no job {job_id!r}") from None

    @router.get("/jobs", operation_id="listJobs", responses={200: PAGED, **described(422)})
    async def list_jobs(
        response: Response,
        state: JobState | None = None,
        limit: Limit = 200,
        cursor: Cursor = None,
    ) -> list[JobView]:
        """Return the jobs since the console's start, newest first."""
        found = (job for job in book.jobs() if state in (None, job.state))
        page, after = page_of(found, lambda job: job.id, limit, cursor)
        link_next(response, JOBS, after, limit=limit, state=state)
        return [view_from_job(job) for job in page]

    @router.get("/jobs/{job_id}", operation_id="getJob", responses=described(404))
    async def get_job(job_id: str) -> JobView:
        """Return one job."""
        return view_from_job(known(job_id))

    @router.post("/jobs/{job_id}/cancel", operation_id="cancelJob", responses=described(404))
    async def cancel_job(job_id: str) -> JobView:
        """End a job; one that is over stays as it is."""
        known(job_id)
        return view_from_job(await book.cancel(job_id))

    @router.post(
        "/reconstructions",
        operation_id="startReconstruction",
        status_code=202,
        responses=described(404, 409, 422),
    )
    async def start_reconstruction(spec: TrainingSpec, response: Response) -> JobView:
        """Train anew on a capture; trainings wait for each other, and never run beside a flight."""
        mission.capture(spec.capture)
        busy.refuse(spec.capture)
        for record in mission.captures():
            if record.status.state in _UNFINISHED:
                raise RefusedError(
                    f"{record.status.id} is {record.status.state} and needs the processors; "
                    "wait for its end"
                )
        dataset = mission.run_folder(spec.capture).resolve()
        if not (dataset / "transforms.json").is_file():
            raise RefusedError(f"{spec.capture} has no pictures with poses")
        # Several may be asked for in the same second.
        out = free_run(dataset.parent, f"train {spec.capture}", book.at_work())
        try:
            job = book.request(_training(spec, dataset, out), out / "jobs" / "reconstruct", out)
        except ValueError as error:
            raise ProblemError(409, str(error), "refused") from error
        response.headers["Location"] = f"{JOBS}/{quote(job.id, safe='')}"
        return view_from_job(job)

    return router


def _training(spec: TrainingSpec, dataset: Path, out: Path) -> JobSpec:
    parameters = {
        "source": "dataset",
        "dataset": str(dataset),
        "out": str(out),
        "train_seconds": spec.seconds,
        "object_only": spec.object_only,
    }
    return JobSpec("reconstruct", parameters, seed=spec.seed, threads=os.cpu_count() or 1)
