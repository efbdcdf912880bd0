"""Where a drone that has fallen silent in the air may be. Pure.

A Tello keeps its last sticks while it hears nothing, and lands by itself after 15 s. Whether it
still hears is not known when it says nothing, nor which of the newest sticks were the last that it
heard, and how sticks turn into motion is known to some per cent only. So it may be in several
places; whoever is in the air keeps away from all of them.

Symbols: positions and velocities are ``(3,)`` world metres; turns are about +Z, radians per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A Tello that hears nothing for so long lands.
_LANDS_S = 15.0
# One that hears has been told to hover, and soon after to land.
_TOLD_TO_LAND_S = 3.0
# How long it flies on before it follows the order to hover.
_LAG_S = 0.5
# Its sticks do not bring it down further than this.
_LOWEST_M = 0.1
# It sinks at least this fast.
_SINK_M_S = 0.3
# Its turn may differ from what its sticks ask for by these factors.
_TURN_FACTORS = (1.0, 0.85, 1.15)
# Places nearer to each other than this are one.
_SAME_M = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class LastHeard:
    """How a drone flew when it was heard last.

    Attributes:
        position: Where it was.
        velocity: Velocity that it had been told.
        turn_rad_s: Turn that it had been told.
    """

    position: Array
    velocity: Array
    turn_rad_s: float


def coasted(last: LastHeard, silent_s: float, turn_factor: float = 1.0) -> tuple[Array, Array]:
    """Return position and velocity of a drone that hears nothing, ``silent_s`` after the last word.

    Sticks are in its own axes, so it flies along an arc.
    """
    flown_s = min(silent_s, _LANDS_S)
    turned_rad = turn_factor * last.turn_rad_s * flown_s
    chord = last.velocity * flown_s
    chord[:2] *= float(np.sinc(turned_rad / (2.0 * np.pi)))
    position = last.position + turned(chord, turned_rad / 2.0)
    # Sinking, it stops above the floor and flies on.
    position[2] = max(position[2], min(float(last.position[2]), _LOWEST_M))
    if silent_s < _LANDS_S:
        return position, turned(last.velocity, turned_rad)
    return _sunk(position, silent_s - _LANDS_S), np.zeros(3)


def whereabouts(
    last: LastHeard, silent_s: float, others: Sequence[LastHeard] = ()
) -> list[tuple[Array, Array]]:
    """Return the positions and velocities that a silent drone may have, all clearly different.

    Args:
        last: How it most likely flew when it was heard last; its place comes first.
        silent_s: How long ago that was.
        others: How else it may have flown on.
    """
    hears = last.position + last.velocity * min(silent_s, _LAG_S)
    hears = _sunk(hears, silent_s - _TOLD_TO_LAND_S)
    found: list[tuple[Array, Array]] = []
    arcs = [coasted(each, silent_s, f) for each in (last, *others) for f in _TURN_FACTORS]
    for position, velocity in [*arcs, (hears, np.zeros(3))]:
        if all(np.linalg.norm(position - other) > _SAME_M for other, _ in found):
            found.append((position, velocity))
    return found


def turned(velocity: Array, angle_rad: float) -> Array:
    """Return ``velocity`` ``(3,)`` turned about +Z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array(
        [c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]]
    )


def _sunk(position: Array, seconds: float) -> Array:
    """Return where a drone is that has been sinking for ``seconds``; negative ones count as 0."""
    height_m = max(0.0, float(position[2]) - _SINK_M_S * max(0.0, seconds))
    return np.array([position[0], position[1], height_m])
