"""How much an object's box differs from side to side, by its seed geometry.

The pose filter believes in an object of one centre and one height. A long object is seen broadside
and end on: its box shifts and grows by a tenth and more, and a filter that does not know why moves
the drone instead. What is returned here is the deviation from the mean over all azimuths: the mean
is already in the centre and the height that the filter believes.

Symbols: (right, down, log height) as tangents, of a camera that looks at the object's centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.stages import SeedGeometry

Array = NDArray[np.float64]

_AZIMUTHS = 12
_NEAREST_M = 0.3


def view_dependence(seed: SeedGeometry, offset: Array) -> Array:
    """Return by how much (right, down, log height) ``(3,)`` of the box deviate in one view.

    Args:
        seed: The object's geometry.
        offset: Camera centre minus the object's centre ``(3,)``, world metres.
    """
    boxes = seed.boxes or (seed.outer,)
    corners = np.concatenate([box.corners for box in boxes]) - seed.outer.centre
    around = np.arange(_AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
    azimuths = np.append(0.0, around) + np.arctan2(offset[1], offset[0])
    seen = _seen(corners, azimuths, float(np.hypot(*offset[:2])), float(offset[2]))
    return seen[0] - seen[1:].mean(axis=0)


def _seen(corners: Array, azimuths: Array, distance_m: float, height_m: float) -> Array:
    """Return (right, down, log height) ``(n, 3)`` of the corners' box from ``azimuths`` ``(n,)``.

    Args:
        corners: About the object's centre ``(m, 3)``.
        azimuths: Of the cameras, as seen from the centre, radians.
        distance_m: Of the cameras, horizontally.
        height_m: Of the cameras above the centre.
    """
    c, s = np.cos(azimuths)[:, None], np.sin(azimuths)[:, None]
    x, y, z = corners.T
    reach = float(np.hypot(distance_m, height_m))
    level, sink = distance_m / reach, height_m / reach
    # Horizontally towards the camera, and to its right.
    towards, right = c * x + s * y, c * y - s * x
    depth = np.maximum(reach - (level * towards + sink * z), _NEAREST_M)
    u, v = right / depth, (sink * towards - level * z) / depth
    top, bottom = v.min(axis=1), v.max(axis=1)
    return np.stack(
        [
            (u.min(axis=1) + u.max(axis=1)) / 2.0,
            (top + bottom) / 2.0,
            np.log((bottom - top) * reach),
        ],
        axis=1,
    )
