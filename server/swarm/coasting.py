"""The coasting rule: no velocity whose last sticks would do harm if the link died now. Pure.

A Tello that hears nothing keeps its last sticks, turn included, and lands by itself after 15 s
wherever it then is. So a velocity is slowed until the whole way that it may take stays inside fence
and ceiling and clear of the object, and does not end above the object.

Symbols: positions and velocities are ``(3,)`` world metres; a way is an array ``(ways, moments,
3)`` of displacements, one way for each factor by which sticks may differ from what they ask for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.swarm.config import SafetyConfig

Array = NDArray[np.float64]

# A coasting drone is where it is believed to be to within this.
_MARGIN_M = 0.35
# Its speed and its turn are those told to within these factors: sticks are no speeds. A slower one
# may fly where a faster one does not: a narrower circle, and a nearer end.
_FACTORS = np.array(list(product((0.9, 1.0, 1.1), (0.85, 1.0, 1.15))))
# When, as shares of ``coast_s``, it must be inside the fence and clear of the object.
_SHARES = np.linspace(0.0, 1.0, 17)[1:]
# When it may come down, seconds, whatever ``coast_s`` is.
_LANDS_S = np.array([14.5, 15.0, 15.5, 16.0])
# Shares of the wished velocity that are tried, the largest first.
_SLOWER = np.concatenate([np.geomspace(1.0, 0.03, 20), [0.0]])
# A way that begins at a limit keeps to it, rounding aside.
_ROUNDING_M = 1e-9


def coastable(
    position: Array,
    velocity: Array,
    yaw_rate: float,
    obstacles: Sequence[Box3],
    config: SafetyConfig,
    unsure_m: float = 0.0,
) -> Array:
    """Return ``velocity``, slowed until a drone that coasts with it stays in free room.

    Sticks are in the body's axes: whoever also turns flies a circle, not a line. A drone that goes
    round the object facing it is at full speed as safe as one that creeps straight on. Whoever is
    past a limit already goes no further past it.

    Args:
        position: Where it is believed to be ``(3,)``.
        velocity: What it is to fly ``(3,)``.
        yaw_rate: How it turns meanwhile, rad/s.
        obstacles: Boxes of the object once it is known, and of no-go volumes.
        config: Fence, ceiling, clearance.
        unsure_m: How far from there it may be; clearance of obstacles grows by it, as independent
            errors add. The fence does not: the planner keeps off it, and in trials flights took
            twice as long.
    """
    headroom_m = max(config.ceiling_m - _MARGIN_M - float(position[2]), 0.0)
    slower = velocity.copy()
    slower[2] = min(float(velocity[2]), headroom_m / config.coast_s)
    way = _ways(slower, yaw_rate, config.coast_s * _SHARES)
    slower[:2] *= _share_inside(position[:2], way[..., :2].reshape(-1, 2), _inside_m(config))
    if not obstacles:
        return slower
    clearance_m = _clearance_m(config, unsure_m)
    return slower * _share_clear(position, slower, yaw_rate, obstacles, clearance_m, config.coast_s)


def past_limit(
    position: Array, obstacles: Sequence[Box3], config: SafetyConfig, unsure_m: float = 0.0
) -> bool:
    """Return whether a drone is nearer to fence or obstacles than a coasting one may come."""
    if float(np.hypot(position[0], position[1])) > _inside_m(config):
        return True
    clearance_m = _clearance_m(config, unsure_m)
    return any(float(_distances_m(position, box)) < clearance_m for box in obstacles)


def _inside_m(config: SafetyConfig) -> float:
    """Return the radius that a coasting drone must be believed inside of."""
    return config.fence_radius_m - _MARGIN_M


def _clearance_m(config: SafetyConfig, unsure_m: float) -> float:
    """Return how far from an obstacle a coasting drone must be believed to stay."""
    return math.hypot(config.coast_clearance_m, unsure_m)


def _distances_m(points: Array, box: Box3, axes: int = 3) -> Array:
    """Return the distances to a box that reaches down without end, or along the first axes."""
    down = np.array([*box.lower[:2], -np.inf])
    away = points - np.minimum(np.maximum(points, down), box.upper)
    return np.sqrt((away[..., :axes] ** 2).sum(axis=-1))


def _share_clear(
    position: Array,
    velocity: Array,
    yaw_rate: float,
    obstacles: Sequence[Box3],
    clearance_m: float,
    coast_s: float,
) -> float:
    """Return the share of ``velocity``, at most 1, with which a coasting drone misses obstacles.

    They reach down without end: a drone that sinks stops above the floor and flies on. Where the
    drone comes down, they are columns without end; a drone above one is asked for that only if any
    share carries it clear.
    """
    # Nearer than it should be already: no nearer.
    rooms_m = [min(clearance_m, float(_distances_m(position, b))) - _ROUNDING_M for b in obstacles]
    way = _ways(velocity, yaw_rate, coast_s * _SHARES)
    end = _ways(velocity, yaw_rate, _LANDS_S)

    def passes(shares: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return for each share whether the whole way is clear, and whether its end is as well."""
        scales = shares[:, None, None, None]  # The scaled way is the way of the scaled velocity.
        ways, ends = position + scales * way, position + scales * end
        clear = np.ones(len(shares), bool)
        lands = np.ones(len(shares), bool)
        for box, room_m in zip(obstacles, rooms_m, strict=True):
            clear &= _distances_m(ways, box).min(axis=(1, 2)) >= room_m
            lands &= _distances_m(ends, box, axes=2).min(axis=(1, 2)) >= clearance_m
        return clear, clear & lands

    if passes(np.ones(1))[1][0]:
        return 1.0
    clear, lands = passes(_SLOWER)
    return float(_SLOWER[int(np.argmax(lands if lands.any() else clear))])


def _ways(velocity: Array, yaw_rate: float, times_s: Array) -> Array:
    """Return where a coasting drone may be after ``times_s``, relative to now."""
    speeds, turns = _FACTORS[:, :1], _FACTORS[:, 1:]
    angles = yaw_rate * turns * times_s
    # Displacement per unit of velocity: the integral of the rotation over time.
    along = speeds * times_s * np.sinc(angles / np.pi)
    aside = speeds * times_s * np.sinc(angles / (2.0 * np.pi)) * np.sin(angles / 2.0)
    x, y, z = velocity
    climbed = z * speeds * times_s
    return np.stack([along * x - aside * y, aside * x + along * y, climbed], axis=-1)


def _share_inside(place: Array, moved: Array, inside_m: float) -> float:
    """Return the largest share s, at most 1, with |place + s moved| <= ``inside_m`` throughout."""
    reach_m = max(inside_m, float(np.hypot(place[0], place[1])))
    a = (moved**2).sum(axis=1)
    half_b = moved @ place
    c = min(float(place @ place) - reach_m**2, 0.0)
    shares = (-half_b + np.sqrt(half_b**2 - a * c)) / np.maximum(a, 1e-12)
    return min(max(float(shares.min()), 0.0), 1.0)
