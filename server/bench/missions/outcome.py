"""What came of one mission of the bench."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from server.bench.missions.cases import Case
from server.bench.missions.judge import Judgement
from server.mission.commands import CaptureRecord
from server.store.runs import RunFolder


@dataclass(frozen=True, slots=True)
class Reaction:
    """What the console did after a fault began.

    Attributes:
        after_ms: How long after.
        drone_id: For which drone.
        event: The failsafe's event.
        action: What it did.
    """

    after_ms: float
    drone_id: str
    event: str
    action: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """One mission.

    Attributes:
        name: The case's name.
        scene: What stood in the middle.
        fault: What went wrong, empty for nothing.
        happened: Whether it did; a phase that never came lets nothing happen in it.
        phase: When.
        loss: Share of datagrams lost all the time.
        real_udp: Whether it flew over real sockets with real video.
        state: How the capture ended.
        error: What it said about it.
        images: Pictures taken.
        seconds: Simulated seconds by phase.
        flight_s: Simulated seconds from the first take-off to the last touch-down.
        wall_s: Seconds it took to simulate.
        collisions: Touches between drones, or of a drone with the object.
        min_separation_m: Least distance of a flying drone to another one, None when none flew.
        min_standoff_m: Least distance of a flying drone to the object's surface, likewise.
        fence_violations: Times a drone left fence or ceiling.
        worst_excess_m: How far at most.
        unsafe_end: True when a drone was neither down nor held at the end.
        onset: What was the fault's drone, empty for all or for no fault.
        reactions: What fired after the fault.
        dropped: Why drones left the crew.
    """

    name: str
    scene: str
    fault: str
    happened: bool
    phase: str
    loss: float
    real_udp: bool
    state: str
    error: str | None
    images: int
    seconds: dict[str, float]
    flight_s: float
    wall_s: float
    collisions: int
    min_separation_m: float | None
    min_standoff_m: float | None
    fence_violations: int
    worst_excess_m: float
    unsafe_end: bool
    onset: str
    reactions: list[Reaction]
    dropped: dict[str, str]


def outcome_of(
    case: Case,
    record: CaptureRecord,
    judgement: Judgement,
    reactions: list[Reaction],
    *,
    happened: bool,
    victim: str,
    real_udp: bool,
    flight_s: float,
    wall_s: float,
    unsafe_end: bool,
) -> Outcome:
    """Return what came of ``case``, by its record, the judge and what fired."""
    state = RunFolder(Path(record.status.run)).state() or {}
    return Outcome(
        name=case.name,
        scene=case.scene,
        fault=case.fault,
        happened=happened,
        phase=case.phase,
        loss=case.loss,
        real_udp=real_udp,
        state=record.status.state,
        error=record.status.error,
        images=record.status.images,
        seconds=state.get("seconds", {}),
        flight_s=round(flight_s, 2),
        wall_s=round(wall_s, 2),
        collisions=judgement.collisions,
        min_separation_m=_metres(judgement.min_separation_m),
        min_standoff_m=_metres(judgement.min_standoff_m),
        fence_violations=judgement.fence_violations,
        worst_excess_m=round(judgement.worst_excess_m, 3),
        unsafe_end=unsafe_end,
        onset=victim,
        reactions=reactions,
        dropped=state.get("dropped", {}),
    )


def _metres(distance: float) -> float | None:
    return round(distance, 3) if math.isfinite(distance) else None
