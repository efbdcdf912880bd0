"""The field evaluated and differentiated by torch: slow, plain, and the definition."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.encoding import level_window
from server.nerf.field import FieldParameters, query_field, query_geometry
from server.nerf.rendering import (
    SampledRays,
    composite_colours,
    distortion_of,
    huber,
    missed_surface,
    scale_gradient,
    weights_of,
)

FloatArray = NDArray[np.float32]


class TorchBackend:
    """Densities, colours and gradients by torch and its autograd.

    Attributes:
        grads: ``(1, *shape)`` gradient of every parameter, added to by ``gradients``.
        gain_grads: ``(1, pictures, 3)`` gradient of the log exposure gains, added to.

    Args:
        config: Shape of the field.
        parameters: Arrays shared with the optimiser.
        pictures: Number of pictures, for the exposure gains.
    """

    def __init__(self, config: FieldConfig, parameters: FieldParameters, pictures: int) -> None:
        self._config = config
        self._parameters = parameters
        self.grads = {
            name: np.zeros((1, *a.shape), np.float32) for name, a in parameters.named().items()
        }
        self.gain_grads = np.zeros((1, pictures, 3), np.float32)

    def densities(self, points: FloatArray, open_levels: float) -> FloatArray:
        """Return densities ``(n,)`` per path unit of ``points`` ``(n, 3)``."""
        with torch.no_grad():
            sigmas, _ = query_geometry(
                self._config,
                self._parameters.tensors(False),
                torch.from_numpy(points),
                level_window(self._config, open_levels),
            )
        return sigmas.numpy()

    def shade(
        self,
        points: FloatArray,
        harmonics: FloatArray,
        ray_ids: NDArray[np.int64],
        open_levels: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return densities ``(n,)`` and colours ``(n, 3)`` of ``points`` ``(n, 3)``."""
        with torch.no_grad():
            sigmas, rgbs = query_field(
                self._config,
                self._parameters.tensors(False),
                torch.from_numpy(points),
                torch.from_numpy(harmonics)[torch.from_numpy(ray_ids)],
                level_window(self._config, open_levels),
            )
        return sigmas.numpy(), rgbs.numpy()

    def gradients(
        self, rays: SampledRays, gains: FloatArray, train: TrainConfig, open_levels: float
    ) -> tuple[float, float]:
        """Add the gradients of the training loss; return loss and mean squared colour error."""
        tensors = self._parameters.tensors(True)
        log_gains = torch.zeros(gains.shape, requires_grad=True)
        ray_ids, starts = torch.from_numpy(rays.ray_ids), torch.from_numpy(rays.starts)
        sigmas, rgbs = query_field(
            self._config,
            tensors,
            torch.from_numpy(rays.points),
            torch.from_numpy(rays.harmonics)[ray_ids],
            level_window(self._config, open_levels),
        )
        trusts, dss = torch.from_numpy(rays.trusts), torch.from_numpy(rays.dss)
        sigmas, rgbs = scale_gradient(sigmas, trusts), scale_gradient(rgbs, trusts[:, None])
        weights, light = weights_of(sigmas, starts, ray_ids, dss)
        pixels = composite_colours(weights, light, rgbs, ray_ids, torch.from_numpy(rays.backdrops))
        gain = torch.from_numpy(gains) * torch.exp(log_gains)
        error = pixels * gain[torch.from_numpy(rays.pictures)] - torch.from_numpy(rays.targets)
        spread = distortion_of(weights, torch.from_numpy(rays.ss), starts, ray_ids, dss)
        missed = missed_surface(
            weights,
            torch.from_numpy(rays.ts),
            torch.from_numpy(rays.distances),
            ray_ids,
            train.surface_reach,
        )
        loss = (
            huber(error, train.huber_delta).sum(1).mean()
            + train.distortion_weight * spread.mean()
            + train.surface_weight * missed.mean()
        )
        loss.backward()
        for name, tensor in tensors.items():
            if tensor.grad is not None:
                self.grads[name][0] += tensor.grad.numpy()
            # The arrays are written by the optimiser next; torch shall not see that as its own.
            tensor.requires_grad_(False)
        if log_gains.grad is not None:
            self.gain_grads[0] += log_gains.grad.numpy()
        return float(loss.detach()), float((error.detach() ** 2).mean())
