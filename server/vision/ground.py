"""What the floor says about a picture: where free floor must be, and where an object's foot.

The object stands on the floor near the middle of a fence that has been cleared of everything else.
So whatever is seen in front of free floor, and does not look like floor, is the object; and its
foot appears between the rows at which the floor is as near and as far as the object can be.

Symbols: h the camera's height above the floor, d a horizontal distance, v a picture row (down).
Masks are working pixels, rows full-picture pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose
from server.vision.masks import Mask

_FOOT_TOLERANCE = 8.0


@dataclass(frozen=True, slots=True)
class Ground:
    """The rows that matter, full-picture pixels.

    Attributes:
        free_px: From this row downwards nothing but free floor lies behind the object.
        foot_far_px: Row of the floor at the farthest distance the object may stand at.
        foot_near_px: Row of the floor at the nearest.
    """

    free_px: float
    foot_far_px: float
    foot_near_px: float


def ground_seen(
    pose: CameraPose,
    distance_m: float,
    uncertainty_m: float,
    clear_m: float,
    intrinsics: Intrinsics,
) -> Ground | None:
    """Return the rows for a camera that looks towards the object, None too near the floor.

    Args:
        pose: The camera's believed pose.
        distance_m: Horizontal distance to the object's centre.
        uncertainty_m: How wrong that may be, the object's own extent included.
        clear_m: How far beyond the object the floor is surely free.
        intrinsics: The camera.
    """
    height_m = float(pose.position_world[2])
    if height_m < 0.3:
        return None
    forward = pose.T_world_cam[:3, 2]
    below_rad = -float(np.arcsin(np.clip(forward[2], -1.0, 1.0)))

    def row(d: float) -> float:
        tangent = np.tan(np.arctan2(height_m, d) - below_rad)
        return float(intrinsics.cy + intrinsics.fy * tangent)

    nearest = max(0.3, 0.4 * distance_m, distance_m - uncertainty_m)
    return Ground(row(distance_m + clear_m), row(distance_m + uncertainty_m), row(nearest))


def foot_rows(ground: Ground, shape: tuple[int, int], scale: float) -> tuple[float, float]:
    """Return the uppermost and the lowest row, working pixels, at which an object can stand.

    Args:
        ground: What the floor says.
        shape: Rows and columns of the working picture. A foot that may lie below the picture has
            no lowest row.
        scale: Full-picture pixels per working pixel.
    """
    lowest = ground.foot_near_px / scale
    if lowest >= shape[0] - 2:
        lowest = np.inf
    return ground.foot_far_px / scale - _FOOT_TOLERANCE, lowest + _FOOT_TOLERANCE


def foot_factor(mask: Mask, ground: Ground, scale: float) -> float:
    """Return how well a mask's lowest row fits an object that stands on the floor, 0 to 1."""
    ys = np.nonzero(mask.any(axis=1))[0]
    if len(ys) == 0:
        return 0.0
    lowest = float(ys[-1])
    uppermost_foot, lowest_foot = foot_rows(ground, (mask.shape[0], mask.shape[1]), scale)
    if lowest < uppermost_foot:
        return 0.03
    return 0.3 if lowest > lowest_foot else 1.0
