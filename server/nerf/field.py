"""The field in plain torch: density and colour of points seen from directions.

Symbols: ``g`` are the geometry features of a point, the first its log density; ``sh`` the real
spherical harmonics of the viewing direction. No layer has a bias: the constant harmonic does its
work in the colour MLP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray

from server.nerf.config import FieldConfig
from server.nerf.encoding import encode, grid_levels, table_rows

FloatArray = NDArray[np.float32]


@dataclass(slots=True, eq=False)
class FieldParameters:
    """Everything that is learned about the scene, float32; kernels write into the arrays.

    Attributes:
        table: ``(rows, F)`` hash tables of all levels.
        density_1: ``(density_width, L F)``.
        density_2: ``(geometry_features, density_width)``.
        colour_1: ``(colour_width, geometry_features + sh_degree^2)``.
        colour_2: ``(colour_width, colour_width)``.
        colour_3: ``(3, colour_width)``.
    """

    table: FloatArray
    density_1: FloatArray
    density_2: FloatArray
    colour_1: FloatArray
    colour_2: FloatArray
    colour_3: FloatArray

    def named(self) -> dict[str, FloatArray]:
        """Return all arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def tensors(self, requires_grad: bool) -> dict[str, torch.Tensor]:
        """Return torch tensors that share memory with the arrays."""
        return {
            name: torch.from_numpy(array).requires_grad_(requires_grad)
            for name, array in self.named().items()
        }


def initial_parameters(config: FieldConfig, seed: int) -> FieldParameters:
    """Return an untrained field: tiny table entries, He-uniform layers."""
    rng = np.random.default_rng(seed)

    def layer(outputs: int, inputs: int) -> FloatArray:
        limit = np.sqrt(6.0 / inputs)
        return rng.uniform(-limit, limit, (outputs, inputs)).astype(np.float32)

    return FieldParameters(
        table=rng.uniform(-1e-4, 1e-4, (table_rows(config), config.features)).astype(np.float32),
        density_1=layer(config.density_width, config.encoding_width),
        density_2=layer(config.geometry_features, config.density_width),
        colour_1=layer(config.colour_width, config.colour_inputs),
        colour_2=layer(config.colour_width, config.colour_width),
        colour_3=layer(3, config.colour_width),
    )


def spherical_harmonics(directions: FloatArray, degree: int) -> FloatArray:
    """Return the real spherical harmonics ``(n, degree^2)`` of unit ``directions`` ``(n, 3)``.

    Orthonormal over the sphere, bands 0 to ``degree - 1``, in the usual order m = -l .. l.
    """
    x, y, z = (directions[:, axis].astype(np.float32) for axis in range(3))
    xx, yy, zz = x * x, y * y, z * z
    bands = [np.full_like(x, 0.28209479)]
    if degree > 1:
        bands += [-0.48860251 * y, 0.48860251 * z, -0.48860251 * x]
    if degree > 2:
        bands += [
            1.09254843 * x * y,
            -1.09254843 * y * z,
            0.31539157 * (3.0 * zz - 1.0),
            -1.09254843 * x * z,
            0.54627422 * (xx - yy),
        ]
    if degree > 3:
        bands += [
            -0.59004359 * y * (3.0 * xx - yy),
            2.89061144 * x * y * z,
            -0.45704579 * y * (5.0 * zz - 1.0),
            0.37317633 * z * (5.0 * zz - 3.0),
            -0.45704579 * x * (5.0 * zz - 1.0),
            1.44530572 * z * (xx - yy),
            -0.59004359 * x * (xx - 3.0 * yy),
        ]
    return np.ascontiguousarray(np.stack(bands, axis=1), dtype=np.float32)


def query_geometry(
    config: FieldConfig,
    parameters: Mapping[str, torch.Tensor],
    points: torch.Tensor,
    window: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return density ``(n,)`` per path unit and ``g`` ``(n, G)`` of ``points`` ``(n, 3)``."""
    features = encode(points, parameters["table"], grid_levels(config), window)
    hidden = torch.relu(features @ parameters["density_1"].T)
    g = hidden @ parameters["density_2"].T
    log_density = (g[:, 0] + config.log_density_bias).clamp(max=config.log_density_max)
    return torch.exp(log_density), g


def query_field(
    config: FieldConfig,
    parameters: Mapping[str, torch.Tensor],
    points: torch.Tensor,
    harmonics: torch.Tensor,
    window: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return density ``(n,)`` and colour ``(n, 3)`` in [0, 1] of points seen along harmonics.

    Args:
        config: Shape of the field.
        parameters: Tensors by name, see ``FieldParameters``.
        points: ``u`` ``(n, 3)`` in ``[0, 1]``.
        harmonics: ``(n, sh_degree^2)`` of the viewing directions.
        window: Weight ``(L,)`` of every level.
    """
    sigmas, g = query_geometry(config, parameters, points, window)
    hidden = torch.relu(torch.cat([g, harmonics], dim=1) @ parameters["colour_1"].T)
    hidden = torch.relu(hidden @ parameters["colour_2"].T)
    return sigmas, torch.sigmoid(hidden @ parameters["colour_3"].T)
