"""The phases of a mission as a pure state machine: no clock, no drones, only what follows what.

``preflight -> take_off -> centre -> seed -> plan -> (fly -> tune -> capture) x rounds -> land ->
train -> done``. An abort or a fault at any moment before landing leads to ``land`` and then to
``ended``; after landing it leads to ``ended`` at once. Pausing keeps the phase.

When every drone has left the air before the last picture, the mission is ``grounded``: it waits,
paused, for fresh batteries and the operator. Resumed, it goes through ``preflight``, ``take_off``
and ``centre`` again and then on to the round it was in (or to ``seed``, when nothing was planned).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum


class Phase(StrEnum):
    """Where a mission is."""

    PREFLIGHT = "preflight"
    TAKE_OFF = "take_off"
    CENTRE = "centre"
    SEED = "seed"
    PLAN = "plan"
    FLY = "fly"
    TUNE = "tune"
    CAPTURE = "capture"
    GROUNDED = "grounded"
    LAND = "land"
    TRAIN = "train"
    DONE = "done"
    ENDED = "ended"


AIRBORNE = frozenset(
    {
        Phase.TAKE_OFF,
        Phase.CENTRE,
        Phase.SEED,
        Phase.PLAN,
        Phase.FLY,
        Phase.TUNE,
        Phase.CAPTURE,
        Phase.LAND,
    }
)
_ONCE_BEFORE = (Phase.PREFLIGHT, Phase.TAKE_OFF, Phase.CENTRE, Phase.SEED, Phase.PLAN)
_EACH_ROUND = (Phase.FLY, Phase.TUNE, Phase.CAPTURE)
_ONCE_AFTER = (Phase.LAND, Phase.TRAIN, Phase.DONE)


@dataclass(frozen=True, slots=True)
class Progress:
    """A mission's place in its course.

    Attributes:
        phase: Where it is.
        round_index: Round being flown, from 0.
        rounds: Rounds planned, at least one.
        paused: True while it waits for the operator.
        planned: True once the viewpoints are known.
        ending: Why it is on its way out before its time, None when it is not.
    """

    phase: Phase
    round_index: int
    rounds: int
    paused: bool = False
    planned: bool = False
    ending: str | None = None

    @classmethod
    def start(cls, rounds: int) -> Progress:
        """Return the beginning of a mission of ``rounds`` rounds.

        Raises:
            ValueError: If there is no round.
        """
        if rounds < 1:
            raise ValueError("a mission needs at least one round")
        return cls(Phase.PREFLIGHT, 0, rounds)

    @property
    def over(self) -> bool:
        """True when nothing follows."""
        return self.phase in (Phase.DONE, Phase.ENDED)

    def advance(self) -> Progress:
        """Return the place after the present phase has been completed.

        Raises:
            ValueError: If the mission is over or paused.
        """
        if self.over:
            raise ValueError(f"nothing follows {self.phase}")
        if self.paused:
            raise ValueError("a paused mission does not advance")
        if self.phase is Phase.LAND and self.ending is not None:
            return replace(self, phase=Phase.ENDED)
        if self.phase is Phase.CAPTURE:
            if self.round_index + 1 < self.rounds:
                return replace(self, phase=Phase.FLY, round_index=self.round_index + 1)
            return replace(self, phase=Phase.LAND)
        if self.phase is Phase.CENTRE and self.planned:
            return replace(self, phase=Phase.FLY)
        if self.phase is Phase.PLAN:
            return replace(self, phase=Phase.FLY, planned=True)
        for course in (_ONCE_BEFORE + _EACH_ROUND[:1], _EACH_ROUND, _ONCE_AFTER):
            if self.phase in course[:-1]:
                return replace(self, phase=course[course.index(self.phase) + 1])
        raise ValueError(f"nothing follows {self.phase}")

    def end(self, reason: str) -> Progress:
        """Return the way out, for ``reason``: landing while airborne, else the end.

        Raises:
            ValueError: If the mission is already over.
        """
        if self.over:
            raise ValueError("the mission is already over")
        phase = Phase.LAND if self.phase in AIRBORNE else Phase.ENDED
        return replace(self, phase=phase, ending=self.ending or reason, paused=False)

    def with_rounds(self, rounds: int) -> Progress:
        """Return the same place in a course of ``rounds`` rounds.

        Raises:
            ValueError: If the round being flown is not among them.
        """
        if rounds <= self.round_index:
            raise ValueError(f"round {self.round_index + 1} of {rounds}")
        return replace(self, rounds=rounds)

    def ground(self) -> Progress:
        """Return the wait for fresh batteries and the operator.

        Raises:
            ValueError: If the mission does not fly and is not about to fly again.
        """
        returning = self.planned and self.phase is Phase.PREFLIGHT
        if (self.phase not in AIRBORNE and not returning) or self.phase is Phase.LAND:
            raise ValueError(f"a mission cannot be grounded in phase {self.phase}")
        return replace(self, phase=Phase.GROUNDED, paused=True)

    def pause(self) -> Progress:
        """Return the same place, paused.

        Raises:
            ValueError: If it cannot wait: on the ground before take-off, landing, or over.
        """
        if self.phase not in AIRBORNE or self.phase in (Phase.TAKE_OFF, Phase.LAND):
            raise ValueError(f"a mission cannot pause in phase {self.phase}")
        return replace(self, paused=True)

    def resume(self) -> Progress:
        """Return the same place, going on.

        Raises:
            ValueError: If it is not paused.
        """
        if not self.paused:
            raise ValueError("the mission is not paused")
        phase = Phase.PREFLIGHT if self.phase is Phase.GROUNDED else self.phase
        return replace(self, phase=phase, paused=False)

    def fraction(self) -> float:
        """Return how much of the course lies behind, 0 to 1, counted in phases."""
        before, each, after = len(_ONCE_BEFORE), len(_EACH_ROUND), len(_ONCE_AFTER)
        total = before + each * self.rounds + after - 1
        if self.over:
            return 1.0
        if self.planned and self.phase in (Phase.GROUNDED, *_ONCE_BEFORE):
            done = before + each * self.round_index
        elif self.phase is Phase.GROUNDED:
            done = 0
        elif self.phase in _ONCE_BEFORE:
            done = _ONCE_BEFORE.index(self.phase)
        elif self.phase in _EACH_ROUND:
            done = before + each * self.round_index + _EACH_ROUND.index(self.phase)
        else:
            done = before + each * self.rounds + _ONCE_AFTER.index(self.phase)
        return done / total
