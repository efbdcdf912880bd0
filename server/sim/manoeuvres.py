"""Motions with an end: straight ways, arcs, turns and flips; pure.

A manoeuvre is asked for the velocity it wants at each step and says when it is over. Vectors are
world metres; angles counter-clockwise about +Z.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from server.sim.sensors import Vector

_TURN_RATE_RAD_S = 1.2
# Wider than what hover drift alone keeps the drone off its goal.
_NEAR_M = 0.04
_BRAKING_PER_S = 1.2
_SETTLING_S = 5.0
_TURNED_RAD = math.radians(1.0)
_STILL_RAD_S = math.radians(3.0)
_PATH_STEP_M = 0.02
_FLIP_S = 1.2
_FLIP_CLIMB_M_S = 0.5

SMALLEST_RADIUS_M = 0.5
LARGEST_RADIUS_M = 10.0
_ROUNDING_M = 1e-6  # Points that were turned to the drone's heading are not exact.


class RadiusError(ValueError):
    """Three points lie on no arc that the drone can fly."""


@dataclass(slots=True)
class Manoeuvre:
    """Fly to a place, along a path, or turn.

    Attributes:
        goal: Where it ends, world metres.
        speed_m_s: Speed on the way.
        patience_s: It counts as done after this time, wherever the wind has it by then.
        turn_left_rad: Turn still to make, counter-clockwise positive.
        path: Points of the way, each 2 cm from the last; empty: straight to the goal.
        along_m: How much of the path is behind it.
    """

    goal: Vector
    speed_m_s: float
    patience_s: float
    turn_left_rad: float = 0.0
    path: tuple[Vector, ...] = ()
    along_m: float = 0.0

    @classmethod
    def straight(cls, start: Vector, goal: Vector, speed_m_s: float) -> Manoeuvre:
        """Return the straight way to ``goal``."""
        return cls(goal, speed_m_s, _patience(math.dist(start, goal) / speed_m_s))

    @classmethod
    def turn(cls, place: Vector, left_rad: float) -> Manoeuvre:
        """Return a turn on the spot."""
        return cls(place, 0.3, _patience(abs(left_rad) / _TURN_RATE_RAD_S), left_rad)

    @classmethod
    def arc(cls, start: Vector, via: Vector, end: Vector, speed_m_s: float) -> Manoeuvre:
        """Return the way from ``start`` to ``end`` on the circle through ``via``.

        Raises:
            RadiusError: If the points lie on a line or their circle is too small or too large.
        """
        path = _arc_points(start, via, end)
        length_m = _PATH_STEP_M * len(path)
        return cls(end, speed_m_s, _patience(length_m / speed_m_s), path=path)

    def wanted(self, at: Vector, dt_s: float) -> tuple[Vector, float]:
        """Return the world velocity and turn rate it wants at ``at``, ``dt_s`` further on."""
        self.patience_s -= dt_s
        rate = max(-_TURN_RATE_RAD_S, min(_TURN_RATE_RAD_S, 1.5 * self.turn_left_rad))
        last = len(self.path) - 1
        index = int(self.along_m / _PATH_STEP_M)
        if index < last:
            self.along_m += self.speed_m_s * dt_s
            here, there = self.path[index], self.path[index + 1]
            # Along the path, and back to it as far as it has strayed.
            pull = self.speed_m_s / _PATH_STEP_M
            x, y, z = (pull * (there[i] - here[i]) + 1.5 * (here[i] - at[i]) for i in range(3))
            return (x, y, z), rate
        distance_m = math.dist(self.goal, at)
        if distance_m < 1e-6:
            return (0.0, 0.0, 0.0), rate
        share = min(self.speed_m_s, _BRAKING_PER_S * distance_m) / distance_m
        x, y, z = (share * (self.goal[i] - at[i]) for i in range(3))
        return (x, y, z), rate

    def turned(self, left_rad: float) -> None:
        """Take note of a turn that was made."""
        self.turn_left_rad -= left_rad

    def over(self, at: Vector, turn_rad_s: float) -> bool:
        """Tell whether it has come to its end."""
        if self.patience_s <= 0.0:
            return True
        if self.along_m < _PATH_STEP_M * (len(self.path) - 1):
            return False
        near = math.dist(self.goal, at) < _NEAR_M
        # Ending it at speed would let the lag carry the drone past its goal.
        return near and abs(self.turn_left_rad) < _TURNED_RAD and abs(turn_rad_s) < _STILL_RAD_S


@dataclass(slots=True)
class Flip:
    """Turn over once, on the spot but for a hop.

    Attributes:
        direction: l, r, f or b.
        left_s: Time until it is level again.
    """

    direction: str
    left_s: float = _FLIP_S

    def wanted(self, at: Vector, dt_s: float) -> tuple[Vector, float]:
        """Return the hop that makes room for turning over."""
        self.left_s -= dt_s
        up = _FLIP_CLIMB_M_S if self.left_s > 0.5 * _FLIP_S else -_FLIP_CLIMB_M_S
        return (0.0, 0.0, up), 0.0

    def turned(self, left_rad: float) -> None:
        """A flip makes no turn."""

    def over(self, at: Vector, turn_rad_s: float) -> bool:
        """Tell whether it is level again."""
        return self.left_s <= 0.0

    def lean_rad(self) -> tuple[float, float]:
        """Return how far it has turned over: nose down, right side down."""
        angle = 2.0 * math.pi * (1.0 - max(0.0, self.left_s) / _FLIP_S)
        nose, right = {"f": (1, 0), "b": (-1, 0), "r": (0, 1), "l": (0, -1)}[self.direction]
        return nose * angle, right * angle


def _patience(nominal_s: float) -> float:
    return 1.2 * nominal_s + _SETTLING_S


def _arc_points(start: Vector, via: Vector, end: Vector) -> tuple[Vector, ...]:
    """Return points 2 cm apart on the circle from ``start`` over ``via`` to ``end``."""
    a = np.array(start)
    to_via, to_end = np.array(via) - a, np.array(end) - a
    normal = np.cross(to_via, to_end)
    square = float(normal @ normal)
    if square < 1e-12:
        raise RadiusError("the points lie on a line")
    # Circumcentre of a triangle, relative to its first corner.
    centre = (
        (to_via @ to_via) * np.cross(to_end, normal) + (to_end @ to_end) * np.cross(normal, to_via)
    ) / (2.0 * square)
    radius = float(np.linalg.norm(centre))
    if not SMALLEST_RADIUS_M - _ROUNDING_M <= radius <= LARGEST_RADIUS_M + _ROUNDING_M:
        raise RadiusError(f"a radius of {radius:.2f} m cannot be flown")
    u = -centre / radius
    v = np.cross(normal / math.sqrt(square), u)
    outward = to_end - centre
    # Turning about the normal meets ``via`` before ``end``: that is how the normal was chosen.
    angle = math.atan2(float(outward @ v), float(outward @ u)) % (2.0 * math.pi)
    count = max(2, round(radius * angle / _PATH_STEP_M))
    points = []
    for step in range(count + 1):
        turned = angle * step / count
        x, y, z = a + centre + radius * (math.cos(turned) * u + math.sin(turned) * v)
        points.append((float(x), float(y), float(z)))
    return tuple(points)
