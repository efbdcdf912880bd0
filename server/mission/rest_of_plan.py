"""What is left of a plan, after each round and after interruptions.

Drones drop out, pictures fail, the operator marks parts, wants more pictures or bars a place: what
is left to be photographed is then shared out or planned anew, for the drones that fly.
"""

from __future__ import annotations

import asyncio

from server.mission.capture import Photographer
from server.mission.config import FlightConfig
from server.mission.events import EventStream, Level, Noted
from server.mission.no_go import NoGo
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.state import MissionState
from server.mission.takeover import orphans, share_out
from server.planner.config import FlightSpace
from server.planner.no_go import intrusion
from server.stages import Assignment, Viewpoint
from server.swarm.fleet import Fleet


class RestOfPlan:
    """Keeps a mission's assignment fit for what has become of it."""

    def __init__(
        self,
        state: MissionState,
        fleet: Fleet,
        pilot: Pilot,
        photographer: Photographer,
        planning: Planning,
        no_go: NoGo,
        config: FlightConfig,
        events: EventStream,
    ) -> None:
        """Build it on the parts of the mission whose ``state`` it changes."""
        self._state = state
        self._fleet = fleet
        self._pilot = pilot
        self._photographer = photographer
        self._planning = planning
        self._no_go = no_go
        self._config = config
        self._events = events

    def space(self) -> FlightSpace:
        """Return the room that drones may use now."""
        return self._no_go.within(self._config.planner).space

    async def plan_anew(self, next_round: int) -> None:
        """Plan what is left anew when the operator wants other parts or more pictures meanwhile.

        Or after every round but the last of the plan, where the settings say so.
        """
        state, planning = self._state, self._planning
        more = state.more_wanted
        each = planning.each_round and next_round < len(state.assignment.rounds)
        if not (planning.outdated or more or each) or not state.crew or state.seed is None:
            self._leave_out_barred(next_round)
            return
        state.more_wanted = False
        photographer = self._photographer
        left = state.pictures - photographer.taken
        poses = {d: self._pilot.pose(d) for d in state.crew}
        camera = self._fleet.drones[state.crew[0]].config
        assignment = await planning.rounds_anew(state.seed, poses, camera, left, photographer.poses)
        if assignment is None and next_round < len(state.assignment.rounds):
            state.more_wanted = state.more_wanted or more  # After the next round, perhaps.
        elif assignment is None:
            if more:
                state.pictures = photographer.taken
                self._note("warning", f"It stays at {photographer.taken} pictures.")
        else:
            flown = state.assignment.rounds[:next_round]
            state.assignment = Assignment(flown + assignment.rounds)
            state.progress = state.progress.with_rounds(len(state.assignment.rounds))
        self._leave_out_barred(next_round)

    def _leave_out_barred(self, next_round: int) -> None:
        """Give up viewpoints that stand in no-go volumes by now, and no plan has replaced."""
        state = self._state
        rows, space = state.assignment.rounds[next_round:], self.space()
        kept = tuple(
            {d: view for d, view in row.items() if not intrusion(view.position_world, space)}
            for row in rows
        )
        given_up = sum(map(len, rows)) - sum(map(len, kept))
        if given_up:
            left = tuple(row for row in kept if row)
            state.assignment = Assignment(state.assignment.rounds[:next_round] + left)
            state.progress = state.progress.with_rounds(len(state.assignment.rounds))
            text = f"{given_up} viewpoints are left out: they stand too near a no-go volume."
            self._note("warning", text)

    async def share_out(self) -> None:
        """After an interruption: share out all viewpoints without a picture, from this round on."""
        state, now = self._state, self._state.progress.round_index
        left = [
            viewpoint
            for row in state.assignment.rounds[now:]
            for viewpoint in row.values()
            if id(viewpoint) not in state.captured
        ]
        if left:
            begun = Assignment(state.assignment.rounds[:now])
            await self._assign_anew(begun, now, left)

    async def regroup(self, next_round: int, taken: set[str]) -> None:
        """Share out anew the viewpoints that nobody would go to."""
        state = self._state
        orphaned = orphans(state.assignment, next_round, taken, state.crew)
        last = next_round >= len(state.assignment.rounds)
        # A viewpoint without a clean picture waits for the end, and gets one more chance there.
        dropped_out = any(d not in state.crew for row in state.assignment.rounds for d in row)
        if not orphaned or not state.crew or (not dropped_out and (not last or state.missed_once)):
            return
        state.missed_once = state.missed_once or last
        await self._assign_anew(state.assignment, next_round, orphaned)

    async def _assign_anew(
        self, assignment: Assignment, next_round: int, orphaned: list[Viewpoint]
    ) -> None:
        state = self._state
        assert state.seed is not None
        poses = {d: self._pilot.pose(d) for d in state.crew}
        centre, space = state.seed.outer.centre, self.space()
        state.assignment, given_up = await asyncio.to_thread(
            share_out, assignment, next_round, orphaned, poses, centre, space
        )
        rounds = max(len(state.assignment.rounds), state.progress.round_index + 1)
        state.progress = state.progress.with_rounds(rounds)
        taken_over = len(orphaned) - given_up
        self._note(
            "info", f"{taken_over} of {len(orphaned)} viewpoints taken over, {rounds} rounds now."
        )

    def _note(self, level: Level, text: str) -> None:
        self._events.publish(Noted(level, text))
