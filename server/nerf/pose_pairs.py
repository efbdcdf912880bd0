"""Which pictures are worth matching, from what the flight believed about their poses.

Matching all pairs costs the square of their number, and most of them share nothing: a picture is
compared with its neighbours in time and, for every drone, with the pictures that look the most
alike by their believed viewing direction.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from server.nerf.pose_config import PoseConfig

Array = NDArray[np.float64]


def view_angles(T_world_cam: Array) -> Array:
    """Return the angles ``(n, n)`` in radians between the optical axes of poses ``(n, 4, 4)``."""
    forward = T_world_cam[:, :3, 2]
    return np.arccos(np.clip(forward @ forward.T, -1.0, 1.0))


def choose_pairs(
    T_world_cam: Array,
    drone_ids: Sequence[str],
    at_s: Array,
    still: NDArray[np.bool_],
    config: PoseConfig,
) -> list[tuple[int, int]]:
    """Return the pairs ``(i, j)``, ``i < j``, to match, in ascending order.

    Args:
        T_world_cam: Believed poses ``(n, 4, 4)``.
        drone_ids: The drone of each picture.
        at_s: When each picture was taken ``(n,)``, seconds.
        still: Which pictures are stills ``(n,)``; all stills that may see the same are paired.
        config: How many of each kind.
    """
    angles = view_angles(T_world_cam)
    drones = np.array([str(d) for d in drone_ids])
    pairs: set[tuple[int, int]] = set()

    def add(i: int, j: int) -> None:
        if i != j:
            pairs.add((min(i, j), max(i, j)))

    members = {drone: np.flatnonzero(drones == drone) for drone in np.unique(drones)}
    for drone, indices in members.items():
        members[drone] = indices = indices[np.argsort(at_s[indices], kind="stable")]
        for step in range(1, config.time_neighbours + 1):
            for i, j in zip(indices[:-step], indices[step:], strict=True):
                add(int(i), int(j))
    for i in range(len(drones)):
        for indices in members.values():
            near = indices[(angles[i, indices] <= config.max_view_angle_rad) & (indices != i)]
            order = np.argsort(angles[i, near], kind="stable")
            for j in near[order][: config.pairs_per_drone]:
                add(i, int(j))
    stills = np.flatnonzero(still)
    for a, i in enumerate(stills):
        for j in stills[a + 1 :]:
            if angles[i, j] <= config.max_view_angle_rad:
                add(int(i), int(j))
    return sorted(pairs)
