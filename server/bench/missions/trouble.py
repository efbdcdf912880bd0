"""Lets a case's fault happen: waits for its phase, picks a drone, does it."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

import numpy as np

from server.bench.missions.cases import CONSOLE_FAULTS, Case
from server.bench.missions.outcome import Reaction
from server.mission.commands import CaptureRecord, CaptureRequest, RefusedError
from server.mission.control import Control
from server.mission.events import CaptureChanged
from server.mission.phases import Phase
from server.swarm.fleet import Fleet

_NEWS = 1024
# An operator who has pressed a stop looks for this long before going on.
_LOOK_S = 8.0
_HEARTBEAT_S = 2.0
_IN_EVERY_ROUND = (Phase.FLY, Phase.TUNE, Phase.CAPTURE)


async def fly_with_trouble(
    case: Case, control: Control, trouble: Trouble, longest_s: float
) -> CaptureRecord:
    """Fly a case's capture while its trouble happens; return the capture's record.

    A capture that is not over after ``longest_s`` is given up as it stands. What goes wrong in the
    trouble itself is raised: it would make the figures worthless.
    """
    happening = asyncio.create_task(trouble.happen())
    request = CaptureRequest(pictures=case.pictures, train_seconds=0.0, seed=case.seed)
    record = await control.start_capture(request)
    try:
        async with asyncio.timeout(longest_s):
            record = await control.wait_for_capture(record.status.id)
    except TimeoutError:
        record = control.capture(record.status.id)
    happening.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await happening
    return record


class Trouble:
    """The trouble of one mission.

    Attributes:
        onset_s: When the fault began, None before.
        victim: The drone it happened to, empty for all or none.
    """

    def __init__(
        self, case: Case, control: Control, fleet: Fleet, inject: Callable[[str, str], None]
    ) -> None:
        """Build it; ``inject`` lets a fault happen now: its words, and the drone's id."""
        self.onset_s: float | None = None
        self.victim = ""
        self._case = case
        self._control = control
        self._fleet = fleet
        self._inject = inject
        self._rng = np.random.default_rng([case.seed, 7])

    async def happen(self) -> None:
        """Wait for the phase and let the fault happen somewhere in it."""
        case = self._case
        if case.fault == "planner_hangs":
            self.onset_s = asyncio.get_running_loop().time()
        if not case.fault or case.fault == "planner_hangs":
            return  # The runner of the jobs sees to a planner that hangs.
        present = None
        if case.fault == "operator_gone":
            present = asyncio.create_task(self._be_present())
        if case.fault == "stays_down":
            await self._phase_comes(Phase.PREFLIGHT)  # Later it is no longer on the ground.
        else:
            await self._phase_comes(case.phase)
            await asyncio.sleep(float(self._rng.uniform(0.0, 2.0)))
        victim = str(self._rng.choice(list(self._fleet.drones)))
        self.onset_s = asyncio.get_running_loop().time()
        if case.fault not in CONSOLE_FAULTS:
            self.victim = victim
            self._inject(case.fault, victim)
        else:
            await self._act(victim, present)

    def reactions(self) -> list[Reaction]:
        """Return what the failsafe table did since the fault began."""
        onset_s = self.onset_s
        if onset_s is None:
            return []
        return [
            Reaction(
                round(1000.0 * (note.at_s - onset_s), 1),
                note.drone_id,
                note.fired.failsafe.event,
                note.fired.failsafe.action,
            )
            for note in self._fleet.fired
            if note.at_s >= onset_s
        ]

    async def _phase_comes(self, phase: str) -> None:
        """Wait for a phase; of the phases of each round, for that of the second round."""
        round_index = 1 if phase in _IN_EVERY_ROUND else 0

        def is_there(status: CaptureChanged) -> bool:
            return status.phase == phase and status.round_index >= round_index

        # Some phases are over at once, so it is not enough to look now and then.
        with self._control.events.subscribe(_NEWS) as news:
            for capture in self._control.captures():
                if is_there(capture.status):
                    return
            async for event in news:
                if isinstance(event, CaptureChanged) and is_there(event):
                    return

    async def _be_present(self) -> None:
        while True:
            self._control.note_operator()
            await asyncio.sleep(_HEARTBEAT_S)

    async def _act(self, victim: str, present: asyncio.Task[None] | None) -> None:
        fleet = self._fleet
        match self._case.fault:
            case "hold_all" | "hold_one":
                fleet.hold(None if self._case.fault == "hold_all" else victim)
                await asyncio.sleep(_LOOK_S)
                for drone in fleet.drones.values():
                    drone.rearm()
                await self._resume()
            case "land_all":
                fleet.land()
                await self._phase_comes(Phase.GROUNDED)
                await asyncio.sleep(_LOOK_S)
                await self._resume()
            case "abort":
                await self._abort()
            case "abort_twice":
                await self._abort()
                await asyncio.sleep(1.0)
                await self._abort()
            case "land_one":
                fleet.land(victim)
            case "cut_one":
                fleet.cut_motors(victim)
            case "operator_gone":
                assert present is not None
                present.cancel()

    async def _abort(self) -> None:
        try:
            await self._control.abort_capture(self._control.captures()[0].status.id)
        except RefusedError:
            return  # It is over.

    async def _resume(self) -> None:
        try:
            await self._control.resume_capture(self._control.captures()[0].status.id)
        except RefusedError:
            return  # There was nothing to pause.
