"""Boxes and seeds that the planner's tests are about."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from server.geometry.boxes import Box3, union
from server.geometry.cameras import TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.planner.config import FlightSpace
from server.planner.paths import separation
from server.stages import Assignment, CameraPose, SeedGeometry


def box(*numbers: float) -> Box3:
    """Return the box with lower corner ``numbers[:3]`` and upper corner ``numbers[3:]``."""
    return Box3(np.array(numbers[:3], float), np.array(numbers[3:], float))


def seed_of(*boxes: Box3) -> SeedGeometry:
    return SeedGeometry(union(boxes), boxes, 4)


def pose_at(
    drone_id: str, x: float, y: float, z: float, yaw_rad: float = 0.0, sigma_m: float = 0.05
) -> CameraPose:
    """Return a drone's pose; ``sigma_m`` is that of its position."""
    T = camera_pose(np.array([x, y, z]), yaw_rad, TELLO_TILT_RAD)
    return CameraPose(drone_id, 0.0, T, np.diag([sigma_m**2] * 3 + [1e-3]))


def occupied_separation(
    assignment: Assignment, drone_poses: Mapping[str, CameraPose], space: FlightSpace
) -> float:
    """Return the least separation in metres between places that drones occupy at the same time.

    A drone without a viewpoint in a round stays where it was. Infinite with one drone.
    """
    current = {d: p.position_world for d, p in drone_poses.items()}
    least = float("inf")
    for views in assignment.rounds:
        current.update({d: v.position_world for d, v in views.items()})
        for one, other in combinations(current.values(), 2):
            least = min(least, float(separation(one, other, space.downwash_factor)))
    return least
