"""Deciding where the pictures are taken: by the planning job, or by the ring.

The optimised mode asks the worker and falls back to the paper's circular step when no plan is ready
in time or none is possible, so that a mission never waits for its planner.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from server.jobs.plan import KnownPlaces, PlanInput, PlanResult
from server.jobs.runner import Job, JobFailedError, JobRunner
from server.jobs.spec import JobSpec
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig
from server.mission.coverage import surface_seen
from server.mission.events import (
    Coverage,
    EventStream,
    NoGoVolume,
    Noted,
    PlanFound,
    PlanProgressed,
)
from server.mission.no_go import NoGo
from server.mission.priorities import Priorities
from server.planner.errors import PlanError
from server.planner.ring import Rounds, ring_assignment, standard_ring
from server.stages import Assignment, CameraPose, Placement, SeedGeometry, Viewpoint
from server.swarm.config import DroneConfig

logger = logging.getLogger(__name__)


class Planning:
    """Plans one mission."""

    def __init__(
        self,
        request: CaptureRequest,
        folder: Path,
        runner: JobRunner,
        events: EventStream,
        config: FlightConfig,
        priorities: Priorities,
        no_go: NoGo,
        known: Callable[[], KnownPlaces | None] = lambda: None,
    ) -> None:
        self._request = request
        self._folder = folder
        self._runner = runner
        self._events = events
        self._config = config
        self._priorities = priorities
        self._no_go = no_go
        self._known = known
        self._planned_around: tuple[NoGoVolume, ...] = ()
        self._planned_by: KnownPlaces | None = None
        self._job: Job | None = None

    async def rounds(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
    ) -> Assignment:
        """Return who goes where in each round for so many ``views``, and publish it.

        Raises:
            PlanError: If not even the ring fits between standoff and fence.
        """
        if self._request.mode == "standard":
            return await self._ring(seed, poses, camera, views)
        try:
            async with asyncio.timeout(self._config.mission.plan_timeout_s):
                result = await self._ask_worker(seed, poses, camera, views)
        except (TimeoutError, JobFailedError) as error:
            reason = str(error) or "not ready in time"
            self._events.publish(
                Noted("warning", f"No plan ({reason}): the circular step is flown instead.")
            )
            await self.cancel()
            return await self._ring(seed, poses, camera, views)
        ring = self._ring_to_compare(seed, poses, camera, views)
        return await self._tell(seed, camera, result.placement(), result.assignment(), ring)

    @property
    def outdated(self) -> bool:
        """True when the operator's parts or no-go volumes are others than those of the plan."""
        changed = self._priorities.unplanned or self._planned_around != self._no_go.volumes
        return self._request.mode == "optimized" and changed

    @property
    def each_round(self) -> bool:
        """True when the next round shall have a plan of its own.

        By the settings; or the policy is uncertain and the field knows something new.
        """
        known = self._known() if self._config.planner.policy == "uncertain" else None
        news = known is not None and known is not self._planned_by
        replans = self._config.mission.replan_every_round or news
        return self._request.mode == "optimized" and replans

    async def rounds_anew(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
        taken: Sequence[CameraPose],
    ) -> Assignment | None:
        """Plan the ``views`` that are left, beside what was ``taken``, and publish them.

        None when there is no such plan.
        """
        try:
            async with asyncio.timeout(self._config.mission.plan_timeout_s):
                result = await self._ask_worker(seed, poses, camera, views, taken)
        except (TimeoutError, JobFailedError) as error:
            reason = str(error) or "not ready in time"
            self._events.publish(Noted("warning", f"No new plan ({reason}): the old one is flown."))
            await self.cancel()
            return None
        ring = self._ring_to_compare(seed, poses, camera, views)
        placement, assignment = result.placement(), result.assignment()
        return await self._tell(seed, camera, placement, assignment, ring, taken)

    async def cancel(self) -> None:
        """End the worker if it runs."""
        if self._job is not None:
            await self._job.cancel()

    async def _ask_worker(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
        taken: Sequence[CameraPose] = (),
    ) -> PlanResult:
        self._planned_around = self._no_go.volumes
        self._planned_by = self._known()
        wanted = PlanInput(
            outer=(seed.outer.lower.tolist(), seed.outer.upper.tolist()),
            boxes=[(box.lower.tolist(), box.upper.tolist()) for box in seed.boxes],
            views=seed.views,
            intrinsics=asdict(camera.intrinsics),
            tilt_rad=float(np.deg2rad(camera.tilt_deg)),
            drones={d: _place(pose) for d, pose in poses.items()},
            taken=[_place(pose) for pose in taken],
            known=self._planned_by,
            rounds=_rounds(views, poses),
            pictures=views,
            config=asdict(self._no_go.within(self._config.planner)),
            priorities=[
                (part.box.lower.tolist(), part.box.upper.tolist(), part.weight)
                for part in self._priorities.of_seed(seed)
            ],
        )
        spec = JobSpec("plan", wanted.model_dump(), seed=self._request.seed, threads=1)
        self._job = await self._runner.submit(spec, self._folder)
        async for event in self._job.events():
            if event["event"] == "progressed":
                self._events.publish(
                    PlanProgressed(
                        event["iteration"],
                        event["iterations"],
                        event["temperature"],
                        event["fitness"],
                    )
                )
            elif event["event"] == "done":
                return PlanResult.model_validate(event)
        raise JobFailedError("the planner ended without a plan")

    def _ring_to_compare(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
    ) -> Assignment | None:
        try:
            return ring_assignment(list(poses), self._ring_views(seed, poses, camera, views))
        except PlanError:
            return None

    async def _ring(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
    ) -> Assignment:
        self._planned_around = self._no_go.volumes
        viewpoints = self._ring_views(seed, poses, camera, views)
        assignment = ring_assignment(list(poses), viewpoints)
        chosen = tuple(view for entry in viewpoints for view in entry)
        return await self._tell(seed, camera, Placement(chosen, 0.0, {}, len(chosen)), assignment)

    async def _tell(
        self,
        seed: SeedGeometry,
        camera: DroneConfig,
        placement: Placement,
        assignment: Assignment,
        ring: Assignment | None = None,
        taken: Sequence[CameraPose] = (),
    ) -> Assignment:
        """Publish a plan with what its pictures are expected to show; returns the assignment."""

        async def expected(of: Assignment) -> Coverage | None:
            views = [Viewpoint(pose.position_world, pose.yaw_rad) for pose in taken]
            views += [view for row in of.rounds for view in row.values()]
            try:
                seen = await asyncio.to_thread(
                    surface_seen,
                    seed,
                    views,
                    camera.intrinsics,
                    float(np.deg2rad(camera.tilt_deg)),
                    self._config.planner.fitness,
                )
            except Exception:  # It is for people to look at; the plan is flown all the same.
                logger.exception("what the plan will show could not be worked out")
                return None
            return seen.coverage

        found = PlanFound(
            placement,
            assignment,
            await expected(assignment),
            ring=ring,
            ring_expected=None if ring is None else await expected(ring),
        )
        self._events.publish(found)
        return assignment

    def _ring_views(
        self,
        seed: SeedGeometry,
        poses: Mapping[str, CameraPose],
        camera: DroneConfig,
        views: int,
    ) -> Rounds:
        offsets = [pose.position_world - seed.outer.centre for pose in poses.values()]
        return standard_ring(
            seed.outer,
            len(poses),
            _rounds(views, poses),
            camera.intrinsics,
            float(np.deg2rad(camera.tilt_deg)),
            self._no_go.within(self._config.planner),
            [float(np.arctan2(offset[1], offset[0])) for offset in offsets],
        )


def _rounds(views: int, poses: Mapping[str, CameraPose]) -> int:
    return -(-views // len(poses))


def _place(pose: CameraPose) -> tuple[float, float, float, float]:
    x, y, z = (float(value) for value in pose.position_world)
    return x, y, z, pose.yaw_rad
