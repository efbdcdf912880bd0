"""The work of each phase: where the drones shall be, and when that is done.

A step ends when its work is done or its time is up; it raises ``StepFailedError`` when the mission
cannot go on. ``Pilot`` gets the drones there; stops never pass through here. The crew may shrink at
any moment: a step asks for it anew each time.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from server.jobs.runner import JobFailedError
from server.mission.capture import Photographer
from server.mission.checklist import Check, check_drone, overridden, problems
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig
from server.mission.coverage import CoverageNews
from server.mission.events import EventStream, Level, Noted
from server.mission.eyes import Eye
from server.mission.landing import Down, Landing, landing_places
from server.mission.no_go import NoGo
from server.mission.phases import Phase
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.reconstruction import Reconstruction
from server.mission.record import CaptureRecorder
from server.mission.rest_of_plan import RestOfPlan
from server.mission.seeding import Seeding
from server.mission.state import MissionState
from server.planner.errors import PlanError
from server.stages import Viewpoint
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.seed import SeedError

_POLL_S = 0.05
_QUARTER_TURN = np.pi / 2.0
# Drones that hover for a failsafe stop the mission's clock, but not for ever.
_WAIT_FOR_HOLDING_S = 60.0
# Longer than this no landing waits for a better place.
# Wind that is worth going low for before landing, to which height and for how long at most, and for
# how long it drives a drone that lands from there.
_WINDY_M_S = 0.12
_LOW_M = 0.6
_GO_LOW_S = 10.0
_WIND_S = 2.0
# How well each of the places is known where a drone may be that has fallen silent.
_LOST_SIGMA_M = 0.5
_MOVE_ASIDE_S = 15.0


class StepFailedError(Exception):
    """A phase cannot be completed; the text says why."""


@dataclass(frozen=True, slots=True)
class StepTools:
    """What the steps work with.

    Attributes:
        fleet: The drones.
        eyes: One eye per drone.
        pilot: Gets drones to goals.
        events: Where news goes.
        config: Numbers of everything that flies.
        no_go: The volumes that no drone may enter.
        photographer: Takes the pictures.
        planning: Decides where.
        reconstruction: Turns them into a field.
        recorder: The capture's record.
        console_checks: Returns the items of the checklist that the drones themselves do not know.
    """

    fleet: Fleet
    eyes: Mapping[str, Eye]
    pilot: Pilot
    events: EventStream
    config: FlightConfig
    no_go: NoGo
    photographer: Photographer
    planning: Planning
    reconstruction: Reconstruction
    recorder: CaptureRecorder
    console_checks: Callable[[], list[Check]]


class Steps:
    """The work of every phase of one mission.

    Attributes:
        seeding: Makes the seed geometry.
        coverage: Tells how much of it the pictures show.
    """

    def __init__(self, request: CaptureRequest, state: MissionState, tools: StepTools) -> None:
        self._request = request
        self._state = state
        self._tools = tools
        self._config = tools.config.mission
        self._rest = RestOfPlan(
            state,
            tools.fleet,
            tools.pilot,
            tools.photographer,
            tools.planning,
            tools.no_go,
            tools.config,
            tools.events,
        )
        self.seeding = Seeding(
            state,
            tools.fleet,
            tools.eyes,
            tools.pilot,
            tools.events,
            tools.config.vision.seed,
            tools.config.mission,
        )
        self.coverage = CoverageNews(tools.events, tools.config.planner.fitness)

    def work(self, phase: Phase) -> Coroutine[Any, Any, None]:
        """Return the work of ``phase``, to be awaited."""
        return {
            Phase.PREFLIGHT: self._preflight,
            Phase.TAKE_OFF: self._take_off,
            Phase.CENTRE: self._centre,
            Phase.SEED: self._look_around,
            Phase.PLAN: self._plan,
            Phase.FLY: self._fly,
            Phase.TUNE: self._tune,
            Phase.CAPTURE: self._capture,
            Phase.GROUNDED: self._wait_on_the_ground,
            Phase.LAND: self._land,
            Phase.TRAIN: self._train,
        }[phase]()

    # -- on the ground ------------------------------------------------------------------------

    async def _preflight(self) -> None:
        """Wait until the checklist is clear; a resumed capture flies with whoever is ready."""
        for drone_id in self._state.drones:
            self._tools.fleet.drones[drone_id].set_video(True)
        stops = self._stops()
        clear = await self._until(lambda: not self._problems(), self._config.connect_timeout_s)
        found = self._problems()
        blocked = {check.drone_id for check in found}
        ready = [d for d in self._state.drones if d not in blocked]
        resumed = self._state.progress.planned
        if not clear and (not resumed or None in blocked or not ready):
            told = "; ".join(f"{check.key}: {check.found}. {check.remedy}" for check in found)
            raise StepFailedError(f"preflight: {told}")
        for check in found:
            self._note("warning", f"It stays on the ground: {check.found}.", check.drone_id)
        for key, reason in overridden(self._checks(), self._request.overrides).items():
            self._tools.recorder.overrides[key] = reason
            self._note("warning", f"Checklist item {key} overridden: {reason}")
        # On the ground LAND changes nothing that the checklist sees; whoever presses it now does
        # not want drones to rise.
        if self._stops() != stops:
            raise StepFailedError("stopped before take-off")
        self._state.crew[:] = ready

    def _stops(self) -> list[int]:
        """Return how often each drone was stopped so far."""
        return [self._tools.fleet.drones[d].stops for d in self._state.drones]

    def _checks(self) -> list[Check]:
        now_s = asyncio.get_running_loop().time()
        drones = (self._tools.fleet.drones[d] for d in self._state.drones)
        checks = [c for d in drones for c in check_drone(d, now_s, self._tools.config.safety)]
        others = {d for d in self._tools.fleet.drones if d not in self._state.drones}
        return [*checks, *(c for c in self._tools.console_checks() if c.drone_id not in others)]

    def _problems(self) -> list[Check]:
        return problems(self._checks(), self._request.overrides)

    async def _take_off(self) -> None:
        crew = list(self._state.crew)
        for drone_id in crew:
            self._tools.pilot.place_at_start(drone_id)
        overriding = frozenset(key.rpartition(".")[2] for key in self._tools.recorder.overrides)
        results = await asyncio.gather(
            *(self._tools.fleet.drones[d].take_off(overriding) for d in crew),
            return_exceptions=True,
        )
        failures = {
            drone_id: str(result)
            for drone_id, result in zip(crew, results, strict=True)
            if isinstance(result, BaseException)
        }
        # A drone that HOLD stopped on its way up hovers for the operator, who is waited for.
        fleet = self._tools.fleet
        failures = {d: why for d, why in failures.items() if fleet.drones[d].activity != "holding"}
        if len(failures) == len(crew):
            raise StepFailedError(f"no drone took off: {'; '.join(failures.values())}")
        for drone_id, reason in failures.items():
            # Perhaps it climbs after all: nobody would fly it.
            fleet.land(drone_id)
            self._state.crew.remove(drone_id)
            self._tools.recorder.dropped[drone_id] = reason
            self._note("error", f"It did not take off ({reason}); the others go on.", drone_id)

    async def _wait_on_the_ground(self) -> None:
        """Wait for the operator; whoever resumes changes the phase."""
        deadline_s = asyncio.get_running_loop().time() + self._config.grounded_timeout_s
        while self._state.progress.phase is Phase.GROUNDED:
            if asyncio.get_running_loop().time() > deadline_s:
                raise StepFailedError("all drones have landed and nobody resumed the capture")
            await asyncio.sleep(_POLL_S)

    # -- finding the object -------------------------------------------------------------------

    async def _centre(self) -> None:
        """Turn to the object and step back until it is whole in every picture."""
        for drone_id in self._state.crew:
            self._tools.pilot.centre(drone_id, self._tools.pilot.start_azimuth_rad(drone_id))
        await self._until(self._all_centred, self._config.centre_timeout_s)
        if self._state.progress.planned:
            await self._rest.share_out()

    async def _look_around(self) -> None:
        """Take four seed views 90 degrees apart, in turn with fewer than four drones."""
        turns = -(-4 // len(self._state.crew))
        for turn in range(turns):
            for drone_id in self._state.crew:
                start_rad = self._tools.pilot.start_azimuth_rad(drone_id)
                self._tools.pilot.centre(drone_id, start_rad + turn * _QUARTER_TURN)
            if turn > 0:
                await self._until(self._all_centred, self._config.fly_timeout_s)
            await self.seeding.add_views()
        now_s, searched_s = asyncio.get_running_loop().time, 0.0
        while True:
            try:
                await self.seeding.fit()
            except SeedError as error:
                if searched_s > self._config.centre_timeout_s:
                    raise StepFailedError(f"the object was not found: {error}") from error
                # A pause stops this clock: the drones hover for somebody.
                await self._until(lambda: True, 0.0)
                begun_s = now_s()
                # A picture more of each may show what these did not.
                await self.seeding.add_views()
                searched_s += now_s() - begun_s
            else:
                return

    async def _plan(self) -> None:
        assert self._state.seed is not None
        self._state.more_wanted = False
        poses = {d: self._tools.pilot.pose(d) for d in self._state.crew}
        camera = self._tools.fleet.drones[self._state.crew[0]].config
        try:
            self._state.assignment = await self._tools.planning.rounds(
                self._state.seed, poses, camera, self._state.pictures
            )
        except PlanError as error:
            raise StepFailedError(f"no flight is possible: {error}") from error
        self._state.progress = self._state.progress.with_rounds(len(self._state.assignment.rounds))
        await self._rest.regroup(0, taken=set())
        # While drones fly to their first places the worker gets ready.
        await self._begin_training()

    # -- a round ------------------------------------------------------------------------------

    async def _fly(self) -> None:
        """Go to this round's viewpoints, saving key frames on the way."""
        self._state.commanded += len(self._viewpoints())
        for drone_id, viewpoint in self._viewpoints().items():
            self._tools.pilot.fly(drone_id, viewpoint)
        await self._until(
            lambda: all(self._tools.pilot.arrived(d) for d in self._viewpoints()),
            self._config.fly_timeout_s,
            while_waiting=self._tools.photographer.save_keyframes,
        )

    async def _tune(self) -> None:
        """Trim by PID until the object appears where the viewpoint wants it."""
        if self._request.mode == "standard":
            return
        for drone_id, viewpoint in self._viewpoints().items():
            self._tools.pilot.trim(drone_id, viewpoint)
        await self._until(
            lambda: all(self._tools.pilot.centred(d) for d in self._viewpoints()),
            self._config.tune_timeout_s,
            while_waiting=self._tools.photographer.save_keyframes,
        )

    async def _capture(self) -> None:
        photographer, state = self._tools.photographer, self._state
        left = self._state.pictures - photographer.taken
        wanted = list(self._viewpoints())[:left]
        missed = await photographer.take_all(wanted, state.progress.round_index, state.object_box)
        for drone_id in missed:
            text = f"Round {state.progress.round_index + 1}: no clean picture."
            self._note("warning", text, drone_id)
        await self._begin_training()
        self._tell_coverage()
        taken = {drone_id for drone_id in wanted if drone_id not in missed}
        self.seeding.refine(taken)
        state.captured |= {id(self._viewpoints()[d]) for d in taken if d in self._viewpoints()}
        if photographer.taken < self._state.pictures:
            await self._rest.regroup(state.progress.round_index + 1, taken)
            await self._rest.plan_anew(state.progress.round_index + 1)
        else:
            state.progress = state.progress.with_rounds(state.progress.round_index + 1)

    def _tell_coverage(self) -> None:
        """Tell how much of the object the pictures so far show, by its geometry as it is known."""
        seed, poses = self._state.seed, self._tools.photographer.poses
        if seed is None or not poses:
            return
        camera = self._tools.fleet.drones[self._state.drones[0]].config
        views = [Viewpoint(pose.position_world, pose.yaw_rad) for pose in poses]
        self.coverage.tell(seed, views, camera.intrinsics, float(np.deg2rad(camera.tilt_deg)))

    async def _begin_training(self) -> None:
        """Train beside the flight; one that cannot begin is tried again, and the flight goes on."""
        if self._request.train_seconds == 0:
            return
        try:
            await self._tools.reconstruction.start()
        except (JobFailedError, OSError) as error:
            self._note("warning", f"The training does not begin yet ({error}).")

    # -- the end ------------------------------------------------------------------------------

    async def _land(self) -> None:
        fleet, drones = self._tools.fleet, self._state.drones
        await self._move_aside()
        await self._while_held()
        for drone_id in drones:
            # Also those that are believed down: a take-off that was cut short may go on.
            fleet.land(drone_id)
        down = await self._until(lambda: not any(fleet.drones[d].airborne for d in drones), 20.0)
        if not down:
            self._note("error", "A drone has not reported that it is down. Look, then cut motors.")
        for drone_id in drones:
            # Video heats a drone that stands still.
            fleet.drones[drone_id].set_video(False)
        await self.seeding.settle()

    async def _move_aside(self) -> None:
        """Fly on until nobody would land on a drone that already stands there, and low.

        Nobody steers a drone while it lands: the shorter that takes, the less a wind can do.
        """
        pilot, fleet = self._tools.pilot, self._tools.fleet
        poses = {d: pilot.pose(d) for d in self._state.crew if fleet.drones[d].activity == "flying"}
        # A drone that has fallen silent may still be in the air, or down nobody knows where.
        lost = [d for d in fleet.drones if not pilot.is_heard(d)]
        down = [
            Down(pilot.pose(d).position_world, pilot.pose(d).position_sigma_m)
            for d in fleet.drones
            if d not in poses and d not in lost
        ]
        down += [Down(place, _LOST_SIGMA_M) for d in lost for place in pilot.whereabouts(d)]
        places = landing_places(
            {
                d: Landing(pose.position_world, _WIND_S * pilot.wind(d)[:2])
                for d, pose in poses.items()
                if d not in lost
            },
            down,
            self._state.object_box,
            self._rest.space(),
        )
        aside: dict[str, Viewpoint] = {}
        low: dict[str, Viewpoint] = {}
        for drone_id, place in places.items():
            pose = poses[drone_id]
            windy = float(np.linalg.norm(pilot.wind(drone_id))) > _WINDY_M_S
            if windy or np.linalg.norm(place - pose.position_world[:2]) > self._config.arrive_m:
                above = np.append(place, pose.position_world[2])
                aside[drone_id] = Viewpoint(above, pose.yaw_rad)
            low[drone_id] = Viewpoint(np.append(place, _LOW_M), pose.yaw_rad)
        await self._go_by_themselves(aside, _MOVE_ASIDE_S)
        await self._go_by_themselves(low, _GO_LOW_S)

    async def _go_by_themselves(self, wanted: Mapping[str, Viewpoint], timeout_s: float) -> None:
        """Get drones to viewpoints, whatever becomes of the others; a stop ends it for a drone."""
        pilot, fleet = self._tools.pilot, self._tools.fleet
        for drone_id, viewpoint in wanted.items():
            pilot.fly(drone_id, viewpoint)
        deadline_s, moving = asyncio.get_running_loop().time() + timeout_s, list(wanted)
        while moving and asyncio.get_running_loop().time() < deadline_s:
            await asyncio.sleep(_POLL_S)
            moving = [
                d for d in moving if fleet.drones[d].activity == "flying" and not pilot.arrived(d)
            ]

    async def _while_held(self) -> None:
        """Wait while the operator holds a drone in the air: somebody may stand below it.

        An operator who aborts has seen the drones that are held: those land. A HOLD that comes
        later is waited for, also of a drone that was held before.
        """
        told = False
        while any(
            drone.held and drone.activity == "holding"
            for drone_id, drone in self._flown_drones().items()
            if self._state.stops_at_abort.get(drone_id) != drone.stops
        ):
            if not told:
                told = True
                self._note("warning", "HOLD: the landing waits. Re-arm, or press LAND.")
            await asyncio.sleep(_POLL_S)

    def _flown_drones(self) -> dict[str, Drone]:
        return {d: self._tools.fleet.drones[d] for d in self._state.drones}

    async def _train(self) -> None:
        taken = self._tools.photographer.taken
        if taken < 2:
            raise StepFailedError(f"only {taken} pictures were taken")
        if self._request.train_seconds == 0:
            return
        try:
            await self._tools.reconstruction.start()
            await self._tools.reconstruction.finish(self._tools.recorder.seconds)
        except (JobFailedError, OSError) as error:
            raise StepFailedError(f"the reconstruction failed: {error}") from error
        finally:
            for drone_id in self._state.drones:
                self._tools.fleet.drones[drone_id].set_video(True)

    # -- parts --------------------------------------------------------------------------------

    def _viewpoints(self) -> dict[str, Viewpoint]:
        """Return this round's viewpoints of the drones that fly."""
        row = self._state.assignment.rounds[self._state.progress.round_index]
        return {d: viewpoint for d, viewpoint in row.items() if d in self._state.crew}

    def _all_centred(self) -> bool:
        return all(self._tools.pilot.centred(d) for d in self._state.crew)

    def _holding(self) -> bool:
        return any(self._tools.fleet.drones[d].activity == "holding" for d in self._state.crew)

    async def _until(
        self,
        condition: Callable[[], bool],
        timeout_s: float,
        while_waiting: Callable[[list[str]], Awaitable[None]] | None = None,
    ) -> bool:
        """Wait for ``condition``; returns whether it came true.

        A pause stops this clock, and so, for a while, does a drone that hovers for a failsafe.
        """
        waited_s = held_s = 0.0
        while self._state.progress.paused or not condition():
            if not self._state.progress.paused:
                if self._holding() and held_s < _WAIT_FOR_HOLDING_S:
                    held_s += _POLL_S
                else:
                    waited_s += _POLL_S
                if waited_s > timeout_s:
                    return False
                if while_waiting is not None:
                    await while_waiting(list(self._state.crew))
            await asyncio.sleep(_POLL_S)
        return True

    def _note(self, level: Level, text: str, drone_id: str | None = None) -> None:
        self._tools.events.publish(Noted(level, text, drone_id))
