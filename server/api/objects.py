"""What the operator shows the drones: where the object is, and which parts of it matter most."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Depends
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field

from server.api.command import CommandDesk
from server.api.json_numbers import Number
from server.api.messages import PriorityPart as PriorityView
from server.api.problems import described
from server.api.translate import view_from_part
from server.mission.commands import MissionControl, PointedPlace, RefusedError

_PRIORITIES = "/api/v1/plans/priorities"

Share = Annotated[Number, Field(ge=0.0, le=1.0)]
# Lists, not tuples: many readers of the OpenAPI document know no other arrays.
Box = Annotated[list[Share], Field(min_length=4, max_length=4)]
Point = Annotated[list[Share], Field(min_length=2, max_length=2)]


def _upright(box: Box) -> tuple[float, float, float, float]:
    """Return the box with these corners, whichever way it was drawn."""
    x_0, y_0, x_1, y_1 = box
    return min(x_0, x_1), min(y_0, y_1), max(x_0, x_1), max(y_0, y_1)


class PointedBox(BaseModel):
    """Where the object is: a box around it, two opposite corners x, y, x, y.

    In shares 0 to 1 of the picture, from its top left corner.
    """

    model_config = ConfigDict(extra="forbid")

    box: Box


class PointedPoint(BaseModel):
    """Where the object is: a point x, y on it, in shares 0 to 1 from the top left corner."""

    model_config = ConfigDict(extra="forbid")

    point: Point


class PickedObject(BaseModel):
    """The box that the drone's search starts from, in shares 0 to 1 of the picture."""

    drone_id: str
    box: Box


class PrioritySpec(BaseModel):
    """A part of the object to have better pictures of: a box drawn in a drone's newest picture.

    ``weight`` says how many times as much as elsewhere a patch of surface there counts.
    """

    model_config = ConfigDict(extra="forbid")

    drone_id: str
    box: Box
    weight: Number = Field(default=4.0, gt=0.0, le=20.0)


def make_objects_router(mission: MissionControl, desk: CommandDesk) -> APIRouter:
    """Return the routes of picks and priorities."""
    router = APIRouter(prefix="/api/v1", tags=["object"])
    commanded = [Depends(desk.admit)]

    @router.put(
        "/drones/{drone_id}/object",
        dependencies=commanded,
        operation_id="pickObject",
        responses=described(404, 409, 422),
    )
    async def pick_object(drone_id: str, where: PointedBox | PointedPoint) -> PickedObject:
        """Say where the object is in a drone's newest picture; its search goes on from there."""
        place: PointedPlace = (
            _upright(where.box)
            if isinstance(where, PointedBox)
            else (where.point[0], where.point[1])
        )
        picked = mission.point_out(drone_id, place)
        assert picked.box is not None
        return PickedObject(drone_id=drone_id, box=list(picked.box))

    @router.delete(
        "/drones/{drone_id}/object",
        dependencies=commanded,
        operation_id="searchObject",
        status_code=204,
        responses=described(404),
    )
    async def search_object(drone_id: str) -> Response:
        """Let a drone search the object by itself again."""
        mission.search_object(drone_id)
        return Response(status_code=204)

    @router.get("/plans/priorities", operation_id="listPriorities", responses=described())
    async def list_priorities() -> list[PriorityView]:
        """Return the parts of the object that shall have better pictures."""
        return [view_from_part(part) for part in mission.priorities()]

    @router.post(
        "/plans/priorities",
        dependencies=commanded,
        operation_id="addPriority",
        status_code=201,
        responses=described(404, 409, 422),
    )
    async def add_priority(spec: PrioritySpec, response: Response) -> PriorityView:
        """Want better pictures of a part; plans that are made from now on obey."""
        left, top, right, bottom = _upright(spec.box)
        if left == right or top == bottom:
            raise RefusedError("the drawn box holds nothing")
        part = mission.add_priority(spec.drone_id, (left, top, right, bottom), spec.weight)
        response.headers["Location"] = f"{_PRIORITIES}/{quote(part.id, safe='')}"
        return view_from_part(part)

    @router.delete(
        "/plans/priorities",
        dependencies=commanded,
        operation_id="dropPriorities",
        status_code=204,
        responses=described(),
    )
    async def drop_priorities() -> Response:
        """Forget all parts of priority."""
        mission.drop_priorities()
        return Response(status_code=204)

    @router.delete(
        "/plans/priorities/{part_id}",
        dependencies=commanded,
        operation_id="dropPriority",
        status_code=204,
        responses=described(404),
    )
    async def drop_priority(part_id: str) -> Response:
        """Forget one part of priority."""
        mission.drop_priorities(part_id)
        return Response(status_code=204)

    return router
