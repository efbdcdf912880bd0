"""One capture from preflight to the finished field: runs the phases, and what may interrupt them.

The course is ``server.mission.phases``, the work of each phase ``server.mission.steps``. This
module starts the steps one after the other and watches the drones meanwhile: one that leaves the
air leaves the crew, and the others take over its viewpoints; when none is left, the capture waits
on the ground for fresh batteries.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from server.jobs.runner import JobRunner
from server.mission.capture import Photographer
from server.mission.checklist import Check
from server.mission.commands import MOST_PICTURES, CaptureRequest
from server.mission.config import FlightConfig
from server.mission.events import CaptureChanged, EventStream, FieldView, Noted
from server.mission.eyes import Eye
from server.mission.no_go import NoGo
from server.mission.phases import AIRBORNE, Phase, Progress
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.priorities import Priorities
from server.mission.reconstruction import Reconstruction
from server.mission.record import CaptureRecorder
from server.mission.state import MissionState
from server.mission.steps import StepFailedError, Steps, StepTools
from server.store.runs import RunFolder
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet

logger = logging.getLogger(__name__)

_POLL_S = 0.05
# A run whose folder has not changed for minutes is taken for one that nobody works on.
_SIGN_OF_LIFE_S = 60.0
_STEERED = AIRBORNE - {Phase.TAKE_OFF, Phase.LAND}
_RETURNING = (Phase.PREFLIGHT, Phase.TAKE_OFF, Phase.CENTRE)
_FLOWN = (Phase.LAND, Phase.TRAIN)


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
        priorities: The parts that the operator wants to have better pictures of.
        no_go: The volumes that no drone may enter.
        console_checks: Returns the items of the checklist that the drones themselves do not know.
    """

    fleet: Fleet
    eyes: Mapping[str, Eye]
    pilot: Pilot
    runner: JobRunner
    events: EventStream
    config: FlightConfig
    priorities: Priorities
    no_go: NoGo
    console_checks: Callable[[], list[Check]]


class Mission:
    """One capture with the given drones.

    Attributes:
        run_folder: Where everything is kept.
    """

    def __init__(
        self, request: CaptureRequest, drones: list[str], run: RunFolder, tools: MissionTools
    ) -> None:
        self.run_folder = run
        self._tools = tools
        rounds = -(-request.pictures // len(drones))
        self._state = MissionState(
            tuple(drones), list(drones), Progress.start(rounds), request.pictures
        )
        self._chooses = request.mode == "optimized"
        self._recorder = CaptureRecorder(request, run, tools.config)
        self._photographer = Photographer(
            run, tools.fleet, tools.eyes, tools.pilot, tools.events, tools.config.mission
        )
        self._reconstruction = Reconstruction(
            request,
            run,
            tools.runner,
            tools.events,
            ask_known=tools.config.planner.policy == "uncertain",
        )
        self._planning = Planning(
            request,
            run.path / "jobs" / "plan",
            tools.runner,
            tools.events,
            tools.config,
            tools.priorities,
            tools.no_go,
            known=lambda: self._reconstruction.known,
        )
        self._steps = Steps(
            request,
            self._state,
            StepTools(
                fleet=tools.fleet,
                eyes=tools.eyes,
                pilot=tools.pilot,
                events=tools.events,
                config=tools.config,
                no_go=tools.no_go,
                photographer=self._photographer,
                planning=self._planning,
                reconstruction=self._reconstruction,
                recorder=self._recorder,
                console_checks=tools.console_checks,
            ),
        )
        self._step: asyncio.Task[None] | None = None
        self._redirected = False
        self._landed = False
        self._saved_s = 0.0

    # -- what others see ----------------------------------------------------------------------

    @property
    def over(self) -> bool:
        """True when nothing follows."""
        return self._state.progress.over

    @property
    def airborne(self) -> bool:
        """True while the mission flies the drones."""
        return self._state.progress.phase in AIRBORNE

    @property
    def needs_drones(self) -> bool:
        """True until they are down for good: nobody else flies them meanwhile."""
        return not self._state.progress.over and self._state.progress.phase is not Phase.TRAIN

    @property
    def before_take_off(self) -> bool:
        """True while the checklist decides whether the drones may rise."""
        return self._state.progress.phase is Phase.PREFLIGHT

    @property
    def observers(self) -> tuple[str, ...]:
        """The drones that fly and look at the object now."""
        return tuple(self._state.crew) if self._state.progress.phase in _STEERED else ()

    def status(self) -> CaptureChanged:
        """Return the capture as it stands."""
        return self._recorder.status(
            self._state.progress,
            self._photographer.taken,
            self._state.pictures,
            self._state.commanded,
            self._reconstruction.seconds_total(),
            self._reconstruction.seconds_left(),
        )

    def log(self, fields: dict[str, Any]) -> None:
        """Append a line to the run's own log."""
        self._recorder.log(fields)

    def pause(self) -> None:
        """Hover where the drones are and wait; raises ValueError where that is not possible."""
        self._state.progress = self._state.progress.pause()
        self._tools.pilot.paused = True
        self._change("paused")

    def resume(self) -> None:
        """Go on; raises ValueError when not paused or a drone that shall fly is still held."""
        grounded = self._state.progress.phase is Phase.GROUNDED
        needed = self._state.drones if grounded else self._state.crew
        held = [d for d in needed if self._tools.fleet.drones[d].held]
        if held:
            raise ValueError(f"{', '.join(held)} held; re-arm first")
        self._state.progress = self._state.progress.resume()
        self._tools.pilot.paused = False
        self._change("running")

    def add_pictures(self, count: int) -> None:
        """Want so many pictures more, from where they add most; raises ValueError if impossible."""
        state = self._state
        if not self._chooses:
            raise ValueError("the standard ring is flown as it is; nothing is chosen")
        if state.progress.over or state.progress.ending or state.progress.phase in _FLOWN:
            raise ValueError("its drones are on their way down already")
        if state.progress.planned and self._photographer.taken >= state.pictures:
            raise ValueError("all its pictures are taken already")
        if state.pictures + count > MOST_PICTURES:
            raise ValueError(f"a capture has at most {MOST_PICTURES} pictures")
        state.pictures += count
        state.more_wanted = True
        text = f"{count} pictures more are wanted, {state.pictures} in all."
        self._tools.events.publish(Noted("info", text))
        self._change(self._recorder.state)

    async def view_field(self, view: FieldView | None) -> None:
        """See previews of the field from ``view``; raises ValueError, see ``Reconstruction``."""
        await self._reconstruction.view_from(view)

    def abort(self, reason: str) -> None:
        """Land and end; raises ValueError when already over."""
        progress = self._state.progress.end(reason)
        drones = self._tools.fleet.drones
        # Whoever aborts has seen which drones are held in the air, and lands those, too.
        self._state.stops_at_abort = {d: drones[d].stops for d in self._state.drones}
        self._end(progress)

    def _end(self, progress: Progress) -> None:
        if self._state.progress.phase is Phase.LAND:
            self._state.progress = progress  # It is landing: that must not be cut short.
        else:
            self._redirect(progress)

    # -- the course ---------------------------------------------------------------------------

    async def run(self) -> None:
        """Fly, capture, land, train; returns when all is over and never raises."""
        self._tools.pilot.begin_capture()
        self._change("running")
        watch = asyncio.create_task(self._watch_drones(), name="mission watch")
        watch.add_done_callback(self._on_watch_end)
        try:
            while not self._state.progress.over:
                await self._run_phase()
            self._finish()
        except Exception as error:
            logger.exception("mission %s failed", self.run_folder.id)
            self._recorder.error = f"internal error: {error!r}"
            self._end_at_once()
            self._change("failed")
        finally:
            watch.cancel()
            # Once it has landed them they are other people's again.
            if not self._landed:
                self._land_whoever_flies()
                self._tools.pilot.release(list(self._state.drones))
            self._steps.seeding.stop()
            self._steps.coverage.stop()
            await self._planning.cancel()
            await self._reconstruction.cancel()
            self._tools.pilot.paused = False
            self._save()
            await self._recorder.settled()

    async def _run_phase(self) -> None:
        phase = self._state.progress.phase
        begun_s = asyncio.get_running_loop().time()
        self._redirected = False
        self._step = asyncio.create_task(self._steps.work(phase), name=f"phase {phase}")
        self._change(self._recorder.state)
        try:
            await self._step
        except StepFailedError as error:
            self._fail(phase, str(error))
        except asyncio.CancelledError:
            # A redirection cancels the step; anything else cancels this task itself.
            if not self._redirected:
                raise
        finally:
            self._recorder.add_seconds(phase, asyncio.get_running_loop().time() - begun_s)
        if phase is Phase.LAND:
            drones = self._tools.fleet.drones
            self._landed = not any(drones[d].airborne for d in self._state.drones)
        await self._while_paused(phase)
        if self._state.progress.phase is phase and not self._state.progress.over:
            self._state.progress = self._state.progress.advance()
        self._change(self._recorder.state)

    async def _while_paused(self, phase: Phase) -> None:
        """Wait while the mission is paused in ``phase``, whose work is done."""
        progress = self._state.progress
        while progress.paused and progress.phase is phase:
            await asyncio.sleep(_POLL_S)
            progress = self._state.progress

    def _end_at_once(self) -> None:
        """Take the place at the end of the course; landing is then nobody's phase any more."""
        progress = self._state.progress
        if not progress.over:
            progress = progress.end(self._recorder.error or "failed")
        if progress.phase is Phase.LAND:
            progress = progress.advance()
        self._state.progress = progress

    def _land_whoever_flies(self) -> None:
        """Leave nobody in the air; a drone that the operator holds goes on hovering."""
        for drone_id in self._state.drones:
            drone = self._tools.fleet.drones[drone_id]
            if drone.airborne and not drone.held:
                self._tools.fleet.land(drone_id)

    def _on_watch_end(self, watch: asyncio.Task[None]) -> None:
        if watch.cancelled():
            return
        # Without it nobody sees a HOLD or a lost drone: the flight cannot go on.
        logger.error("mission watch failed", exc_info=watch.exception())
        self._recorder.error = "internal error: the watch over the drones failed"
        if not self._state.progress.over:
            self._end(self._state.progress.end(self._recorder.error))

    def _fail(self, phase: Phase, reason: str) -> None:
        self._tools.events.publish(Noted("error", reason))
        if self._state.progress.planned and phase in _RETURNING:
            # It was resumed too early: back to waiting, nothing is lost.
            for drone_id in self._state.drones:
                self._tools.fleet.land(drone_id)
            self._go_aground()
            return
        self._recorder.error = reason
        self._tools.pilot.paused = False
        self._state.progress = self._state.progress.end(reason)

    def _redirect(self, progress: Progress) -> None:
        """Take up another place in the course; the step under way ends."""
        self._state.progress = progress
        self._tools.pilot.paused = False
        self._redirected = True
        if self._step is not None:
            self._step.cancel()

    def _go_aground(self) -> None:
        self._redirect(self._state.progress.ground())
        self._tools.events.publish(
            Noted(
                "warning",
                "All drones are down before the last picture. Resume the capture, or abort it. A"
                " drone that gets a charged battery must be set down at its start place; one that"
                " was not switched off must stay where it landed.",
            )
        )
        self._change("paused")

    async def _watch_drones(self) -> None:
        """Pause when a drone is held; see to it that drones out of the air leave the crew."""
        while True:
            await asyncio.sleep(_POLL_S)
            if asyncio.get_running_loop().time() - self._saved_s > _SIGN_OF_LIFE_S:
                self._save()
            if self._state.progress.phase in (*_STEERED, Phase.GROUNDED):
                self._land_strangers()
            if self._state.progress.phase not in _STEERED:
                continue
            for drone_id in list(self._state.crew):
                drone = self._tools.fleet.drones[drone_id]
                if drone.activity not in ("flying", "holding"):
                    self._lose(drone_id, drone)
                elif drone.held and not self._state.progress.paused:
                    self._tools.events.publish(
                        Noted("warning", "HOLD: the capture waits. Re-arm, then resume.", drone_id)
                    )
                    self.pause()
            if not self._state.crew and self._photographer.taken < self._state.pictures:
                self._go_aground()

    def _land_strangers(self) -> None:
        """Land drones of this capture that are in the air although nobody flies them."""
        for drone_id in self._state.drones:
            drone = self._tools.fleet.drones[drone_id]
            if drone_id not in self._state.crew and drone.activity == "flying":
                text = "It is in the air without being in the crew: it lands."
                self._tools.events.publish(Noted("error", text, drone_id))
                self._tools.fleet.land(drone_id)

    def _lose(self, drone_id: str, drone: Drone) -> None:
        phase = self._state.progress.phase
        reason = drone.verdict.reason or f"left the air in phase {phase}"
        self._state.crew.remove(drone_id)
        self._recorder.dropped[drone_id] = reason
        self._tools.pilot.release([drone_id])
        others = "The others take over its viewpoints." if self._state.crew else ""
        self._tools.events.publish(Noted("error", f"Out of the crew: {reason}. {others}", drone_id))
        self._save()

    # -- keeping ------------------------------------------------------------------------------

    def _finish(self) -> None:
        if self._state.progress.ending is None:
            self._change("succeeded")
        elif self._recorder.error is None:
            self._recorder.error = self._state.progress.ending
            self._change("aborted")
        else:
            self._change("failed")

    def _change(self, state: str) -> None:
        self._recorder.state = state
        self._recorder.enter(self._state.progress.phase)
        self._tools.events.publish(self.status())
        self._save()

    def _save(self) -> None:
        self._saved_s = asyncio.get_running_loop().time()
        self._recorder.save(self.status(), self._state.progress, self._state.seed)
