"""The numba kernels against the torch definition: values and gradients."""

import numpy as np
import pytest

from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.encoding import grid_levels
from server.nerf.field import initial_parameters, spherical_harmonics
from server.nerf.numba_backend import NumbaBackend
from server.nerf.rendering import SampledRays
from server.nerf.torch_backend import TorchBackend

CONFIGS = [
    FieldConfig(levels=4, log2_table_size=10, features=2, coarsest=4, finest=40, sh_degree=2),
    FieldConfig(levels=3, log2_table_size=9, features=4, coarsest=6, finest=60, sh_degree=3),
    FieldConfig(
        levels=5, log2_table_size=8, features=3, coarsest=3, finest=90, sh_degree=4,
        density_width=17, geometry_features=7, colour_width=21,
    ),
]  # fmt: skip


def both(config, chunks=3):
    parameters = initial_parameters(config, 0)
    # Trained tables are not tiny; with tiny ones wrong rows would hide in the tolerance.
    rng = np.random.default_rng(1)
    parameters.table[:] = rng.normal(0, 0.5, parameters.table.shape)
    return (
        TorchBackend(config, parameters, 2),
        NumbaBackend(config, parameters, 2, chunks),
    )


def random_rays(config, counts):
    rng = np.random.default_rng(2)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    total, rays = int(starts[-1]), len(counts)
    d = rng.normal(size=(rays, 3)).astype(np.float32)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    points = rng.random((total, 3), np.float32)
    # The corners of the cube are the kernels' hardest points.
    points[:2] = [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    return SampledRays(
        starts=starts,
        points=points,
        ts=np.concatenate([np.sort(rng.uniform(0.5, 3.0, c)) for c in counts]).astype(np.float32),
        ss=np.concatenate([np.sort(rng.random(c)) for c in counts]).astype(np.float32),
        ray_ids=np.repeat(np.arange(rays), counts),
        trusts=rng.uniform(0.1, 1.0, total).astype(np.float32),
        dss=rng.uniform(0.01, 0.1, total).astype(np.float32),
        harmonics=spherical_harmonics(d, config.sh_degree),
        backdrops=rng.random((rays, 3), np.float32),
        targets=rng.random((rays, 3), np.float32),
        pictures=rng.integers(0, 2, rays),
        # Every other ray knows where its surface is.
        distances=(rng.uniform(0.6, 2.9, rays) * (np.arange(rays) % 2)).astype(np.float32),
    )


def close(actual, wanted):
    scale = max(float(np.abs(wanted).max()), 1e-6)
    np.testing.assert_allclose(actual / scale, wanted / scale, atol=1e-4)


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("open_levels", [8.0, 2.4])
def test_forward_equals_torch(config, open_levels):
    torch_backend, numba_backend = both(config)
    rays = random_rays(config, [30, 0, 50, 53])
    close(
        numba_backend.densities(rays.points, open_levels),
        torch_backend.densities(rays.points, open_levels),
    )
    arguments = (rays.points, rays.harmonics, rays.ray_ids, open_levels)
    for actual, wanted in zip(
        numba_backend.shade(*arguments), torch_backend.shade(*arguments), strict=True
    ):
        close(actual, wanted)


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("open_levels", [8.0, 2.4])
def test_gradients_equal_torch(config, open_levels):
    torch_backend, numba_backend = both(config)
    rays = random_rays(config, [30, 0, 64, 71, 1])
    gains = np.array([[1.1, 0.9, 1.0], [0.8, 1.0, 1.2]], np.float32)
    train = TrainConfig(distortion_weight=0.7, huber_delta=0.15)
    wanted = torch_backend.gradients(rays, gains, train, open_levels)
    actual = numba_backend.gradients(rays, gains, train, open_levels)
    np.testing.assert_allclose(actual, wanted, rtol=1e-4)
    for name, grad in torch_backend.grads.items():
        assert np.abs(grad).max() > 0.0, name
        close(numba_backend.grads[name].sum(axis=0), grad[0])
    close(numba_backend.gain_grads.sum(axis=0), torch_backend.gain_grads[0])


def test_gradients_are_added():
    _, backend = both(CONFIGS[0])
    rays = random_rays(CONFIGS[0], [40, 40])
    gains = np.ones((2, 3), np.float32)
    backend.gradients(rays, gains, TrainConfig(), 8.0)
    once = backend.grads["table"].copy()
    backend.gradients(rays, gains, TrainConfig(), 8.0)
    close(backend.grads["table"], 2.0 * once)


def test_levels_grow_geometrically_and_coarse_ones_are_dense():
    levels = grid_levels(FieldConfig(levels=6, log2_table_size=12, coarsest=8, finest=256))
    resolutions = np.array([v.resolution for v in levels])
    assert resolutions[0] == 8
    assert resolutions[-1] == 256
    ratios = np.log(resolutions[1:] / resolutions[:-1])
    np.testing.assert_allclose(ratios, np.log(2.0), atol=0.02)
    assert levels[0].dense
    assert levels[0].entries == 9**3
    assert not levels[-1].dense
    assert levels[-1].entries == 4096
    offsets = [v.offset for v in levels]
    assert offsets == np.cumsum([0] + [v.entries for v in levels[:-1]]).tolist()
