"""The volumes that no drone may enter: listed, drawn, changed, dropped."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.command import CommandDesk
from server.api.json_numbers import Number
from server.api.messages import NoGoVolume as NoGoView
from server.api.problems import described
from server.api.translate import view_from_no_go
from server.mission.commands import Area as FloorArea
from server.mission.commands import MissionControl

_NO_GO = "/api/v1/plans/no-go"

Metres = Annotated[Number, Field(ge=-100.0, le=100.0)]
# A list, not a tuple: many readers of the OpenAPI document know no other arrays.
Area = Annotated[list[Metres], Field(min_length=4, max_length=4)]


class NoGoSpec(BaseModel):
    """A column of the room that no drone may enter, from the floor to the ceiling.

    ``area`` is its rectangle, x, y of two opposite corners in world metres.
    """

    model_config = ConfigDict(extra="forbid")

    area: Area

    def corners(self) -> FloorArea:
        """Return the rectangle as four numbers."""
        x_0, y_0, x_1, y_1 = self.area
        return x_0, y_0, x_1, y_1


def make_no_go_router(mission: MissionControl, desk: CommandDesk) -> APIRouter:
    """Return the routes of the no-go volumes."""
    router = APIRouter(prefix=_NO_GO, tags=["object"])
    commanded = [Depends(desk.admit)]

    @router.get("", operation_id="listNoGo", responses=described())
    async def list_no_go() -> list[NoGoView]:
        """Return the volumes that no drone may enter."""
        return [view_from_no_go(volume) for volume in mission.no_go()]

    @router.post(
        "",
        dependencies=commanded,
        operation_id="addNoGo",
        status_code=201,
        responses=described(409, 422),
    )
    async def add_no_go(spec: NoGoSpec, response: Response) -> NoGoView:
        """Let no drone enter a column of the room: it binds flying drones from now on."""
        volume = await mission.add_no_go(spec.corners())
        response.headers["Location"] = f"{_NO_GO}/{quote(volume.id, safe='')}"
        return view_from_no_go(volume)

    @router.put(
        "/{volume_id}",
        dependencies=commanded,
        operation_id="changeNoGo",
        responses=described(404, 409, 422),
    )
    async def change_no_go(volume_id: str, spec: NoGoSpec) -> NoGoView:
        """Give a volume another place."""
        volume = await mission.change_no_go(volume_id, spec.corners())
        return view_from_no_go(volume)

    @router.delete(
        "",
        dependencies=commanded,
        operation_id="dropAllNoGo",
        status_code=204,
        responses=described(409),
    )
    async def drop_all_no_go() -> Response:
        """Forget all volumes but those of the settings."""
        await mission.drop_no_go()
        return Response(status_code=204)

    @router.delete(
        "/{volume_id}",
        dependencies=commanded,
        operation_id="dropNoGo",
        status_code=204,
        responses=described(404, 409),
    )
    async def drop_no_go(volume_id: str) -> Response:
        """Forget one volume."""
        await mission.drop_no_go(volume_id)
        return Response(status_code=204)

    return router
