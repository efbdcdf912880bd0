"""How much of the object's surface the pictures show so far, patch by patch of the seed geometry.

The same rules as the planner's: what lies in the picture, is not hidden by the boxes, and is not
seen too obliquely. Faces that look down are left out: no drone flies below them. Hollows that no
place shows count all the same, so an object may have less than all of it to show.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from server.geometry.cameras import Intrinsics
from server.mission.events import Coverage, EventStream, SurfaceSeen
from server.planner.config import FitnessConfig
from server.planner.surfaces import sample_surface
from server.planner.visibility import visibility_table
from server.stages import SeedGeometry, Viewpoint

_DOWN = -0.5

logger = logging.getLogger(__name__)


class CoverageNews:
    """Publishes what the pictures show; a capture never waits for it, nor ends by its failure."""

    def __init__(self, events: EventStream, config: FitnessConfig) -> None:
        self._events = events
        self._config = config
        self._task: asyncio.Task[None] | None = None

    def tell(
        self,
        seed: SeedGeometry,
        views: Sequence[Viewpoint],
        intrinsics: Intrinsics,
        tilt_rad: float,
    ) -> None:
        """Work it out in a thread and publish it; arguments as of ``surface_seen``."""
        self.stop()
        look = partial(surface_seen, seed, views, intrinsics, tilt_rad, self._config)
        self._task = asyncio.create_task(self._publish(look), name="coverage")

    def stop(self) -> None:
        """Publish nothing more of what is under way."""
        if self._task is not None:
            self._task.cancel()

    async def _publish(self, look: Callable[[], SurfaceSeen]) -> None:
        try:
            seen = await asyncio.to_thread(look)
        except Exception:
            logger.exception("what the pictures show could not be worked out")
        else:
            self._events.publish(seen)


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
