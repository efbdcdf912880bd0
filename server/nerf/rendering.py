"""What a field looks like from a camera: the torch definition of compositing and of the loss.

Symbols as in ``server.nerf.kernels.cpu_rays``: packed samples, ray r owns rows ``starts[r]`` to
``starts[r + 1]``; ``alpha_i = 1 - exp(-sigma_i ds_i)``, ``T_i = prod_{j<i} (1 - alpha_j)`` and
``w_i = T_i alpha_i`` (Max 1995; NeRF, equation 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """A picture of the field.

    Attributes:
        rgb: ``(h, w, 3)`` float32 in [0, 1].
        depth_m: ``(h, w)`` mean distance along the ray, metres; meaningless where opacity is 0.
        opacity: ``(h, w)`` share of light that meets something.
    """

    rgb: NDArray[np.float32]
    depth_m: NDArray[np.float32]
    opacity: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class SampledRays:
    """Rays with the samples that carry gradient, and what they shall show.

    Attributes:
        starts: ``(rays + 1,)`` int64 first sample of every ray.
        points: ``(n, 3)`` float32 ``u`` of every sample.
        ts: ``(n,)`` float32 distances along the ray, scene units.
        ss: ``(n,)`` float32 path positions.
        ray_ids: ``(n,)`` int64 ray of every sample.
        trusts: ``(n,)`` float32 factor of every sample's gradient, small near the camera.
        dss: ``(n,)`` float32 path length every sample stands for.
        harmonics: ``(rays, B)`` float32 of the ray directions.
        backdrops: ``(rays, 3)`` float32 colour behind everything.
        targets: ``(rays, 3)`` float32 pixels in [0, 1].
        pictures: ``(rays,)`` int64 picture of every ray.
        distances: ``(rays,)`` float32 distance at which a surface is known to be, scene units; 0
            where none is known.
    """

    starts: NDArray[np.int64]
    points: NDArray[np.float32]
    ts: NDArray[np.float32]
    ss: NDArray[np.float32]
    ray_ids: NDArray[np.int64]
    trusts: NDArray[np.float32]
    dss: NDArray[np.float32]
    harmonics: NDArray[np.float32]
    backdrops: NDArray[np.float32]
    targets: NDArray[np.float32]
    pictures: NDArray[np.int64]
    distances: NDArray[np.float32]


def weights_of(
    sigmas: torch.Tensor, starts: torch.Tensor, ray_ids: torch.Tensor, dss: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return weights ``(n,)`` and the light ``(rays,)`` that passes all samples of a ray."""
    # Sums over all rays lose digits in float32, as each ray is a small difference of large ones.
    thickness = (sigmas * dss).double()
    total = torch.cat([torch.zeros(1, dtype=torch.float64), torch.cumsum(thickness, 0)])
    before = total[:-1] - total[starts[:-1]][ray_ids]
    weights = torch.exp(-before) * (1.0 - torch.exp(-thickness))
    light = torch.exp(-(total[starts[1:]] - total[starts[:-1]]))
    return weights.float(), light.float()


def distortion_of(
    weights: torch.Tensor,
    ss: torch.Tensor,
    starts: torch.Tensor,
    ray_ids: torch.Tensor,
    dss: torch.Tensor,
) -> torch.Tensor:
    """Return mip-NeRF 360's distortion ``(rays,)`` (Barron et al. 2022, equation 15)."""
    rays = len(starts) - 1
    w, ws = weights.double(), (weights * ss).double()
    zero = torch.zeros(1, dtype=torch.float64)
    sum_w = torch.cat([zero, torch.cumsum(w, 0)])
    sum_ws = torch.cat([zero, torch.cumsum(ws, 0)])
    first = starts[:-1][ray_ids]
    front_w = sum_w[:-1] - sum_w[first]
    front_ws = sum_ws[:-1] - sum_ws[first]
    # Each pair is met once, at its farther sample, hence the factor 2.
    pairs = 2.0 * w * (ss.double() * front_w - front_ws) + w * w * dss.double() / 3.0
    return torch.zeros(rays, dtype=torch.float64).index_add(0, ray_ids, pairs).float()


def missed_surface(
    weights: torch.Tensor,
    ts: torch.Tensor,
    distances: torch.Tensor,
    ray_ids: torch.Tensor,
    reach: float,
) -> torch.Tensor:
    """Return the share of light ``(rays,)`` that is not taken at the ray's known surface.

    Light counts as taken there the more, the nearer; from ``reach`` times the distance on not at
    all. Rays without a known surface miss nothing.
    """
    known = distances > 0.0
    away = (ts - distances[ray_ids]).abs() / (reach * distances.clamp(min=1e-6)[ray_ids])
    near = weights * (1.0 - away).clamp(min=0.0)
    taken = torch.zeros_like(distances).index_add(0, ray_ids, near)
    return torch.where(known, 1.0 - taken, torch.zeros_like(taken))


def composite_colours(
    weights: torch.Tensor,
    light: torch.Tensor,
    rgbs: torch.Tensor,
    ray_ids: torch.Tensor,
    backdrops: torch.Tensor,
) -> torch.Tensor:
    """Return the colour ``(rays, 3)``: weighted samples in front of the backdrop."""
    seen = torch.zeros_like(backdrops).index_add(0, ray_ids, weights[:, None] * rgbs)
    return seen + light[:, None] * backdrops


def huber(error: torch.Tensor, delta: float) -> torch.Tensor:
    """Return the Huber loss of every ``error``: quadratic within ``delta``, linear beyond."""
    small = error.abs().clamp(max=delta)
    return small * (error.abs() - 0.5 * small)


def scale_gradient(values: torch.Tensor, factors: torch.Tensor) -> torch.Tensor:
    """Return ``values`` unchanged, with their gradient multiplied by ``factors``."""
    return values * factors + (values * (1.0 - factors)).detach()
