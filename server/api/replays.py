"""The recording of a capture, made ready for a browser: ``/captures/{id}/replay``."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal
from urllib.parse import quote

from fastapi import APIRouter
from pydantic import BaseModel, Field

from server.api.problems import described
from server.mission.commands import MissionControl, RefusedError, UnknownError
from server.mission.flight_recording import RECORDING
from server.recording.reading import RecordingError
from server.recording.reel import CONTENTS, FOLDER, make_reel

_ACTIVE = frozenset({"queued", "running", "paused"})


# Lists, not tuples: many readers of the OpenAPI document know no other arrays.
WayPoint = Annotated[list[float], Field(min_length=5, max_length=5)]
Corner = Annotated[list[float], Field(min_length=3, max_length=3)]
Corners = Annotated[list[Corner], Field(min_length=2, max_length=2)]


class DroneReplay(BaseModel):
    """What there is to see of one drone.

    ``film`` is the address of its video, which begins at ``begins_s``; ``way`` its believed camera
    poses ``[at_s, x, y, z, heading]``, world metres and radians.
    """

    drone_id: str
    film: str | None
    begins_s: float
    way: list[WayPoint]


class ReplayMoment(BaseModel):
    """Something that happened: a log line, or a ``picture`` with its number as ``text``."""

    at_s: float
    kind: Literal["picture", "info", "warning", "error"]
    drone_id: str
    text: str


class ReplayView(BaseModel):
    """A recording; times ``at_s`` are seconds since its first picture."""

    seconds: float
    drones: list[DroneReplay]
    moments: list[ReplayMoment]
    object_box: Corners | None


class ReplayProgress(BaseModel):
    """How much of a recording has been read, 0 to 1; null while nobody reads it."""

    share: float | None


def make_replays_router(mission: MissionControl) -> APIRouter:
    """Return the routes ``/captures/{capture_id}/replay`` and ``replay/progress``."""
    router = APIRouter(prefix="/api/v1/captures", tags=["results"])
    # One at a time: two for the same capture would write the same files.
    cutting = asyncio.Lock()
    shares: dict[str, float] = {}

    @router.get(
        "/{capture_id}/replay", operation_id="getCaptureReplay", responses=described(404, 409)
    )
    async def get_replay(capture_id: str) -> ReplayView:
        """Return what a capture's recording shows; the first time its films are made for it."""
        run = mission.run_folder(capture_id)
        contents = run / FOLDER / CONTENTS
        async with cutting:
            if not contents.is_file():
                await asyncio.to_thread(_refuse_without_recording, run)
                # Reading a recording takes the processor from those who fly.
                if any(record.status.state in _ACTIVE for record in mission.captures()):
                    raise RefusedError("a capture is under way; its recording can be shown later")
                shares[capture_id] = 0.0
                try:
                    await _make(run, partial(shares.__setitem__, capture_id))
                finally:
                    del shares[capture_id]
        text = await asyncio.to_thread(contents.read_text)
        view = ReplayView.model_validate_json(text)
        for drone in view.drones:
            if drone.film is not None:
                drone.film = f"/api/v1/artifacts/{quote(capture_id, safe='')}/{FOLDER}/{drone.film}"
        return view

    @router.get(
        "/{capture_id}/replay/progress",
        operation_id="getCaptureReplayProgress",
        responses=described(404),
    )
    async def get_progress(capture_id: str) -> ReplayProgress:
        """Return how far the films are that somebody waits for."""
        mission.run_folder(capture_id)
        return ReplayProgress(share=shares.get(capture_id))

    return router


def _refuse_without_recording(run: Path) -> None:
    if not (run / RECORDING).is_file():
        raise UnknownError(f"{run.name} has no recording")


async def _make(run: Path, on_share: Callable[[float], None]) -> None:
    loop = asyncio.get_running_loop()

    def tell(share: float) -> None:
        loop.call_soon_threadsafe(on_share, share)

    try:
        await asyncio.to_thread(make_reel, run / RECORDING, run, tell)
    except (RecordingError, OSError) as error:
        why = str(error).replace(str(run / RECORDING), "the file")
        raise RefusedError(f"the recording cannot be shown: {why}") from error
