"""From rays to the samples that matter: march occupied cells, then cut by true densities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from server.nerf.config import TrainConfig
from server.nerf.kernels.cpu_rays import absorb, march, pack, place, start_rays
from server.nerf.rendering import SampledRays

FloatArray = NDArray[np.float32]

# Samples a ray takes before the field is asked whether it goes on. Short at first, as most rays
# meet a surface soon; long later, as each wave has its price.
_WAVE_SLOTS = (16, 16, 32, 64)
# No wave asks the field about more points than this at once, to bound memory.
_WAVE_POINTS = 1 << 18


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
        ray_ids: ``(n,)`` ray of every sample.
    """

    starts: NDArray[np.int64]
    points: FloatArray
    ts: FloatArray
    ss: FloatArray
    ray_ids: NDArray[np.int64]


def sample_rays(
    backend: Backend,
    occupied: NDArray[np.bool_],
    origins: FloatArray,
    directions: FloatArray,
    jitters: FloatArray,
    *,
    near: float,
    step: float,
    open_levels: float,
    transmittance: float,
    least_weight: float,
    chunks: int,
) -> Samples:
    """Return the samples of rays up to where the field itself lets no more light through.

    Args:
        backend: The field.
        occupied: Cells worth a sample.
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        jitters: ``(rays,)`` shift of the samples, share of a step.
        near: Start of the rays, scene units.
        step: Path units per sample.
        open_levels: Levels of the encoding in use.
        transmittance: A ray ends when less light than this is left.
        least_weight: Samples of less weight are dropped; 0 keeps all.
        chunks: Parallel parts.
    """
    rays = len(origins)
    states = np.empty((rays, 2), np.float32)
    start_rays(origins, directions, np.float32(near), jitters, np.float32(step), states)
    light = np.ones(rays, np.float32)
    kept_of_rays = np.zeros(rays, np.int64)
    waves: list[_Wave] = []
    active = np.arange(rays)
    while len(active):
        slots = _WAVE_SLOTS[min(len(waves), len(_WAVE_SLOTS) - 1)]
        slots = max(8, min(slots, _WAVE_POINTS // len(active)))
        ts, ss = (
            np.empty((len(active), slots), np.float32),
            np.empty((len(active), slots), np.float32),
        )
        counts = np.empty(len(active), np.int64)
        march(
            origins, directions, active, states, np.float32(step), occupied, ts, ss, counts, chunks
        )
        points = np.empty((int(counts.sum()), 3), np.float32)
        pack(origins, directions, active, ts, counts, points)
        keep = np.empty(len(points), bool)
        if len(points):
            sigmas = backend.densities(points, open_levels)
            absorb(
                active, counts, sigmas, np.float32(step), np.float32(transmittance),
                np.float32(least_weight), light, states, keep,
            )  # fmt: skip
            waves.append(_Wave(active, counts, keep, points, ts, ss))
            owners = np.repeat(active, counts)
            kept_of_rays += np.bincount(owners[keep], minlength=rays)
        active = active[np.isfinite(states[active, 0])]
    return _join(waves, kept_of_rays)


@dataclass(frozen=True, slots=True, eq=False)
class _Wave:
    """One round of marching, see ``march``, ``pack`` and ``absorb``."""

    active: NDArray[np.int64]
    counts: NDArray[np.int64]
    keep: NDArray[np.bool_]
    points: FloatArray
    ts: FloatArray
    ss: FloatArray


def _join(waves: list[_Wave], kept_of_rays: NDArray[np.int64]) -> Samples:
    """Bring the kept samples of all waves into ray order."""
    starts = np.concatenate([[0], np.cumsum(kept_of_rays)])
    total = int(starts[-1])
    samples = Samples(
        starts,
        np.empty((total, 3), np.float32),
        np.empty(total, np.float32),
        np.empty(total, np.float32),
        np.empty(total, np.int64),
    )
    ends = starts[:-1].copy()
    for wave in waves:
        place(
            wave.active, wave.counts, wave.keep, wave.points, wave.ts, wave.ss, ends,
            samples.points, samples.ts, samples.ss, samples.ray_ids,
        )  # fmt: skip
    return samples
