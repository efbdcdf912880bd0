"""Drones and the fleet. A stop is called first thing and goes straight to ``StopControl``."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable
from typing import Annotated

from fastapi import APIRouter, Header
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict

from server.api.command import CommandDesk
from server.api.journal import Journal
from server.api.messages import DroneReport
from server.api.problems import ProblemError, described
from server.api.translate import message_from_event
from server.mission.commands import DroneCommand, MissionControl, StopCommand
from server.mission.events import DroneReported
from server.stages import StopControl

logger = logging.getLogger(__name__)


class CommandRequest(BaseModel):
    """What one drone shall do."""

    model_config = ConfigDict(extra="forbid")

    command: DroneCommand


class CommandAccepted(BaseModel):
    """The command was handed to the drone, or to all when ``drone_id`` is null."""

    command: DroneCommand
    drone_id: str | None


def _reports(events: Iterable[DroneReported]) -> list[DroneReport]:
    reports = (message_from_event(event) for event in events)
    return [report for report in reports if isinstance(report, DroneReport)]


def make_drones_router(
    mission: MissionControl,
    stops: StopControl,
    desk: CommandDesk,
    journal: Journal,
    command_wait_s: float,
) -> APIRouter:
    """Return the routes below ``/drones`` and ``/fleet``.

    A command that is not refused within ``command_wait_s`` is answered as accepted and goes on.
    """
    router = APIRouter(prefix="/api/v1", tags=["drones"])
    going_on: set[asyncio.Task[None]] = set()

    def log_failure(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and task.exception() is not None:
            logger.error("%s failed", task.get_name(), exc_info=task.exception())

    def stop(command: StopCommand, drone_id: str | None) -> None:
        match command:
            case "hold":
                stops.hold(drone_id)
            case "land":
                stops.land(drone_id)
            case "cut_motors":
                stops.cut_motors(drone_id)
        # Told last: nothing that goes wrong with the news may come before a stop or undo it.
        try:
            mission.note_stop(command, drone_id)
        except Exception:  # The stop is under way, which is what is answered.
            logger.exception("%s could not be told", command)

    # The stops are coroutines without an await: they run on the event loop, at once, and do not
    # queue behind anything for a worker thread.
    @router.post("/fleet/hold", operation_id="holdFleet", status_code=202, responses=described())
    async def hold_fleet() -> CommandAccepted:
        """Let all drones hover; they refuse motion until re-armed."""
        stop("hold", None)
        return CommandAccepted(command="hold", drone_id=None)

    @router.post("/fleet/land", operation_id="landFleet", status_code=202, responses=described())
    async def land_fleet() -> CommandAccepted:
        """Land all drones where they are."""
        stop("land", None)
        return CommandAccepted(command="land", drone_id=None)

    @router.post(
        "/fleet/cut-motors",
        operation_id="cutFleetMotors",
        status_code=202,
        responses=described(),
    )
    async def cut_fleet_motors() -> CommandAccepted:
        """Stop all motors at once; the drones fall."""
        stop("cut_motors", None)
        return CommandAccepted(command="cut_motors", drone_id=None)

    @router.post(
        "/drones/{drone_id}/commands",
        operation_id="commandDrone",
        status_code=202,
        responses=described(404, 409, 422),
    )
    async def command_drone(
        drone_id: str,
        request: CommandRequest,
        x_dronerf_client: Annotated[str, Header(max_length=64)] = "",
    ) -> CommandAccepted:
        """Command one drone."""
        if request.command in ("hold", "land", "cut_motors"):
            try:
                stop(request.command, drone_id)
            except LookupError as error:
                raise ProblemError(404, f"there is no drone {drone_id!r}", "unknown") from error
        else:
            await desk.admit(x_dronerf_client)
            # A take-off lasts many seconds; who asked is told that it began, not that it ended.
            task = asyncio.create_task(
                mission.command_drone(drone_id, request.command),
                name=f"{request.command} of {drone_id}",
            )
            going_on.add(task)
            task.add_done_callback(going_on.discard)
            await asyncio.wait({task}, timeout=command_wait_s)
            if task.done():
                task.result()
            else:
                task.add_done_callback(log_failure)
            if request.command == "takeoff":
                desk.note_flight(x_dronerf_client)
        return CommandAccepted(command=request.command, drone_id=drone_id)

    @router.get("/drones", operation_id="listDrones", responses=described())
    async def list_drones() -> list[DroneReport]:
        """Return the newest report of every drone, in fleet order."""
        return _reports(mission.drones())

    @router.get("/drones/history", operation_id="listDroneHistory", responses=described())
    async def list_history() -> list[DroneReport]:
        """Return what the drones reported over the last quarter of an hour, every five seconds."""
        return _reports(journal.course.reports())

    @router.get(
        "/drones/{drone_id}/frame.jpg",
        operation_id="getDroneFrame",
        response_class=Response,
        responses={200: {"content": {"image/jpeg": {}}}, **described(404)},
    )
    async def drone_frame(drone_id: str) -> Response:
        """Return the newest annotated picture of a drone."""
        frame = mission.newest_frame(drone_id)
        if frame is None:
            raise ProblemError(404, f"no picture has come from {drone_id} yet", "no_picture")
        headers = {
            "Cache-Control": "no-store",
            "X-Frame-Sequence": str(frame.sequence),
            "X-Frame-Age-Seconds": f"{max(0.0, time.monotonic() - frame.captured_s):.3f}",
            "X-Frame-Damaged": "true" if frame.damaged else "false",
        }
        return Response(frame.jpeg, media_type="image/jpeg", headers=headers)

    return router
