"""How much of the object's surface the pictures show so far, patch by patch of the seed geometry.

The same rules as the planner's: what lies in the picture, is not hidden by the boxes, and is not
seen too obliquely. Faces that look down are left out: no drone flies below them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from server.geometry.cameras import Intrinsics
from server.mission.events import Coverage, SurfaceSeen
from server.planner.config import FitnessConfig
from server.planner.surfaces import sample_surface
from server.planner.visibility import visibility_table
from server.stages import SeedGeometry, Viewpoint

_DOWN = -0.5


def surface_seen(
    seed: SeedGeometry,
    views: Sequence[Viewpoint],
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: FitnessConfig,
) -> SurfaceSeen:
    """Return in how many of the pictures from ``views`` each patch of the surface is seen.

    Args:
        seed: The object's crude geometry.
        views: Where the pictures were taken or will be, at least one.
        intrinsics: The cameras'.
        tilt_rad: How far they look down.
        config: How many patches, and how obliquely is too obliquely.
    """
    boxes = seed.boxes or (seed.outer,)
    samples = sample_surface(boxes, config.samples)
    table = visibility_table(views, samples, boxes, intrinsics, tilt_rad, config)
    shown = samples.normals[:, 2] > _DOWN
    counts, areas = table.visible.sum(axis=0)[shown], samples.areas_m2[shown]
    return SurfaceSeen(
        points=samples.points[shown],
        pictures=counts,
        patch_m=float(np.sqrt(np.median(areas))),
        coverage=Coverage(
            once=float(areas[counts >= 1].sum() / areas.sum()),
            thrice=float(areas[counts >= 3].sum() / areas.sum()),
        ),
    )
