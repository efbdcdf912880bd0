"""What the operator shows the drones: where the object is, and which parts of it matter most."""

from __future__ import annotations

from typing import Annotated, Self
from urllib.parse import quote

from fastapi import APIRouter, Depends
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from server.api.command import CommandDesk
from server.api.messages import PriorityPart as PriorityView
from server.api.problems import described
from server.api.translate import view_from_part
from server.mission.commands import MissionControl, PointedPlace

_PRIORITIES = "/api/v1/plans/priorities"

Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Box = tuple[Share, Share, Share, Share]


def _ordered(box: Box) -> Box:
    left, top, right, bottom = box
    if left >= right or top >= bottom:
        raise ValueError("a box is left, top, right, bottom, with left < right and top < bottom")
    return box


class PointedObject(BaseModel):
    """Where the object is: a ``box`` or a ``point``, in shares 0 to 1 of the picture.

    A box is left, top, right, bottom; a point is x, y. Both count from the top left corner.
    """

    model_config = ConfigDict(extra="forbid")

    box: Box | None = None
    point: tuple[Share, Share] | None = None

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.box is None) == (self.point is None):
            raise ValueError("give either a box or a point")
        if self.box is not None:
            _ordered(self.box)
        return self


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
    weight: float = Field(default=4.0, gt=0.0, le=20.0, allow_inf_nan=False)

    @model_validator(mode="after")
    def _right_way_round(self) -> Self:
        _ordered(self.box)
        return self


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
    async def pick_object(drone_id: str, where: PointedObject) -> PickedObject:
        """Say where the object is in a drone's newest picture; its search goes on from there."""
        place = where.box or where.point
        assert place is not None  # The model requires one of both.
        picked = mission.point_out(drone_id, _place(place))
        assert picked.box is not None
        return PickedObject(drone_id=drone_id, box=picked.box)

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
        part = mission.add_priority(spec.drone_id, spec.box, spec.weight)
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


def _place(place: Box | tuple[Share, Share]) -> PointedPlace:
    return place
