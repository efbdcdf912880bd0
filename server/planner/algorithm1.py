"""Algorithm 1 of the paper, written to be laid beside its pseudocode.

It is the definition: slow, one sight line at a time. ``server.planner.visibility`` computes the
same numbers for whole tables, and the tests hold the two together.

How the pseudocode is read: C are the drones and F the rounds, so that ``C[c][f]`` is a camera's
pose in a round. S are the surfaces, here the seed boxes, cut into samples; the pseudocode says
nearest surface "on the sight line" without saying which, so there is one sight line per sample.
D cannot be the number of candidates; it is the pose uncertainty, a list of equally likely
deviations from the commanded pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.planner.surfaces import SurfaceSamples
from server.stages import Viewpoint

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What stays the same for every sight line.

    Attributes:
        intrinsics: Camera.
        tilt_rad: How far it looks down.
        tau_px: Scale of the picture error.
        incidence_max_rad: Greatest useful angle between sight line and surface normal.
    """

    intrinsics: Intrinsics
    tilt_rad: float
    tau_px: float
    incidence_max_rad: float


def algorithm1(
    C: Sequence[Sequence[Viewpoint]],
    S: tuple[Sequence[Box3], SurfaceSamples],
    D: Array,
    F: Sequence[int],
    sight: Sight,
    weights: Array,
) -> float:
    """Return F_fit, the paper's Algorithm 1, with one weight per sample.

    Args:
        C: Per drone its pose in every round.
        S: Seed boxes and their samples.
        D: Pose deviations ``(m, 4)`` in x, y, z (m) and yaw (rad).
        F: Rounds to sum over, indices into each member of ``C``.
        sight: Camera and scales.
        weights: Weight ``(s,)`` of each sample.
    """
    boxes, samples = S
    F_fit = 0.0
    for c in C:
        for f in F:
            for k in range(len(samples)):  # The sight lines, implicit in the pseudocode.
                s_near = None
                s_near_dist = np.inf
                for s in boxes:
                    d = surface_dist(c[f], s, samples.points[k])
                    if d < s_near_dist:
                        s_near_dist = d
                        s_near = s
                # The line's own sample is met unless a nearer surface took its place; that one
                # then counts on the sight lines of its own samples.
                if s_near is not None and meets_sample(c[f], s_near_dist, samples, k, sight):
                    xy_expect = expect_img_location(c[f], samples.points[k], sight)
                    F_prime = 0.0
                    for deviation in D:
                        xy_real = real_img_location(c[f], samples.points[k], deviation, sight)
                        F_prime += diff(xy_expect, xy_real, sight) / len(D)
                    F_fit += float(weights[k]) * F_prime
    return F_fit


def surface_dist(c: Viewpoint, s: Box3, through: Array) -> float:
    """Return how far from ``c`` the line through the point ``through`` enters box ``s``, or inf."""
    along = through - c.position_world
    length = float(np.linalg.norm(along))
    along = along / length
    along = np.where(np.abs(along) < 1e-12, 1e-12, along)
    t_low = (s.lower - c.position_world) / along
    t_high = (s.upper - c.position_world) / along
    enter = float(np.minimum(t_low, t_high).max())
    leave = float(np.maximum(t_low, t_high).min())
    # A surface that is only touched at its rim is not entered; rounding must not decide that.
    return enter if max(enter, 0.0) < leave + 1e-6 else float("inf")


def meets_sample(
    c: Viewpoint, near_dist: float, samples: SurfaceSamples, k: int, sight: Sight
) -> bool:
    """Return whether the nearest surface is sample ``k`` itself and is not seen too obliquely."""
    to_camera = c.position_world - samples.points[k]
    distance = float(np.linalg.norm(to_camera))
    cosine = float(to_camera @ samples.normals[k]) / distance
    return cosine > np.cos(sight.incidence_max_rad) and near_dist > distance - 1e-3


def expect_img_location(c: Viewpoint, point: Array, sight: Sight) -> Array:
    """Return the pixel ``(2,)`` of ``point`` from the commanded pose."""
    return sight.intrinsics.project(point[None], c.T_world_cam(sight.tilt_rad))[0][0]


def real_img_location(c: Viewpoint, point: Array, deviation: Array, sight: Sight) -> Array:
    """Return the pixel ``(2,)`` of ``point`` from the pose that the drone really has."""
    real = Viewpoint(c.position_world + deviation[:3], c.yaw_rad + float(deviation[3]))
    return sight.intrinsics.project(point[None], real.T_world_cam(sight.tilt_rad))[0][0]


def diff(xy_expect: Array, xy_real: Array, sight: Sight) -> float:
    """Return exp(-|expect - real|^2 / (2 tau^2)), 0 when either is out of the picture."""
    if not sight.intrinsics.contains(np.stack([xy_expect, xy_real])).all():
        return 0.0
    return float(np.exp(-((xy_expect - xy_real) ** 2).sum() / (2.0 * sight.tau_px**2)))
