"""The finite set P of poses that a picture may be taken from.

Candidates stand on shells around the seed geometry. A shell is not a sphere: at every azimuth and
height it lies at a factor times the nearest distance from which the whole object is in the picture
and the standoff is kept, because a drone cannot tilt its camera and so the best distance depends
on the height.

Symbols: ``u`` points from the object's centre to the drone (horizontal), ``r`` is the horizontal
distance of the drone from the centre's vertical, ``(right, down, forward)`` are camera axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.planner.config import CandidateConfig, FlightSpace, PlannerConfig
from server.planner.errors import PlanError
from server.planner.no_go import intrusion
from server.planner.ring import facing
from server.planner.surfaces import segments_blocked
from server.stages import SeedGeometry, Viewpoint

Array = NDArray[np.float64]


def generate_candidates(
    seed: SeedGeometry,
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: PlannerConfig,
    obstacles: Sequence[Box3] = (),
) -> tuple[Viewpoint, ...]:
    """Return the feasible poses around ``seed``, all facing its centre.

    A pose is feasible when the whole object is in the picture (with a margin; where in the picture
    does not matter), the fence, floor, ceiling, standoff and no-go volumes are kept and no
    obstacle is between. The standoff is that of viewpoints where half of all poses are left then;
    poses near the fence are left out likewise.

    Args:
        seed: The object.
        intrinsics: Camera.
        tilt_rad: How far the camera looks down.
        config: Space and shells.
        obstacles: Boxes of other things that block sight.

    Raises:
        PlanError: If no pose is left; the text names the constraint that ruled out the last ones.
    """
    space, azimuths = config.space, config.candidates.azimuths
    near = _feasible(seed, intrinsics, tilt_rad, config, obstacles, azimuths, space.standoff_m)
    standoff_m = space.standoff_m
    if space.view_standoff_m > space.standoff_m:
        try:
            far = _feasible(
                seed, intrinsics, tilt_rad, config, obstacles, azimuths, space.view_standoff_m
            )
        except PlanError:
            far = ()
        if 2 * len(far) >= len(near):
            near, standoff_m = far, space.view_standoff_m
    for doublings in range(1, 4):
        if len(near) >= config.candidates.minimum:
            break
        azimuths = config.candidates.azimuths * 2**doublings
        near = _feasible(seed, intrinsics, tilt_rad, config, obstacles, azimuths, standoff_m)
    return near


def whole_in_view(
    target: Box3,
    positions: Array,
    yaws: Array,
    intrinsics: Intrinsics,
    tilt_rad: float,
    margin: float,
) -> NDArray[np.bool_]:
    """Return from which ``positions`` ``(n, 3)`` with headings ``(n,)`` all corners are in view."""
    inset = margin * min(intrinsics.width, intrinsics.height)
    inside = np.zeros(len(positions), bool)
    for index, (position, yaw) in enumerate(zip(positions, yaws, strict=True)):
        view = Viewpoint(position, float(yaw))
        pixels, depths = intrinsics.project(target.corners, view.T_world_cam(tilt_rad))
        inside[index] = bool((depths > 0.05).all() and intrinsics.contains(pixels, inset).all())
    return inside


def _feasible(
    seed: SeedGeometry,
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: PlannerConfig,
    obstacles: Sequence[Box3],
    azimuth_count: int,
    standoff_m: float,
) -> tuple[Viewpoint, ...]:
    space, shells = config.space, config.candidates
    centre = seed.outer.centre
    _refuse_too_large(seed.outer, space)
    highest_m = min(space.ceiling_m, float(seed.outer.upper[2]) + shells.above_m)
    azimuth, height, factor = (
        grid.ravel()
        for grid in np.meshgrid(
            np.arange(azimuth_count) * 2.0 * np.pi / azimuth_count,
            np.linspace(space.floor_m, max(highest_m, space.floor_m), shells.heights),
            np.array(shells.radius_factors),
            indexing="ij",
        )
    )
    view_radius = _nearest_radius_in_view(seed.outer, azimuth, height, intrinsics, tilt_rad, shells)
    standoff_radius = _nearest_radius_with_standoff(seed.outer, azimuth, standoff_m)
    radius = factor * np.maximum(view_radius, standoff_radius)
    kept = np.isfinite(radius)
    _say_if_empty(kept, "no height between floor and ceiling shows the whole object")
    azimuth, height, radius = azimuth[kept], height[kept], radius[kept]
    views = [
        facing(centre, float(a), float(r), float(h))
        for a, r, h in zip(azimuth, radius, height, strict=True)
    ]
    positions = np.array([v.position_world for v in views])
    yaws = np.array([v.yaw_rad for v in views])

    from_middle_m = np.hypot(positions[:, 0], positions[:, 1])
    kept = from_middle_m <= space.fence_radius_m
    _say_if_empty(
        kept, f"the whole object is in view only outside the fence ({space.fence_radius_m:.2f} m)"
    )
    kept &= intrusion(positions, space) <= 0.0
    _say_if_empty(kept, "the no-go volumes leave no place from which the whole object is in view")
    # The shells were found without lens distortion; the real camera has the last word.
    kept[kept] = whole_in_view(
        seed.outer, positions[kept], yaws[kept], intrinsics, tilt_rad, shells.margin * 0.5
    )
    _say_if_empty(kept, "the whole object is nowhere in view of the distorted camera")
    for obstacle in obstacles:
        distance = np.maximum(obstacle.lower - positions, positions - obstacle.upper)
        kept &= np.linalg.norm(np.maximum(distance, 0.0), axis=1) >= space.standoff_m
    _say_if_empty(kept, "obstacles leave no room at the standoff")
    for point in (centre, *seed.outer.corners):
        kept &= ~segments_blocked(positions, np.broadcast_to(point, positions.shape), obstacles)
    _say_if_empty(kept, "obstacles block every line of sight")
    off_fence = kept & (from_middle_m <= space.fence_radius_m - shells.off_fence_m)
    if 2 * off_fence.sum() >= kept.sum():
        kept = off_fence
    return tuple(view for view, keep in zip(views, kept, strict=True) if keep)


def _refuse_too_large(target: Box3, space: FlightSpace) -> None:
    """Raise PlanError when nobody can stand beside ``target`` anywhere inside the fence."""
    reach = float(np.hypot(*np.maximum(np.abs(target.lower[:2]), np.abs(target.upper[:2]))))
    if reach > space.fence_radius_m:
        raise PlanError(
            f"no place for a picture: the object is larger than the fence; it reaches {reach:.2f} m"
            f" from the middle, the fence {space.fence_radius_m:.2f} m"
        )


def _say_if_empty(kept: NDArray[np.bool_], constraint: str) -> None:
    if not kept.any():
        raise PlanError(f"no place for a picture: {constraint}")


def _nearest_radius_with_standoff(target: Box3, azimuth: Array, standoff: float) -> Array:
    """Return the least ``r`` ``(n,)`` whose horizontal distance to the box is the standoff."""
    half = target.size[:2] / 2.0
    directions = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    low = np.zeros(len(azimuth))
    high = np.full(len(azimuth), float(np.hypot(*half)) + standoff)
    for _ in range(40):
        middle = (low + high) / 2.0
        beyond = np.maximum(np.abs(directions * middle[:, None]) - half, 0.0)
        far = np.hypot(beyond[:, 0], beyond[:, 1]) >= standoff
        low, high = np.where(far, low, middle), np.where(far, middle, high)
    return high


def _nearest_radius_in_view(
    target: Box3,
    azimuth: Array,
    height: Array,
    intrinsics: Intrinsics,
    tilt_rad: float,
    shells: CandidateConfig,
) -> Array:
    """Return the least ``r`` ``(n,)`` from which all corners are in an undistorted picture.

    In the picture means ``|right| <= k_x forward`` and the like; along ``u`` every such condition
    is linear in ``r``, so each corner gives a lower bound and the greatest of them is the answer.
    Infinite where no distance will do.
    """
    inset = shells.margin * min(intrinsics.width, intrinsics.height)
    slope_x = (min(intrinsics.cx, intrinsics.width - 1 - intrinsics.cx) - inset) / intrinsics.fx
    slope_up = (intrinsics.cy - inset) / intrinsics.fy
    slope_down = (intrinsics.height - 1 - intrinsics.cy - inset) / intrinsics.fy
    cos_t, sin_t = np.cos(tilt_rad), np.sin(tilt_rad)
    u = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=1)
    offsets = target.corners - target.centre
    towards = u @ offsets[:, :2].T  # (n, 8): how far a corner stands out towards the drone.
    aside = np.abs(across @ offsets[:, :2].T)
    rise = target.corners[:, 2][None, :] - height[:, None]
    # With d = r - towards: forward = cos d - sin rise, down = -sin d - cos rise.
    radius = np.full(towards.shape, -np.inf)
    for slope_d, constant in (
        (slope_x * cos_t, -slope_x * sin_t * rise - aside),
        (slope_up * cos_t - sin_t, -(slope_up * sin_t + cos_t) * rise),
        (slope_down * cos_t + sin_t, (cos_t - slope_down * sin_t) * rise),
        (cos_t, -sin_t * rise - 0.05),
    ):
        # The condition is slope_d * d + constant >= 0.
        if slope_d > 1e-9:
            radius = np.maximum(radius, towards - constant / slope_d)
        else:
            radius = np.where(constant >= 0, radius, np.inf)
    return radius.max(axis=1)
