"""The parts of the object that the operator wants to have better pictures of.

A part is drawn as a box in a drone's picture. What it means in the world is known once there is a
seed geometry: until then the drawing waits together with the pose it was made from, so a part can
be marked from the moment that the drones look at the object. Every plan asks for the parts anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.mission.commands import RefusedError, UnknownError
from server.mission.events import Event, EventStream, Noted, PrioritiesChanged, PriorityPart
from server.mission.pilot import Pilot
from server.stages import CameraPose, Priority, SeedGeometry
from server.swarm.drone import Drone
from server.vision.parts import drawn_part

Array = NDArray[np.float64]

_MOST = 12


@dataclass(frozen=True, slots=True, eq=False)
class _Drawing:
    """A part with the camera pose of the picture that it was drawn in."""

    part: PriorityPart
    pose: CameraPose


class Priorities:
    """Keeps the operator's parts of priority and finds them on the object."""

    def __init__(self, drones: Mapping[str, Drone], pilot: Pilot, events: EventStream) -> None:
        self._drones = drones
        self._pilot = pilot
        self._events = events
        self._drawings: list[_Drawing] = []
        self._count = 0
        self._planned: tuple[str, ...] = ()

    @property
    def parts(self) -> tuple[PriorityPart, ...]:
        """The parts as they stand."""
        return tuple(drawing.part for drawing in self._drawings)

    @property
    def unplanned(self) -> bool:
        """True when parts were marked or dropped since a plan asked for them."""
        return tuple(part.id for part in self.parts) != self._planned

    def standing(self) -> list[Event]:
        """Return what a newcomer has to know."""
        return [PrioritiesChanged(self.parts)] if self._drawings else []

    def begin_capture(self) -> None:
        """Forget the parts of the object of the capture before."""
        self._planned = ()
        if self._drawings:
            self._drawings.clear()
            self._tell()

    def add(
        self,
        drone_id: str,
        drawn: tuple[float, float, float, float],
        weight: float,
        captured_s: float,
    ) -> PriorityPart:
        """Keep a box ``drawn`` in the picture of ``captured_s``, in shares of it.

        Raises:
            RefusedError: If there are too many already, or nothing of the object is there.
        """
        if len(self._drawings) >= _MOST:
            raise RefusedError(f"there are {_MOST} parts of priority already; drop one first")
        pose = self._pilot.pose(drone_id, captured_s)
        part = PriorityPart(f"part-{self._count + 1}", drone_id, drawn, weight)
        seed = self._pilot.seed
        if seed is not None:
            box = self._box_of(part, pose, seed)
            if box is None:
                raise RefusedError("nothing of the object's geometry lies in the drawn box")
            part = replace(part, box=box)
        self._count += 1
        self._drawings.append(_Drawing(part, pose))
        self._tell()
        when = "the viewpoints left are planned anew" if seed is not None else "the plan knows it"
        text = f"Part marked, it counts {weight:g} times as much: {when}."
        self._events.publish(Noted("info", text, drone_id))
        return part

    def drop(self, part_id: str | None = None) -> None:
        """Forget one part, or all when None; raises UnknownError."""
        left = [] if part_id is None else [d for d in self._drawings if d.part.id != part_id]
        if part_id is not None and len(left) == len(self._drawings):
            raise UnknownError(f"there is no part of priority {part_id!r}")
        self._drawings = left
        self._tell()

    def of_seed(self, seed: SeedGeometry) -> tuple[Priority, ...]:
        """Return the parts of ``seed``; a part that shows nothing of it is dropped and told."""
        kept: list[_Drawing] = []
        changed = False
        for drawing in self._drawings:
            part = drawing.part
            if part.box is None:
                changed = True
                box = self._box_of(part, drawing.pose, seed)
                if box is None:
                    text = "A part of priority that was drawn here shows nothing of the object."
                    self._events.publish(Noted("warning", text, part.drone_id))
                    continue
                drawing = replace(drawing, part=replace(part, box=box))
            kept.append(drawing)
        self._drawings = kept
        self._planned = tuple(drawing.part.id for drawing in kept)
        if changed:
            self._tell()
        found = ((drawing.part.box, drawing.part.weight) for drawing in kept)
        return tuple(Priority(box, weight) for box, weight in found if box is not None)

    def _box_of(self, part: PriorityPart, pose: CameraPose, seed: SeedGeometry) -> Box3 | None:
        camera = self._drones[part.drone_id].config.intrinsics
        size = np.tile(np.array([camera.width, camera.height], float), 2)
        xyxy_px: Array = np.array(part.drawn) * size - 0.5
        return drawn_part(seed, pose.T_world_cam, camera, xyxy_px)

    def _tell(self) -> None:
        self._events.publish(PrioritiesChanged(self.parts))
