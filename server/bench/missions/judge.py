"""What really happened on a flight: distances, fence, ends. Truth comes in, figures go out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from server.swarm.config import SafetyConfig

Array = NDArray[np.float64]

# A Tello measures 18 cm across its propellers: nearer than this two of them touch or nearly do.
COLLISION_M = 0.25
# From its centre to the tip of a propeller, with a little air.
OBJECT_COLLISION_M = 0.12
_OFF_GROUND_M = 0.08
# Enough for a point every few centimetres of the scenes' surfaces.
SURFACE_POINTS = 4000


@dataclass(frozen=True, slots=True)
class Body:
    """One drone as it truly is.

    Attributes:
        position: Centre ``(3,)``, world metres.
        flying: True while its motors turn or it falls.
    """

    position: Array
    flying: bool


@dataclass(slots=True)
class Judgement:
    """What a judge saw so far.

    Attributes:
        collisions: Each pair, or drone and object, that touched, counted once per touch.
        min_separation_m: Least distance between a flying drone and any other drone.
        fence_violations: Each flight of a drone beyond fence or ceiling, counted once per exit.
        worst_excess_m: How far beyond fence or ceiling at most.
        min_standoff_m: Least distance of a flying drone to the object's surface.
    """

    collisions: int = 0
    min_separation_m: float = float("inf")
    fence_violations: int = 0
    worst_excess_m: float = 0.0
    min_standoff_m: float = float("inf")
    touching: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    outside: set[str] = field(default_factory=set[str])


class Judge:
    """Watches the truth of one flight."""

    def __init__(self, surface: Array, safety: SafetyConfig) -> None:
        """Build it; ``surface`` are points ``(n, 3)`` on the object, a few centimetres apart."""
        self.judgement = Judgement()
        self._surface = KDTree(surface)
        self._safety = safety

    def observe(self, bodies: Mapping[str, Body]) -> None:
        """Judge one moment."""
        in_the_air = {
            name
            for name, body in bodies.items()
            if body.flying and body.position[2] >= _OFF_GROUND_M
        }
        self.judgement.outside &= in_the_air
        for name in in_the_air:
            self._judge_fence(name, bodies[name].position)
            self._judge_object(name, bodies[name].position)
        for one, other in combinations(sorted(bodies), 2):
            if one in in_the_air or other in in_the_air:
                self._judge_pair((one, other), bodies[one].position, bodies[other].position)

    def _judge_pair(self, pair: tuple[str, str], one: Array, other: Array) -> None:
        apart_m = float(np.linalg.norm(one - other))
        self.judgement.min_separation_m = min(self.judgement.min_separation_m, apart_m)
        self._touch(pair, apart_m < COLLISION_M)

    def _judge_object(self, name: str, position: Array) -> None:
        distance_m = float(self._surface.query(position)[0])
        self.judgement.min_standoff_m = min(self.judgement.min_standoff_m, distance_m)
        self._touch((name, "object"), distance_m < OBJECT_COLLISION_M)

    def _touch(self, pair: tuple[str, str], touches: bool) -> None:
        if touches and pair not in self.judgement.touching:
            self.judgement.collisions += 1
            self.judgement.touching.add(pair)
        elif not touches:
            self.judgement.touching.discard(pair)

    def _judge_fence(self, name: str, position: Array) -> None:
        excess_m = max(
            float(np.hypot(position[0], position[1])) - self._safety.fence_radius_m,
            float(position[2]) - self._safety.ceiling_m,
        )
        self.judgement.worst_excess_m = max(self.judgement.worst_excess_m, excess_m)
        if excess_m > 0 and name not in self.judgement.outside:
            self.judgement.fence_violations += 1
            self.judgement.outside.add(name)
        elif excess_m <= 0:
            self.judgement.outside.discard(name)
