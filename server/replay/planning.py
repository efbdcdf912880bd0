"""The plans of a recorded flight: the mission's own planning, asked when the flight asked it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from server.geometry.boxes import Box3
from server.mission.commands import CaptureRequest, RefusedError
from server.mission.config import FlightConfig
from server.mission.events import EventStream, NoGoVolume, Noted
from server.mission.no_go import NoGo
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.priorities import Priorities
from server.planner.errors import PlanError
from server.replay.prompt_jobs import PromptRunner
from server.replay.recorded_fleet import RecordedEye, RecordedFleet
from server.stages import CameraPose, SeedGeometry
from server.swarm.config import DroneConfig
from server.swarm.drone import Drone


@dataclass(frozen=True, slots=True, eq=False)
class _Outset:
    """What a plan sets out from.

    Attributes:
        seed: The geometry.
        poses: Those of the crew.
        camera: What all of them fly.
        views: How many pictures are left.
    """

    seed: SeedGeometry
    poses: Mapping[str, CameraPose]
    camera: DroneConfig
    views: int


class RecordedPlanning:
    """Plans one recorded flight; plans and warnings go to the events, as in flight.

    Attributes:
        wanted: How many pictures are wanted in all, by now.
    """

    def __init__(
        self,
        request: CaptureRequest,
        config: FlightConfig,
        fleet: RecordedFleet,
        eyes: Mapping[str, RecordedEye],
        pilot: Pilot,
        events: EventStream,
    ) -> None:
        self.wanted = request.pictures
        self._fleet = fleet
        self._eyes = eyes
        self._pilot = pilot
        self._events = events
        # Of drones, parts and plans take only what recordings hold.
        drones = cast("dict[str, Drone]", fleet.drones)
        self._priorities = Priorities(drones, pilot, events)
        self._no_go = NoGo(None, pilot, config.planner, config.safety, events)
        self._planning = Planning(
            request, Path(), PromptRunner(), events, config, self._priorities, self._no_go
        )
        self._parts: dict[str, str | None] = {}  # Own names of the flight's parts; None: refused.
        self._taken: list[CameraPose] = []
        self._between_rounds: _Outset | None = None

    def set_no_go(self, volumes: list[dict[str, Any]]) -> None:
        """Take over the no-go volumes, as ``NoGoChanged`` has them."""
        self._no_go.take_over(
            tuple(
                NoGoVolume(
                    each["id"],
                    Box3(np.array(each["box"]["lower"]), np.array(each["box"]["upper"])),
                    each["configured"],
                )
                for each in volumes
            )
        )

    def set_parts(self, parts: list[dict[str, Any]], at_s: float) -> None:
        """Take over the operator's parts of priority, as ``PrioritiesChanged`` has them."""
        wanted = {part["id"]: part for part in parts}
        standing = {part.id for part in self._priorities.parts}
        for told in [told for told in self._parts if told not in wanted]:
            own = self._parts.pop(told)
            # One that showed nothing of the object is gone already.
            if own is not None and own in standing:
                self._priorities.drop(own)
        for told, part in wanted.items():
            if told not in self._parts:
                self._parts[told] = self._mark(part, at_s)

    def _mark(self, part: dict[str, Any], at_s: float) -> str | None:
        """Mark a part in what its drone sees now; returns its name, None when it is refused."""
        drone_id, (left, top, right, bottom) = part["drone_id"], part["drawn"]
        captured_s, drawn = self._seen_s(drone_id, at_s), (left, top, right, bottom)
        try:
            return self._priorities.add(drone_id, drawn, part["weight"], captured_s).id
        except RefusedError as error:
            self._warn(f"{part['id']} is not marked: {error}", drone_id)
            return None

    def photographed(self, drone_id: str, at_s: float) -> None:
        """Note that a picture was taken: after the last of a round the rest may be planned anew."""
        self._taken.append(self._pilot.pose(drone_id, self._seen_s(drone_id, at_s)))
        self._between_rounds = self._outset(at_s)

    def _seen_s(self, drone_id: str, at_s: float) -> float:
        """Return when the newest picture of a drone was taken, ``at_s`` when there is none."""
        sight = self._eyes[drone_id].sight
        return at_s if sight is None else sight.frame.captured_s

    async def plan(self, at_s: float) -> None:
        """Plan all rounds."""
        outset = self._outset(at_s)
        if outset is None:
            self._warn("no plan: there is no seed geometry to plan for")
            return
        try:
            await self._planning.rounds(outset.seed, outset.poses, outset.camera, outset.views)
        except PlanError as error:
            self._warn(f"no plan: {error}")

    async def plan_anew(self) -> None:
        """Plan the rounds that were left after the newest picture."""
        left = self._between_rounds
        if left is not None:
            await self._planning.rounds_anew(
                left.seed, left.poses, left.camera, left.views, self._taken
            )

    def _outset(self, at_s: float) -> _Outset | None:
        """Return what a plan made now sets out from, None when nobody flies or knows the object."""
        seed, crew = self._pilot.seed, self._fleet.crew
        left = self.wanted - len(self._taken)
        if seed is None or not crew or left <= 0:
            return None
        return _Outset(
            seed,
            {drone_id: self._pilot.pose(drone_id, at_s) for drone_id in crew},
            self._fleet.drones[crew[0]].config,
            views=left,
        )

    def _warn(self, text: str, drone_id: str | None = None) -> None:
        self._events.publish(Noted("warning", text, drone_id))
