"""What came of one mission of the bench."""

from __future__ import annotations

from dataclasses import dataclass


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
        min_separation_m: Least distance of a flying drone to another one.
        min_standoff_m: Least distance of a flying drone to the object's surface.
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
    min_separation_m: float
    min_standoff_m: float
    fence_violations: int
    worst_excess_m: float
    unsafe_end: bool
    onset: str
    reactions: list[Reaction]
    dropped: dict[str, str]
