"""What keeps drones on the ground and what brings them down: checklist and failsafe table."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter
from pydantic import BaseModel

from server.api.problems import described
from server.mission.checklist import Check
from server.mission.commands import MissionControl, failsafe_falls, failsafe_meaning

# What the end of an event's name says about its value.
_UNITS = {"s": "s", "m": "m", "pct": "%", "c": "°C", "deg": "°"}


class CheckView(BaseModel):
    """One item of the checklist.

    ``key`` is the name an override has to use; ``drone_id`` is null for the console itself; a
    ``final`` item cannot be overridden.
    """

    key: str
    item: str
    drone_id: str | None
    passed: bool
    found: str
    remedy: str
    final: bool


class FailsafeView(BaseModel):
    """One row of the failsafe table: what happens when a measured value reaches its threshold.

    ``at_least`` rows fire at or above the threshold, ``at_most`` rows at or below it.
    """

    event: str
    threshold: float
    direction: Literal["at_least", "at_most"]
    unit: str
    action: str
    description: str


def unit_from_event(event: str) -> str:
    """Return the unit that an event's name ends in, as people write it; empty when unknown."""
    return _UNITS.get(event.rpartition("_")[2], "")


def view_from_check(check: Check) -> CheckView:
    """Return what the console tells about an item of the checklist."""
    return CheckView(
        key=check.key,
        item=check.item,
        drone_id=check.drone_id,
        passed=check.passed,
        found=check.found,
        remedy=check.remedy,
        final=check.final,
    )


def make_safety_router(mission: MissionControl) -> APIRouter:
    """Return the routes of the checklist and of the failsafe table."""
    router = APIRouter(prefix="/api/v1", tags=["safety"])

    @router.get("/preflight", operation_id="getPreflight", responses=described())
    async def get_preflight() -> list[CheckView]:
        """Return the preflight checklist as it stands now, drone by drone, the console last."""
        return [view_from_check(check) for check in mission.preflight()]

    @router.get("/failsafes", operation_id="listFailsafes", responses=described())
    async def list_failsafes() -> list[FailsafeView]:
        """Return the failsafe table, row by row."""
        return [
            FailsafeView(
                event=row.event,
                threshold=row.threshold,
                direction="at_most" if failsafe_falls(row.event) else "at_least",
                unit=unit_from_event(row.event),
                action=row.action,
                description=failsafe_meaning(row.event),
            )
            for row in mission.failsafes()
        ]

    return router
