"""The field evaluated and differentiated by the numba kernels: the fast path on a CPU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.encoding import level_window
from server.nerf.field import FieldParameters
from server.nerf.kernels.cpu import LANES, encode_backward, encode_forward, level_layout
from server.nerf.kernels.cpu_mlp import densities_forward, shade_backward, shade_forward
from server.nerf.kernels.cpu_rays import loss_gradients
from server.nerf.rendering import SampledRays

FloatArray = NDArray[np.float32]


class NumbaBackend:
    """Densities, colours and gradients by fused kernels; the interface of ``TorchBackend``.

    Attributes:
        grads: ``(chunks, *shape)`` gradient of every parameter, added to by ``gradients``.
        gain_grads: ``(chunks, pictures, 3)`` gradient of the log exposure gains, added to.

    Args:
        config: Shape of the field.
        parameters: Arrays shared with the optimiser.
        pictures: Number of pictures, for the exposure gains.
        chunks: Parallel parts; each has a gradient table of its own.
    """

    def __init__(
        self, config: FieldConfig, parameters: FieldParameters, pictures: int, chunks: int
    ) -> None:
        self._config = config
        self._parameters = parameters
        self._chunks = chunks
        self._layout = level_layout(config)
        self._bias = np.float32(config.log_density_bias)
        self._top = np.float32(config.log_density_max)
        self._features = np.empty((0, config.encoding_width, LANES), np.float32)
        self._features_grad = self._features
        self.grads = {
            name: np.zeros((chunks, *array.shape), np.float32)
            for name, array in parameters.named().items()
        }
        self.gain_grads = np.zeros((chunks, pictures, 3), np.float32)

    def densities(self, points: FloatArray, open_levels: float) -> FloatArray:
        """Return densities ``(n,)`` per path unit of ``points`` ``(n, 3)``."""
        count = len(points)
        sigmas = np.empty(count, np.float32)
        self._encode(points, self._window(open_levels))
        p = self._parameters
        densities_forward(
            self._features,
            count,
            p.density_1,
            p.density_2,
            self._bias,
            self._top,
            sigmas,
            self._chunks,
        )
        return sigmas

    def shade(
        self,
        points: FloatArray,
        harmonics: FloatArray,
        ray_ids: NDArray[np.int64],
        open_levels: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Return densities ``(n,)`` and colours ``(n, 3)`` of ``points`` ``(n, 3)``."""
        count = len(points)
        sigmas, rgbs = np.empty(count, np.float32), np.empty((count, 3), np.float32)
        self._encode(points, self._window(open_levels))
        p = self._parameters
        shade_forward(
            self._features, count, harmonics, ray_ids, p.density_1, p.density_2, p.colour_1,
            p.colour_2, p.colour_3, self._bias, self._top, sigmas, rgbs, self._chunks,
        )  # fmt: skip
        return sigmas, rgbs

    def gradients(
        self, rays: SampledRays, gains: FloatArray, train: TrainConfig, open_levels: float
    ) -> tuple[float, float]:
        """Add the gradients of the training loss; return loss and mean squared colour error."""
        count, number = len(rays.points), len(rays.targets)
        window = self._window(open_levels)
        sigmas, rgbs = self.shade(rays.points, rays.harmonics, rays.ray_ids, open_levels)
        weights, dsigmas = np.empty(count, np.float32), np.empty(count, np.float32)
        drgbs = np.empty((count, 3), np.float32)
        sums = np.empty((self._chunks, 2))
        loss_gradients(
            rays.starts, sigmas, rgbs, rays.ts, rays.ss, rays.trusts, rays.dss, rays.backdrops,
            rays.targets, gains, rays.pictures, rays.distances, np.float32(train.huber_delta),
            np.float32(train.distortion_weight), np.float32(train.surface_weight),
            np.float32(train.surface_reach), weights, dsigmas, drgbs, self.gain_grads, sums,
        )  # fmt: skip
        if len(self._features_grad) < len(self._features):
            self._features_grad = np.empty_like(self._features)
        p, g = self._parameters, self.grads
        shade_backward(
            self._features, count, rays.harmonics, rays.ray_ids, p.density_1, p.density_2,
            p.colour_1, p.colour_2, p.colour_3, self._bias, self._top, sigmas, rgbs, dsigmas, drgbs,
            self._features_grad, g["density_1"], g["density_2"], g["colour_1"], g["colour_2"],
            g["colour_3"],
        )  # fmt: skip
        encode_backward(rays.points, count, self._layout, window, self._features_grad, g["table"])
        loss, square = sums.sum(axis=0) / number
        return float(loss), float(square / 3.0)

    def _window(self, open_levels: float) -> FloatArray:
        return level_window(self._config, open_levels).numpy()

    def _encode(self, points: FloatArray, window: FloatArray) -> None:
        """Encode ``points`` into the feature buffer, which grows when needed."""
        blocks = -(-len(points) // LANES)
        if len(self._features) < blocks:
            self._features = np.empty((blocks, *self._features.shape[1:]), np.float32)
        encode_forward(
            points,
            len(points),
            self._parameters.table,
            self._layout,
            window,
            self._features,
            self._chunks,
        )
