"""One capture from preflight to the finished field: a step per phase, and what may interrupt it.

The course is ``server.mission.phases``; this module fills each phase with work. It decides where
the drones shall be; ``Pilot`` gets them there; stops never pass through here.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from server.geometry.boxes import Box3
from server.jobs.runner import JobFailedError, LocalRunner
from server.mission.capture import Photographer
from server.mission.commands import CaptureRequest
from server.mission.config import FlightConfig
from server.mission.events import CaptureChanged, EventStream, Noted, SeedFitted
from server.mission.eyes import Eye
from server.mission.phases import AIRBORNE, Phase, Progress
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.reconstruction import Reconstruction
from server.planner.errors import PlanError
from server.stages import Assignment, SeedGeometry, View, Viewpoint
from server.store.runs import RunFolder
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.seed import SeedError, seed_from_views

logger = logging.getLogger(__name__)

_POLL_S = 0.05
_QUARTER_TURN = np.pi / 2.0


class StepFailedError(Exception):
    """A phase cannot be completed; the mission lands and ends with this text."""


@dataclass(frozen=True, slots=True)
class MissionTools:
    """What a mission works with.

    Attributes:
        fleet: The drones.
        eyes: One eye per drone.
        pilot: Gets drones to goals.
        runner: Starts background jobs.
        events: Where news goes.
        config: Numbers of everything that flies.
    """

    fleet: Fleet
    eyes: dict[str, Eye]
    pilot: Pilot
    runner: LocalRunner
    events: EventStream
    config: FlightConfig


class Mission:
    """One capture with the given drones.

    Attributes:
        run_folder: Where everything is kept.
    """

    def __init__(
        self, request: CaptureRequest, drones: list[str], run: RunFolder, tools: MissionTools
    ) -> None:
        self.run_folder = run
        self._request = request
        self._drones = drones
        self._tools = tools
        self._config = tools.config.mission
        rounds = -(-request.pictures // len(drones))
        self._progress = Progress.start(rounds)
        self._state = "queued"
        self._error: str | None = None
        self._started_at = datetime.now(UTC)
        self._seconds: dict[str, float] = {}
        self._seed: SeedGeometry | None = None
        self._views: list[View] = []
        self._assignment = Assignment(())
        self._photographer = Photographer(
            run, tools.fleet, tools.eyes, tools.pilot, tools.events, tools.config.mission
        )
        self._planning = Planning(
            request, run.path / "jobs" / "plan", tools.runner, tools.events, tools.config
        )
        self._reconstruction = Reconstruction(request, run, tools.runner, tools.events)
        self._step: asyncio.Task[None] | None = None

    # -- what others see ----------------------------------------------------------------------

    @property
    def over(self) -> bool:
        """True when nothing follows."""
        return self._progress.over

    @property
    def airborne(self) -> bool:
        """True while the mission flies the drones."""
        return self._progress.phase in AIRBORNE

    def status(self) -> CaptureChanged:
        """Return the capture as it stands."""
        fraction, eta_s = self._time_left()
        return CaptureChanged(
            id=self.run_folder.id,
            state=self._state,
            phase=self._progress.phase.value,
            progress=fraction,
            eta_s=eta_s,
            run=str(self.run_folder.path),
            error=self._error,
            mode=self._request.mode,
            round_index=self._progress.round_index,
            rounds=self._progress.rounds,
            images=self._photographer.taken,
            images_total=self._request.pictures,
        )

    def pause(self) -> None:
        """Hover where the drones are and wait; raises ValueError where that is not possible."""
        self._progress = self._progress.pause()
        self._tools.pilot.paused = True
        self._change("paused")

    def resume(self) -> None:
        """Go on; raises ValueError when not paused or a drone is still held."""
        held = [d for d in self._drones if self._tools.fleet.drones[d].held]
        if held:
            raise ValueError(f"{', '.join(held)} held; re-arm first")
        self._progress = self._progress.resume()
        self._tools.pilot.paused = False
        self._change("running")

    def abort(self, reason: str) -> None:
        """Land and end; raises ValueError when already over."""
        self._progress = self._progress.end(reason)
        self._tools.pilot.paused = False
        if self._step is not None:
            self._step.cancel()

    # -- the course ---------------------------------------------------------------------------

    async def run(self) -> None:
        """Fly, capture, land, train; returns when all is over and never raises."""
        self._change("running")
        watch = asyncio.create_task(self._watch_drones(), name="mission watch")
        try:
            while not self._progress.over:
                await self._run_phase()
            self._finish()
        except Exception as error:
            logger.exception("mission %s failed", self.run_folder.id)
            for drone_id in self._drones:
                self._tools.fleet.land(drone_id)
            self._error = f"internal error: {error!r}"
            self._change("failed")
        finally:
            watch.cancel()
            await self._planning.cancel()
            await self._reconstruction.cancel()
            self._tools.pilot.release(self._drones)
            self._save()

    async def _run_phase(self) -> None:
        phase = self._progress.phase
        begun_s = asyncio.get_running_loop().time()
        self._step = asyncio.create_task(self._work(phase)(), name=f"phase {phase}")
        self._change(self._state)
        try:
            await self._step
        except StepFailedError as error:
            self._error = str(error)
            self._tools.events.publish(Noted("error", str(error)))
            self._progress = self._progress.end(str(error))
        except asyncio.CancelledError:
            # An abort cancels the step; anything else cancels this task itself.
            if self._progress.ending is None:
                raise
        finally:
            took_s = asyncio.get_running_loop().time() - begun_s
            self._seconds[phase.value] = self._seconds.get(phase.value, 0.0) + took_s
        if self._progress.phase is phase and not self._progress.over:
            self._progress = self._progress.advance()
        self._change(self._state)

    def _work(self, phase: Phase) -> Callable[[], Coroutine[Any, Any, None]]:
        return {
            Phase.PREFLIGHT: self._preflight,
            Phase.TAKE_OFF: self._take_off,
            Phase.CENTRE: self._centre,
            Phase.SEED: self._look_around,
            Phase.PLAN: self._plan,
            Phase.FLY: self._fly,
            Phase.TUNE: self._tune,
            Phase.CAPTURE: self._capture,
            Phase.LAND: self._land,
            Phase.TRAIN: self._train,
        }[phase]

    async def _preflight(self) -> None:
        fleet = self._tools.fleet
        for drone_id in self._drones:
            fleet.drones[drone_id].set_video(True)

        def missing() -> list[str]:
            return [
                problem
                for d in self._drones
                if (problem := _not_ready(fleet.drones[d])) is not None
            ]

        if not await self._until(lambda: not missing(), self._config.connect_timeout_s):
            raise StepFailedError(f"preflight: {'; '.join(missing())}")

    async def _take_off(self) -> None:
        for drone_id in self._drones:
            self._tools.pilot.place_at_start(drone_id)
        results = await asyncio.gather(
            *(self._tools.fleet.drones[d].take_off() for d in self._drones), return_exceptions=True
        )
        for drone_id, result in zip(self._drones, results, strict=True):
            if isinstance(result, BaseException):
                raise StepFailedError(f"{drone_id} did not take off: {result}")

    async def _centre(self) -> None:
        """Turn to the object and step back until it is whole in every picture."""
        for drone_id in self._drones:
            self._tools.pilot.centre(drone_id, self._tools.pilot.start_azimuth_rad(drone_id))
        await self._until(self._all_centred, self._config.centre_timeout_s)

    async def _look_around(self) -> None:
        """Take four seed views 90 degrees apart, in turn with fewer than four drones."""
        turns = -(-4 // len(self._drones))
        for turn in range(turns):
            for drone_id in self._drones:
                start_rad = self._tools.pilot.start_azimuth_rad(drone_id)
                self._tools.pilot.centre(drone_id, start_rad + turn * _QUARTER_TURN)
            if turn > 0:
                await self._until(self._all_centred, self._config.fly_timeout_s)
            await self._add_views()
        try:
            await self._fit_seed()
        except SeedError as error:
            raise StepFailedError(f"the object was not found: {error}") from error

    async def _plan(self) -> None:
        assert self._seed is not None
        poses = {d: self._tools.pilot.pose(d) for d in self._drones}
        camera = self._tools.fleet.drones[self._drones[0]].config
        try:
            self._assignment = await self._planning.rounds(
                self._seed, poses, camera, self._progress.rounds
            )
        except PlanError as error:
            raise StepFailedError(f"no flight is possible: {error}") from error

    async def _fly(self) -> None:
        """Go to this round's viewpoints, saving key frames on the way."""
        for drone_id, viewpoint in self._viewpoints().items():
            self._tools.pilot.fly(drone_id, viewpoint)
        await self._until(
            lambda: all(self._tools.pilot.arrived(d) for d in self._drones),
            self._config.fly_timeout_s,
            while_waiting=self._photographer.save_keyframes,
        )

    async def _tune(self) -> None:
        """Trim by PID until the object appears where the viewpoint wants it."""
        if self._request.mode == "standard":
            return
        for drone_id, viewpoint in self._viewpoints().items():
            self._tools.pilot.trim(drone_id, viewpoint)
        await self._until(
            lambda: all(self._tools.pilot.centred(d) for d in self._drones),
            self._config.tune_timeout_s,
            while_waiting=self._photographer.save_keyframes,
        )

    async def _capture(self) -> None:
        left = self._request.pictures - self._photographer.taken
        missed = await self._photographer.take_all(
            self._drones[:left], self._progress.round_index, self._object_box()
        )
        for drone_id in missed:
            self._tools.events.publish(
                Noted(
                    "warning",
                    f"Round {self._progress.round_index + 1}: no clean picture, it is left out.",
                    drone_id,
                )
            )
        await self._add_views()
        if self._photographer.taken >= min(4, self._request.pictures):
            await self._reconstruction.start()

    async def _land(self) -> None:
        fleet = self._tools.fleet
        for drone_id in self._drones:
            fleet.land(drone_id)
        down = await self._until(
            lambda: not any(fleet.drones[d].airborne for d in self._drones), 20.0
        )
        if not down:
            self._tools.events.publish(
                Noted("error", "A drone has not reported that it is down. Look, then cut motors.")
            )
        for drone_id in self._drones:
            # Video heats a drone that stands still.
            fleet.drones[drone_id].set_video(False)

    async def _train(self) -> None:
        if self._photographer.taken < 2:
            raise StepFailedError(f"only {self._photographer.taken} pictures were taken")
        await self._reconstruction.start()
        try:
            await self._reconstruction.finish(self._seconds)
        except JobFailedError as error:
            raise StepFailedError(f"the reconstruction failed: {error}") from error
        finally:
            for drone_id in self._drones:
                self._tools.fleet.drones[drone_id].set_video(True)

    # -- parts --------------------------------------------------------------------------------

    async def _add_views(self) -> None:
        """Look once with every drone and keep what it saw for the seed geometry."""
        for drone_id in self._drones:
            sight = self._tools.eyes[drone_id].sight
            if sight is None or sight.region is None or sight.box is None:
                continue
            pose = self._tools.pilot.pose(drone_id)
            intrinsics = self._tools.fleet.drones[drone_id].config.intrinsics
            self._views.append(View(pose, intrinsics, sight.box, sight.region))

    async def _fit_seed(self) -> None:
        # Carving takes a while; in a thread it never delays a stop.
        config = self._tools.config.vision.seed
        seed = await asyncio.to_thread(seed_from_views, tuple(self._views), config)
        self._seed = seed
        self._tools.pilot.seed = seed
        self._tools.events.publish(SeedFitted(seed))

    def _viewpoints(self) -> Mapping[str, Viewpoint]:
        return self._assignment.rounds[self._progress.round_index]

    def _object_box(self) -> Box3 | None:
        return None if self._seed is None else self._seed.outer

    def _all_centred(self) -> bool:
        return all(self._tools.pilot.centred(d) for d in self._drones)

    async def _until(
        self,
        condition: Callable[[], bool],
        timeout_s: float,
        while_waiting: Callable[[list[str]], Awaitable[None]] | None = None,
    ) -> bool:
        """Wait for ``condition``; a pause stops this clock. Returns whether it came true."""
        waited_s = 0.0
        while self._progress.paused or not condition():
            if not self._progress.paused:
                waited_s += _POLL_S
                if waited_s > timeout_s:
                    return False
                if while_waiting is not None:
                    await while_waiting(self._drones)
            await asyncio.sleep(_POLL_S)
        return True

    async def _watch_drones(self) -> None:
        """Pause when a drone is held; end when one has left the air that should be in it."""
        flown: set[str] = set()
        while True:
            await asyncio.sleep(_POLL_S)
            if self._progress.phase not in AIRBORNE - {Phase.TAKE_OFF, Phase.LAND}:
                continue
            for drone_id in self._drones:
                drone = self._tools.fleet.drones[drone_id]
                if drone.airborne:
                    flown.add(drone_id)
                elif drone_id in flown:
                    self._tools.events.publish(
                        Noted("error", "It left the air; the others land.", drone_id)
                    )
                    self._error = f"{drone_id} left the air in phase {self._progress.phase}"
                    self.abort(self._error)
                    break
                if drone.held and not self._progress.paused:
                    self._tools.events.publish(
                        Noted("warning", "HOLD: the capture waits. Re-arm, then resume.", drone_id)
                    )
                    self.pause()

    # -- keeping ------------------------------------------------------------------------------

    def _finish(self) -> None:
        if self._progress.ending is None:
            self._change("succeeded")
        elif self._error is None:
            self._error = self._progress.ending
            self._change("aborted")
        else:
            self._change("failed")

    def _change(self, state: str) -> None:
        self._state = state
        self._tools.events.publish(self.status())
        self._save()

    def _save(self) -> None:
        """Write ``capture.json``; ``complete`` in it says that no picture follows."""
        status = asdict(self.status()) | {"at": datetime.now(UTC).isoformat()}
        landed = self._progress.phase in (Phase.TRAIN, Phase.DONE, Phase.ENDED)
        self.run_folder.write_state(
            {
                "id": self.run_folder.id,
                "request": asdict(self._request),
                "started_at": self._started_at.isoformat(),
                "complete": landed,
                "status": status,
                "seconds": {key: round(value, 2) for key, value in self._seconds.items()},
                "seed": _seed_json(self._seed),
                "config": _plain(asdict(self._tools.config)),
            }
        )

    def _time_left(self) -> tuple[float, float | None]:
        """Return progress and seconds left: flight counted in phases, training by its own clock."""
        train_s = self._reconstruction.seconds_left()
        if self._progress.over:
            return 1.0, 0.0
        elapsed_s = sum(self._seconds.values())
        if self._progress.phase is Phase.TRAIN:
            total_s = elapsed_s + self._reconstruction.seconds_total()
            return max(0.0, 1.0 - train_s / max(total_s, 1.0)), train_s
        flight = self._progress.fraction()
        if self._progress.round_index < 1 or elapsed_s <= 0.0:
            return 0.6 * flight, None
        flight_left_s = elapsed_s * (1.0 - flight) / max(flight, 1e-3)
        return 0.6 * flight, flight_left_s + train_s


def _not_ready(drone: Drone) -> str | None:
    """Return what keeps a drone from taking off, None when nothing does."""
    name = drone.config.id
    if drone.held:
        return f"{name} is held; re-arm it"
    if drone.activity != "ground":
        return f"{name} is {drone.activity}"
    if drone.newest_frame is None or drone.video_fps == 0.0:
        return f"{name} sends no video"
    return None


def _seed_json(seed: SeedGeometry | None) -> dict[str, Any] | None:
    if seed is None:
        return None
    boxes = (seed.outer, *seed.boxes)
    lists = [[box.lower.tolist(), box.upper.tolist()] for box in boxes]
    return {"outer": lists[0], "boxes": lists[1:], "views": seed.views}


def _plain(value: Any) -> Any:
    """Return ``value`` with everything JSON cannot hold turned into text or lists."""
    return json.loads(json.dumps(value, default=str))
