"""From rays to samples: spread by what is remembered, thinned by what the field itself says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from server.nerf.config import TrainConfig
from server.nerf.kernels.cpu_sampling import keep_visible, sample_paths
from server.nerf.occupancy import DensityMemory
from server.nerf.rendering import SampledRays

FloatArray = NDArray[np.float32]


class Backend(Protocol):
    """What training and rendering need of the field; see ``TorchBackend``."""

    grads: dict[str, FloatArray]
    gain_grads: FloatArray

    def densities(self, points: FloatArray, open_levels: float) -> FloatArray:
        """Return densities ``(n,)`` per path unit of ``points`` ``(n, 3)``."""
        ...

    def shade(
        self,
        points: FloatArray,
        harmonics: FloatArray,
        ray_ids: NDArray[np.int64],
        open_levels: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return densities ``(n,)`` and colours ``(n, 3)`` of ``points`` ``(n, 3)``."""
        ...

    def gradients(
        self, rays: SampledRays, gains: FloatArray, train: TrainConfig, open_levels: float
    ) -> tuple[float, float]:
        """Add the gradients of the training loss; return loss and mean squared colour error."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Packed samples of some rays.

    Attributes:
        starts: ``(rays + 1,)`` first sample of every ray.
        points: ``(n, 3)`` ``u``.
        ts: ``(n,)`` distance along the ray, scene units.
        ss: ``(n,)`` path position.
        dss: ``(n,)`` path length the sample stands for.
        ray_ids: ``(n,)`` ray of every sample.
    """

    starts: NDArray[np.int64]
    points: FloatArray
    ts: FloatArray
    ss: FloatArray
    dss: FloatArray
    ray_ids: NDArray[np.int64]


def sample_rays(
    memory: DensityMemory,
    origins: FloatArray,
    directions: FloatArray,
    jitters: FloatArray,
    *,
    near: float,
    bin_length: float,
    even: float,
    chunks: int,
    only: NDArray[np.bool_] | None = None,
) -> Samples:
    """Return as many samples per ray as ``jitters`` ``(rays, slots)`` has columns.

    Args:
        memory: Remembered densities.
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        jitters: Place of every sample in its stratum, in [0, 1).
        near: Start of the rays, scene units.
        bin_length: Path units per bin of the proposal.
        even: Share of samples spread evenly.
        chunks: Parallel parts.
        only: Cells of the object's cube to look into, as ``memory.seen``; None for all seen.
    """
    rays, slots = jitters.shape
    ts, ss, dss = (np.empty((rays, slots), np.float32) for _ in range(3))
    points = np.empty((rays * slots, 3), np.float32)
    seen, far = (memory.seen, memory.far) if only is None else (memory.seen & only, 1.0)
    sample_paths(
        origins, directions, np.float32(near), np.float32(far), np.float32(bin_length),
        memory.densities, seen, np.float32(even), jitters, ts, ss, dss, points, chunks,
    )  # fmt: skip
    return Samples(
        np.arange(0, rays * slots + 1, slots, dtype=np.int64),
        points,
        ts.ravel(),
        ss.ravel(),
        dss.ravel(),
        np.repeat(np.arange(rays), slots),
    )


def visible_part(
    samples: Samples, sigmas: FloatArray, *, transmittance: float, least_weight: float
) -> Samples:
    """Return the samples that show, by their true densities ``sigmas`` ``(n,)``."""
    rays = len(samples.starts) - 1
    slots = int(samples.starts[1]) if rays else 0
    keep = np.empty(len(sigmas), bool)
    counts = np.empty(rays, np.int64)
    keep_visible(
        slots, sigmas, samples.dss, np.float32(transmittance), np.float32(least_weight), keep,
        counts,
    )  # fmt: skip
    return Samples(
        np.concatenate([[0], np.cumsum(counts)]),
        samples.points[keep],
        samples.ts[keep],
        samples.ss[keep],
        samples.dss[keep],
        samples.ray_ids[keep],
    )
