"""Scale from one length that the operator knows.

Pictures alone know no scale; the flight's beliefs do, to a per cent or two. Whoever knows how long
something in the scene is, marks its two ends in two pictures or more each: the ends are
triangulated, and everything is scaled so that they are as far apart as they really are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Mark:
    """One end of the known length in one picture.

    Attributes:
        picture: Number of the picture.
        pixel: Where the end is ``(2,)``, pixels.
    """

    picture: int
    pixel: Array


@dataclass(frozen=True, slots=True)
class KnownScale:
    """How the world is to be scaled.

    Attributes:
        factor: Positions times this are in true metres.
        sigma: Its standard deviation.
        measured_m: How long the thing seemed before.
    """

    factor: float
    sigma: float
    measured_m: float


def scale_from_length(
    ends: tuple[Sequence[Mark], Sequence[Mark]],
    length_m: float,
    T_world_cam: Array,
    intrinsics: Sequence[Intrinsics],
    *,
    length_sigma_m: float = 0.0,
    mark_sigma_px: float = 2.0,
) -> KnownScale:
    """Return the scale at which the marked thing is ``length_m`` long.

    The error holds what the operator's tape and mouse are wrong by; errors of the poses relative to
    one another are far smaller.

    Args:
        ends: Marks of either end, two pictures or more each.
        length_m: True distance of the ends, metres.
        T_world_cam: Poses ``(n, 4, 4)``.
        intrinsics: Camera of each picture.
        length_sigma_m: Standard deviation of ``length_m``.
        mark_sigma_px: Standard deviation of a mark on each axis, pixels.

    Raises:
        ValueError: If a length is not positive, an end is marked in fewer than two pictures, its
            rays do not meet in front of the cameras at a usable angle, or the ends coincide.
    """
    if not (math.isfinite(length_m) and length_m > 0.0):
        raise ValueError(f"length_m must be positive, is {length_m}")
    if length_sigma_m < 0.0 or mark_sigma_px <= 0.0:
        raise ValueError("length_sigma_m and mark_sigma_px must be positive")
    found = [_triangulate(marks, T_world_cam, intrinsics, mark_sigma_px) for marks in ends]
    (a, cov_a), (b, cov_b) = found
    measured = float(np.linalg.norm(b - a))
    along = (b - a) / max(measured, 1e-12)
    sigma_measured = math.sqrt(float(along @ (cov_a + cov_b) @ along))
    if measured <= 3.0 * sigma_measured:
        raise ValueError("the marked ends are too close together to tell the scale")
    factor = length_m / measured
    relative = math.hypot(length_sigma_m / length_m, sigma_measured / measured)
    return KnownScale(factor, factor * relative, measured)


def _triangulate(
    marks: Sequence[Mark],
    T_world_cam: Array,
    intrinsics: Sequence[Intrinsics],
    mark_sigma_px: float,
) -> tuple[Array, Array]:
    """Return the point ``(3,)`` nearest to the marks' rays and its covariance ``(3, 3)``."""
    if len({mark.picture for mark in marks}) < 2:
        raise ValueError("each end must be marked in two pictures or more")
    origins = np.stack([T_world_cam[mark.picture, :3, 3] for mark in marks])
    rays = np.stack(
        [
            T_world_cam[mark.picture, :3, :3]
            @ intrinsics[mark.picture].directions(np.asarray(mark.pixel, float)[None])[0]
            for mark in marks
        ]
    )
    point = origins.mean(axis=0)
    weights = np.ones(len(marks))
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    for _ in range(3):
        normal = (weights[:, None, None] * across).sum(axis=0)
        if np.linalg.cond(normal) > 1e4:
            raise ValueError("the rays to a marked end are parallel: mark it from another side")
        right = (weights[:, None, None] * across @ origins[:, :, None]).sum(axis=0)
        point = np.linalg.solve(normal, right[:, 0])
        depths = ((point - origins) * rays).sum(axis=1)
        if (depths <= 0.0).any():
            raise ValueError("a marked end lies behind a camera: its marks do not belong together")
        # A pixel is wider far away.
        sigmas = depths * mark_sigma_px / np.array([intrinsics[m.picture].fx for m in marks])
        weights = 1.0 / sigmas**2
    return point, np.linalg.inv((weights[:, None, None] * across).sum(axis=0))
