"""The test views: what the object and its room truly look like from around it.

The views are even over the part of a sphere between two elevations (a Fibonacci spiral: equal area
for each), about the middle of the object, with the standard ring's radius. No mode ever sees them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD, Intrinsics
from server.geometry.poses import look_at
from server.planner.config import PlannerConfig
from server.planner.ring import standard_ring
from server.sim.meshes import ObjectModel
from server.sim.world import World

Array = NDArray[np.float64]

COUNT = 40
LOWEST_RAD, HIGHEST_RAD = np.deg2rad(5.0), np.deg2rad(60.0)
# 480x360, with the field of view of the drones' own cameras.
CAMERA: Intrinsics = TELLO_INTRINSICS.scaled(0.5)
_SUPERSAMPLE = 2
_DRONES = 4
_GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutViews:
    """Pictures that no mode has seen.

    Attributes:
        T_world_cam: ``(n, 4, 4)`` true poses.
        images_rgb: One ``(360, 480, 3)`` uint8 each.
        masks: The object's true silhouette in each ``(360, 480)``.
        camera: What took them.
    """

    T_world_cam: Array
    images_rgb: tuple[NDArray[np.uint8], ...]
    masks: tuple[NDArray[np.bool_], ...]
    camera: Intrinsics = CAMERA


def ring_radius(model: ObjectModel) -> float:
    """Return the radius in metres of the standard ring around the true object.

    Raises:
        PlanError: If no ring fits between standoff and fence.
    """
    box = true_box(model)
    azimuths = list(np.arange(_DRONES) * 2.0 * np.pi / _DRONES)
    rounds = standard_ring(
        box, _DRONES, 1, TELLO_INTRINSICS, TELLO_TILT_RAD, PlannerConfig(), azimuths
    )
    return float(np.hypot(*(rounds[0][0].position_world - box.centre)[:2]))


def true_box(model: ObjectModel) -> Box3:
    """Return the box around the object itself."""
    vertices = np.asarray(model.vertices, float)
    return Box3(vertices.min(axis=0), vertices.max(axis=0))


def view_poses(centre: Array, radius_m: float, count: int = COUNT) -> Array:
    """Return ``count`` poses ``(n, 4, 4)`` that look at ``centre`` ``(3,)`` from around it."""
    low, high = np.sin(LOWEST_RAD), np.sin(HIGHEST_RAD)
    upwards = low + (high - low) * (np.arange(count) + 0.5) / count
    azimuths = _GOLDEN_RAD * np.arange(count)
    across = np.sqrt(1.0 - upwards**2)
    offsets = np.stack([across * np.cos(azimuths), across * np.sin(azimuths), upwards], axis=1)
    return np.stack([look_at(centre + radius_m * offset, centre) for offset in offsets])


def draw_views(model: ObjectModel, seed: int, count: int = COUNT) -> HeldOutViews:
    """Draw the test views of an object in the room of a seed; no drone is in them."""
    poses = view_poses(true_box(model).centre, ring_radius(model), count)
    world = World(model, intrinsics=CAMERA, supersample=_SUPERSAMPLE, seed=seed)
    try:
        images = tuple(np.ascontiguousarray(world.render(T)[:, :, ::-1]) for T in poses)
        masks = tuple(world.silhouette(T) for T in poses)
    finally:
        world.close()
    return HeldOutViews(poses, images, masks)
