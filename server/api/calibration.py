"""The calibration of a drone's camera: started, watched, finished and used."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Depends
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.command import CommandDesk
from server.api.problems import described
from server.mission.calibration_record import (
    Applied,
    CalibrationRecord,
    CalibrationResult,
    CalibrationState,
    Ending,
    Hint,
    Lack,
    SheetForm,
)
from server.mission.commands import MissionControl, UnknownError

_DAY_S = 86_400


class CalibrationWish(BaseModel):
    """How to begin; with ``go_on`` the views of the calibration before count, too."""

    model_config = ConfigDict(extra="forbid")

    go_on: Annotated[bool, Field(strict=True)] = False


class CalibratedCamera(BaseModel):
    """A camera as its views have it: pixels of ``width`` x ``height``, OpenCV's distortion.

    ``fx_sd`` is the standard deviation of ``fx``; ``mean_px`` and ``rms_px`` are the reprojection
    error; ``coverage`` is the share of the picture that kept views reach, ``tilts_deg`` how far
    they are tilted at most, sideways and up or down; ``terms_fixed`` are distortion terms that
    could not be told from zero. ``toml`` is the same as a piece of a fleet file.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    fx_sd: float
    distortion: list[float]
    terms_fixed: list[str]
    mean_px: float
    rms_px: float
    views_kept: int
    views_dropped: int
    coverage: float
    tilts_deg: tuple[float, float]
    toml: str


class CalibrationUse(BaseModel):
    """A result that the console uses since; ``file`` has it too, or ``problem`` says why not.

    ``backup`` is the file as it was before; all three are null or empty without a fleet file.
    """

    file: str | None
    backup: str | None
    problem: str


class CalibrationView(BaseModel):
    """The newest calibration of a camera.

    ``coverage`` counts, row by row, the corners of kept views in each cell of the picture.
    ``tilted`` says how many views are tilted sideways and how many up or down, of
    ``tilted_wanted`` each. ``hint`` is what to do next, null while no picture comes. ``lack`` is
    what views of a refused one lack, ``ending`` why one ended without a result, ``reason`` either
    for people. ``file`` is the fleet file that a result would be written into.
    """

    drone_id: str
    state: CalibrationState
    board: str
    views: int
    views_wanted: int
    views_least: int
    coverage: list[list[int]]
    tilted: tuple[int, int]
    tilted_wanted: int
    hint: Hint | None
    spent_s: float
    lack: Lack | None
    ending: Ending | None
    reason: str
    result: CalibratedCamera | None
    applied: CalibrationUse | None
    file: str | None


def view_from_calibration(record: CalibrationRecord) -> CalibrationView:
    """Return what the console tells about a calibration."""
    now = record.progress
    return CalibrationView(
        drone_id=record.drone_id,
        state=record.state,
        board=record.board,
        views=now.views,
        views_wanted=record.views_wanted,
        views_least=record.views_least,
        coverage=now.coverage.tolist(),
        tilted=now.tilted,
        tilted_wanted=now.tilted_wanted,
        hint=record.hint,
        spent_s=record.spent_s,
        lack=record.lack,
        ending=record.ending,
        reason=record.reason,
        result=None if record.result is None else _camera(record.result),
        applied=None if record.applied is None else _use(record.applied),
        file=None if record.file is None else str(record.file),
    )


def _camera(result: CalibrationResult) -> CalibratedCamera:
    found = result.calibration
    camera = found.intrinsics
    sideways, up_down = abs(found.tilts_deg).max(axis=0).tolist()
    return CalibratedCamera(
        width=camera.width,
        height=camera.height,
        fx=camera.fx,
        fy=camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        fx_sd=float(found.deviations[0]),
        distortion=list(camera.distortion),
        terms_fixed=list(found.fixed),
        mean_px=found.mean_px,
        rms_px=found.rms_px,
        views_kept=len(found.views),
        views_dropped=len(found.dropped),
        coverage=float((found.coverage > 0).mean()),
        tilts_deg=(sideways, up_down),
        toml=result.toml,
    )


def _use(applied: Applied) -> CalibrationUse:
    return CalibrationUse(
        file=None if applied.file is None else str(applied.file),
        backup=None if applied.backup is None else str(applied.backup),
        problem=applied.problem,
    )


def make_calibration_router(mission: MissionControl, desk: CommandDesk) -> APIRouter:
    """Return the routes below ``/drones/{id}/calibration``."""
    router = APIRouter(prefix="/api/v1/drones/{drone_id}/calibration", tags=["calibration"])
    # It needs the drone on the ground: whoever flies them decides.
    admitted = Depends(desk.admit)

    @router.get("", operation_id="getCalibration", responses=described(404))
    async def get_calibration(drone_id: str) -> CalibrationView:
        """Return the newest calibration of a drone's camera, ``idle`` before the first."""
        return view_from_calibration(mission.calibrations.record(drone_id))

    @router.post(
        "",
        operation_id="startCalibration",
        status_code=202,
        responses=described(404, 409, 422),
        dependencies=[admitted],
    )
    async def start_calibration(
        drone_id: str, wish: CalibrationWish | None = None
    ) -> CalibrationView:
        """Begin to collect views of the board from a drone that stands, or is held by hand."""
        go_on = wish is not None and wish.go_on
        return view_from_calibration(mission.calibrations.start(drone_id, go_on=go_on))

    @router.post(
        "/finish",
        operation_id="finishCalibration",
        status_code=202,
        responses=described(404, 409),
        dependencies=[admitted],
    )
    async def finish_calibration(drone_id: str) -> CalibrationView:
        """Collect no more views and work the camera out."""
        return view_from_calibration(mission.calibrations.finish(drone_id))

    @router.post(
        "/apply",
        operation_id="applyCalibration",
        responses=described(404, 409),
        dependencies=[admitted],
    )
    async def apply_calibration(drone_id: str) -> CalibrationView:
        """Use the result from now on, and write it into the console's fleet file if it has one."""
        return view_from_calibration(await mission.calibrations.apply(drone_id))

    @router.delete(
        "",
        operation_id="cancelCalibration",
        responses=described(404, 409),
        dependencies=[admitted],
    )
    async def cancel_calibration(drone_id: str) -> CalibrationView:
        """End it without a result; of one that is over, forget the result."""
        return view_from_calibration(mission.calibrations.cancel(drone_id))

    async def sheet(drone_id: str, form: SheetForm, media_type: str) -> Response:
        mission.calibrations.record(drone_id)  # Raises for a drone there is not.
        data = await asyncio.to_thread(mission.calibrations.sheet, form)
        headers = {
            "Cache-Control": f"private, max-age={_DAY_S}",
            "Content-Disposition": f'inline; filename="dronerf-board.{form}"',
        }
        return Response(data, media_type=media_type, headers=headers)

    @router.get(
        "/board.png",
        operation_id="getCalibrationBoard",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}, **described(404)},
    )
    async def get_board(drone_id: str) -> Response:
        """Return the board as a picture that knows its true size."""
        return await sheet(drone_id, "png", "image/png")

    @router.get(
        "/board.pdf",
        operation_id="getCalibrationBoardSheet",
        response_class=Response,
        responses={200: {"content": {"application/pdf": {}}}, **described(404)},
    )
    async def get_board_sheet(drone_id: str) -> Response:
        """Return the board on a sheet of paper, to be printed at actual size."""
        return await sheet(drone_id, "pdf", "application/pdf")

    @router.get(
        "/coverage.png",
        operation_id="getCalibrationCoverage",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}, **described(404)},
    )
    async def get_coverage(drone_id: str) -> Response:
        """Return where the kept views of a result reached: a dot per corner, red without any."""
        result = mission.calibrations.record(drone_id).result
        if result is None:
            raise UnknownError(f"there is no calibration of {drone_id}")
        headers = {"Cache-Control": "no-store"}
        return Response(result.coverage_png, media_type="image/png", headers=headers)

    return router
