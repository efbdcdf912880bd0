"""What a mission knows as it goes; owned by the event loop, changed by course and steps alone."""

from __future__ import annotations

from dataclasses import dataclass, field

from server.geometry.boxes import Box3
from server.mission.phases import Progress
from server.stages import Assignment, SeedGeometry, View


@dataclass(slots=True)
class MissionState:
    """The mission's knowledge.

    Attributes:
        drones: All drones of the capture.
        crew: Those that fly it now; a drone that leaves the air leaves the crew.
        progress: Place in the course.
        pictures: How many pictures are wanted in all.
        more_wanted: True while some of them are in no plan yet.
        seed: The seed geometry once known.
        views: Pictures that the seed geometry is made from.
        assignment: Who goes where; rows before the present round are history.
        captured: Identities of the viewpoints whose picture is on disk.
        missed_once: True once the viewpoints without a clean picture have had their second chance.
        commanded: How many viewpoints the drones were sent to so far.
        stops_at_abort: How often each drone had been stopped when the operator aborted.
    """

    drones: tuple[str, ...]
    crew: list[str]
    progress: Progress
    pictures: int
    more_wanted: bool = False
    seed: SeedGeometry | None = None
    views: list[View] = field(default_factory=list)
    assignment: Assignment = field(default_factory=lambda: Assignment(()))
    captured: set[int] = field(default_factory=set[int])
    missed_once: bool = False
    commanded: int = 0
    stops_at_abort: dict[str, int] = field(default_factory=dict[str, int])

    @property
    def object_box(self) -> Box3 | None:
        """The object's outer box, world, once known."""
        return None if self.seed is None else self.seed.outer
