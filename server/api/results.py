"""What captures left behind: the event log, the newest plan, reconstructions and their files."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.captures import CaptureView, view_from_record
from server.api.conditions import WholeFile, answer_if_wanted
from server.api.files import FoundFile, files_below, inside
from server.api.journal import Journal, KnownPlan
from server.api.messages import Note
from server.api.paging import (
    PAGED,
    Cursor,
    Limit,
    link_next,
    page_of,
)
from server.api.problems import described, json_safe
from server.api.translate import message_from_event
from server.mission.commands import MissionControl, UnknownError
from server.mission.events import Coverage, PlanProgressed, PlanViewChosen
from server.stages import Assignment

_SHOWN_INLINE = frozenset({".jpg", ".jpeg", ".png", ".mp4", ".json", ".jsonl", ".txt"})
_TYPES = {
    ".jsonl": "application/x-ndjson",
    ".glb": "model/gltf-binary",
    ".mcap": "application/octet-stream",
}


_FILE_ANSWERS: dict[int | str, dict[str, object]] = {
    200: {"content": {"application/octet-stream": {}}, "description": "The file"},
    206: {"content": {"application/octet-stream": {}}, "description": "The ranges asked for"},
    304: {"description": "It is still the one that the condition names"},
    416: {"content": {"text/plain": {}}, "description": "The file has no such range"},
}


# A list, not a tuple: many readers of the OpenAPI document know no other arrays.
Place = Annotated[list[float], Field(min_length=3, max_length=3)]


class LogLine(Note):
    """A line of the event log with its place in it."""

    sequence: int


class EventLog(BaseModel):
    """Part of the event log; ask again with ``since`` = ``next``."""

    events: list[LogLine]
    next: int


class PlannedViewpoint(BaseModel):
    """Where a drone takes a picture: world metres and radians."""

    round_index: int
    drone_id: str
    position_world: Place
    yaw_rad: float


class AnnealingStep(BaseModel):
    """One report of the annealing: moves so far, temperature, best fitness."""

    iteration: int
    temperature: float | None
    fitness: float | None


class CoverageView(BaseModel):
    """Shares of the object's surface that at least one and at least three pictures show."""

    once: float
    thrice: float


class PlanView(BaseModel):
    """A placement and who flies where; ``bound`` is the most any choice could reach.

    ``annealing`` is how it was found, empty for the ring. ``ring`` is the standard ring around the
    same object, to compare with; empty where it is what was chosen, or where it does not fit.
    ``expected`` is what all pictures will show when those planned are taken, ``ring_expected`` what
    the ring would show.
    """

    capture_id: str | None
    at: datetime
    fitness: float | None
    terms: dict[str, float | None]
    candidates: int
    bound: float | None
    viewpoints: list[PlannedViewpoint]
    annealing: list[AnnealingStep]
    ring: list[PlannedViewpoint]
    expected: CoverageView | None
    ring_expected: CoverageView | None


class PlanViewChoice(BaseModel):
    """Which viewpoints the 3D scene shows: those planned, the standard ring, or both."""

    model_config = ConfigDict(extra="forbid")

    shown: Literal["planned", "ring", "both"]


class Artifact(BaseModel):
    """A file of a run."""

    capture_id: str
    path: str
    size_bytes: int
    modified_at: datetime
    url: str


def make_results_router(mission: MissionControl, journal: Journal, prefix: str) -> APIRouter:
    """Return the routes ``/events``, ``/plans``, ``/reconstructions`` and ``/artifacts``.

    Addresses of files begin with ``prefix``, the path that a proxy puts before all of ours.
    """
    router = APIRouter(prefix="/api/v1", tags=["results"])

    @router.get("/events", operation_id="listEvents", responses=described(422))
    async def list_events(
        since: Annotated[int, Query(ge=0)] = 0, limit: Annotated[int, Query(ge=1, le=1000)] = 1000
    ) -> EventLog:
        """Return kept lines of the event log after number ``since``, oldest first."""
        lines = []
        for line in journal.since(since, limit):
            note = message_from_event(line.note)
            if note is not None:
                lines.append(LogLine(**note.model_dump(), sequence=line.sequence))
        return EventLog(events=lines, next=lines[-1].sequence if lines else since)

    @router.get("/plans", operation_id="listPlans", responses=described())
    async def list_plans() -> list[PlanView]:
        """Return the newest capture's newest plan; empty before there is one."""
        if journal.plan is None:
            return []
        return [_plan_view(journal.plan, journal.annealing)]

    @router.put(
        "/plans/view", operation_id="choosePlanView", status_code=204, responses=described(422)
    )
    async def choose_plan_view(choice: PlanViewChoice) -> Response:
        """Choose which viewpoints the 3D scene shows; it is one scene for all who look."""
        mission.events.publish(PlanViewChosen(choice.shown))
        return Response(status_code=204)

    @router.get(
        "/reconstructions",
        operation_id="listReconstructions",
        responses={200: PAGED, **described(422)},
    )
    async def list_reconstructions(
        response: Response, limit: Limit = 200, cursor: Cursor = None
    ) -> list[CaptureView]:
        """Return the captures whose field was judged, newest first."""
        judged = (r for r in mission.captures() if r.metrics is not None)
        page, after = page_of(judged, lambda record: record.status.id, limit, cursor)
        link_next(response, "/api/v1/reconstructions", after, limit=limit)
        return [view_from_record(record) for record in page]

    @router.get(
        "/artifacts",
        operation_id="listArtifacts",
        responses={200: PAGED, **described(404, 422)},
    )
    async def list_artifacts(
        response: Response,
        capture: Annotated[str | None, Query(description="Only this capture's files.")] = None,
        limit: Limit = 1000,
        cursor: Cursor = None,
    ) -> list[Artifact]:
        """Return the files of one capture, or of all, newest capture first."""
        ids = [r.status.id for r in mission.captures()] if capture is None else [capture]
        begin, _, after = (cursor or "").partition("/")
        artifacts: list[Artifact] = []
        for capture_id in ids:
            if begin and capture_id > begin:
                continue
            folder = mission.run_folder(capture_id)
            room = limit + 1 - len(artifacts)
            if room > 0 and folder.is_dir():
                seen = after if capture_id == begin else ""
                found = await asyncio.to_thread(files_below, folder, room, seen)
                artifacts += [artifact_of(capture_id, file, prefix) for file in found]
        if len(artifacts) > limit:
            last = artifacts[limit - 1]
            seen = f"{last.capture_id}/{last.path}"
            link_next(response, "/api/v1/artifacts", seen, limit=limit, capture=capture)
        return artifacts[:limit]

    @router.get(
        "/artifacts/{capture_id}/{path:path}",
        operation_id="getArtifact",
        response_class=FileResponse,
        responses=_FILE_ANSWERS | described(404, 412),
    )
    async def get_artifact(request: Request, capture_id: str, path: str) -> Response:
        """Return one file of a run; knows ranges, and conditions by ETag or date."""
        file = await asyncio.to_thread(inside, mission.run_folder(capture_id), path)
        if file is None:
            raise UnknownError(f"{capture_id} has no file {path!r}")
        return answer_if_wanted(request.headers, await asyncio.to_thread(_file_response, file))

    return router


def artifact_of(capture_id: str, file: FoundFile, prefix: str) -> Artifact:
    """Return what is told of a run's file; its address begins with ``prefix``."""
    return Artifact(
        capture_id=capture_id,
        path=file.path,
        size_bytes=file.size_bytes,
        modified_at=file.modified_at,
        url=f"{prefix}/api/v1/artifacts/{quote(capture_id, safe='')}/{quote(file.path)}",
    )


def _file_response(file: Path) -> WholeFile:
    suffix = file.suffix.lower()
    # A run folder can hold anything: what a browser might execute is handed out as a download.
    disposition = "inline" if suffix in _SHOWN_INLINE else "attachment"
    return WholeFile(
        file,
        media_type=_TYPES.get(suffix),
        filename=file.name,
        content_disposition_type=disposition,
        # Given here, size, date and ETag are headers from the start.
        stat_result=file.stat(),
        headers={"Cache-Control": "no-cache"},
    )


def _plan_view(plan: KnownPlan, annealing: list[PlanProgressed]) -> PlanView:
    placement = plan.found.placement
    return PlanView.model_validate(
        json_safe(
            {
                "capture_id": plan.capture_id,
                "at": plan.found.at,
                "fitness": placement.fitness,
                "terms": {name: float(value) for name, value in placement.terms.items()},
                "candidates": placement.candidates,
                "bound": placement.bound,
                "annealing": [
                    {
                        "iteration": step.iteration,
                        "temperature": step.temperature,
                        "fitness": step.fitness,
                    }
                    for step in annealing
                ],
                "viewpoints": _viewpoints(plan.found.assignment),
                "ring": [] if plan.found.ring is None else _viewpoints(plan.found.ring),
                "expected": _coverage(plan.found.expected),
                "ring_expected": _coverage(plan.found.ring_expected),
            }
        )
    )


def _coverage(coverage: Coverage | None) -> dict[str, float] | None:
    return None if coverage is None else asdict(coverage)


def _viewpoints(assignment: Assignment) -> list[dict[str, object]]:
    return [
        PlannedViewpoint(
            round_index=index,
            drone_id=drone_id,
            position_world=[float(value) for value in viewpoint.position_world],
            yaw_rad=float(viewpoint.yaw_rad),
        ).model_dump()
        for index, assigned in enumerate(assignment.rounds)
        for drone_id, viewpoint in assigned.items()
    ]
