"""The set-up: where the drones are set down, and every setting with its meaning and its bounds."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict

from server.api.problems import described
from server.api.settings_view import SettingView, settings_from_config
from server.mission.commands import MissionControl


class StartPlaceView(BaseModel):
    """Where a drone is set down: metres from the middle of the start circle, and its heading.

    ``focal_px`` and ``tilt_deg`` are its camera's; not ``calibrated`` means a usual Tello's.
    """

    model_config = ConfigDict(from_attributes=True)

    drone_id: str
    name: str
    colour: str
    address: str
    serial: str
    x_m: float
    y_m: float
    yaw_rad: float
    focal_px: float
    tilt_deg: float
    calibrated: bool


class FloorPlanView(BaseModel):
    """Where everything is before a flight; the object stands in the middle."""

    model_config = ConfigDict(from_attributes=True)

    start_radius_m: float
    fence_radius_m: float
    ceiling_m: float
    places: list[StartPlaceView]


def make_setup_router(mission: MissionControl) -> APIRouter:
    """Return the routes ``/fleet`` and ``/settings``."""
    router = APIRouter(prefix="/api/v1", tags=["setup"])

    @router.get("/fleet", operation_id="getFloorPlan", responses=described())
    async def get_floor_plan() -> FloorPlanView:
        """Return the drones and where to set each of them down."""
        return FloorPlanView.model_validate(mission.floor_plan())

    @router.get("/settings", operation_id="listSettings", responses=described())
    async def list_settings() -> list[SettingView]:
        """Return the settings that fly; they are set when the console starts."""
        return await asyncio.to_thread(settings_from_config, mission.configuration())

    return router
