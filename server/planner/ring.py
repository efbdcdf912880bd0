"""The standard placement: drones evenly on one circle, all facing the object's centre.

It is both the way the first pictures are taken and the baseline that planning has to beat.

Symbols: azimuths are of the drone as seen from the target's centre, counter-clockwise about world
+Z from +X; a drone at azimuth a faces the centre with heading a + pi.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle
from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.planner.config import PlannerConfig
from server.planner.errors import PlanError
from server.planner.no_go import intrusion
from server.stages import Assignment, Viewpoint

Array = NDArray[np.float64]
Rounds = tuple[tuple[Viewpoint, ...], ...]


def facing(centre_world: Array, azimuth_rad: float, radius_m: float, height_m: float) -> Viewpoint:
    """Return the viewpoint at azimuth, radius and height that faces ``centre_world`` ``(3,)``."""
    position = np.array(
        [
            centre_world[0] + radius_m * np.cos(azimuth_rad),
            centre_world[1] + radius_m * np.sin(azimuth_rad),
            height_m,
        ]
    )
    return Viewpoint(position, wrap_angle(azimuth_rad + np.pi))


def frame_fill(
    target: Box3, viewpoint: Viewpoint, intrinsics: Intrinsics, tilt_rad: float
) -> float:
    """Return the larger of width and height of ``target`` in the picture, as shares of the frame.

    Infinite when a corner is not in front of the camera.
    """
    pixels, depths = intrinsics.project(target.corners, viewpoint.T_world_cam(tilt_rad))
    if (depths <= 0.05).any():
        return float("inf")
    extent = np.ptp(pixels, axis=0)
    return float(max(extent[0] / intrinsics.width, extent[1] / intrinsics.height))


def standard_ring(
    target: Box3,
    drones: int,
    rounds: int,
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: PlannerConfig,
    start_azimuths: Sequence[float],
) -> Rounds:
    """Return the viewpoints of the standard placement.

    ``drones`` drones stand 360/K degrees apart and step 360/(K rounds) degrees counter-clockwise
    per round, at one height and one radius. The circle is turned to lie as near as it can to
    ``start_azimuths``, and the drones keep their cyclic order.

    Args:
        target: The object's outer box.
        drones: K, the number of drones.
        rounds: Pictures per drone.
        intrinsics: Camera.
        tilt_rad: How far the camera looks down.
        config: Space and fill.
        start_azimuths: Present azimuth of each drone about the target's centre, radians.

    Returns:
        Per round one viewpoint per drone, in the order of ``start_azimuths``.

    Raises:
        ValueError: If the counts are not positive or do not match.
        PlanError: If no such circle fits between standoff and fence.
    """
    if drones < 1 or rounds < 1:
        raise ValueError("a ring needs at least one drone and one round")
    step = 2.0 * np.pi / (drones * rounds)
    slots = _slots(start_azimuths, drones)
    azimuths = slots[None, :] + step * np.arange(rounds)[:, None]
    radius = _ring_radius(target, drones, intrinsics, tilt_rad, config)
    height = _ring_height(target, radius, tilt_rad, config)
    views = tuple(
        tuple(facing(target.centre, float(a), radius, height) for a in row) for row in azimuths
    )
    places = np.array([view.position_world for row in views for view in row])
    if intrusion(places, config.space).any():
        raise PlanError("the ring does not fit: it passes through a no-go volume")
    return views


def ring_assignment(drone_ids: Sequence[str], rounds: Rounds) -> Assignment:
    """Name the drones of a ring; ``drone_ids`` is in the order of the ring's start azimuths."""
    return Assignment(tuple(dict(zip(drone_ids, views, strict=True)) for views in rounds))


def _slots(start_azimuths: Sequence[float], drones: int) -> Array:
    """Return evenly spaced azimuths ``(drones,)`` nearest to the present ones, order kept."""
    start = np.asarray(start_azimuths, float) % (2.0 * np.pi)
    if len(start) != drones:
        raise ValueError(f"start_azimuths has {len(start)} entries for {drones} drones")
    rank = np.empty(drones)
    rank[np.argsort(start, kind="stable")] = np.arange(drones)
    even = 2.0 * np.pi * rank / drones
    phase = float(np.angle(np.exp(1j * (start - even)).sum()))
    return phase + even


def _ring_height(target: Box3, radius: float, tilt_rad: float, config: PlannerConfig) -> float:
    """Return the height at which the optical axis meets the target's centre, within the fence."""
    height = float(target.centre[2] + radius * np.tan(tilt_rad))
    return float(np.clip(height, config.space.floor_m, config.space.ceiling_m))


def _ring_radius(
    target: Box3, drones: int, intrinsics: Intrinsics, tilt_rad: float, config: PlannerConfig
) -> float:
    """Return the radius at which the fill is reached, not nearer than standoff and separation."""
    space = config.space
    reach = float(np.hypot(*(target.size[:2] / 2.0)))
    nearest = reach + space.standoff_m
    if drones > 1:
        nearest = max(nearest, space.separation_m / (2.0 * np.sin(np.pi / drones)))
    farthest = space.fence_radius_m - float(np.hypot(*target.centre[:2]))
    if reach + space.view_standoff_m <= farthest - config.candidates.off_fence_m:
        # Drones creep nearer to the object, and to the fence as well.
        nearest = max(nearest, reach + space.view_standoff_m)
    if nearest > farthest:
        raise PlanError(
            f"the ring does not fit: standoff and separation need {nearest:.2f} m from the "
            f"object, the fence leaves {farthest:.2f} m"
        )

    def fill(radius: float) -> float:
        height = _ring_height(target, radius, tilt_rad, config)
        views = (facing(target.centre, a, radius, height) for a in np.arange(8) * np.pi / 4)
        return max(frame_fill(target, view, intrinsics, tilt_rad) for view in views)

    low, high = nearest, farthest
    if fill(low) <= config.ring.fill:
        return low
    if fill(high) > config.ring.fill:
        return high
    while high - low > 1e-3:
        middle = (low + high) / 2.0
        low, high = (low, middle) if fill(middle) <= config.ring.fill else (middle, high)
    return high
