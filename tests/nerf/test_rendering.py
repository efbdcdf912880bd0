"""Compositing, distortion, sampling and scene space against closed forms."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.poses import look_at
from server.nerf.config import FieldConfig
from server.nerf.field import initial_parameters
from server.nerf.kernels.cpu_rays import composite
from server.nerf.rendering import distortion_of, huber, weights_of
from server.nerf.sampling import sample_rays
from server.nerf.space import contract, expand, focus_point
from server.nerf.torch_backend import TorchBackend


def test_constant_fog_has_exponential_light():
    n, sigma, step = 50, 3.0, 0.02
    starts = np.array([0, n], np.int64)
    sigmas = np.full(n, sigma, np.float32)
    rgbs = np.tile(np.array([[1.0, 0.5, 0.0]], np.float32), (n, 1))
    image, depth, opacity = (
        np.empty((1, 3), np.float32),
        np.empty(1, np.float32),
        np.empty(1, np.float32),
    )
    ts = np.arange(n, dtype=np.float32)
    composite(
        starts,
        sigmas,
        rgbs,
        ts,
        np.float32(step),
        np.array([0, 0, 1], np.float32),
        image,
        depth,
        opacity,
    )
    seen = 1.0 - np.exp(-n * sigma * step)
    np.testing.assert_allclose(opacity, seen, rtol=1e-5)
    np.testing.assert_allclose(image[0], [seen, 0.5 * seen, 1.0 - seen], rtol=1e-5)
    # The mean of a geometric distribution that is cut off after n samples.
    through = np.exp(-sigma * step)
    mean = through / (1 - through) - n * through**n / (1 - through**n)
    np.testing.assert_allclose(depth, mean, rtol=1e-4)


def test_ray_without_samples_shows_the_backdrop():
    image, depth, opacity = (
        np.empty((1, 3), np.float32),
        np.empty(1, np.float32),
        np.empty(1, np.float32),
    )
    none = np.empty(0, np.float32)
    composite(
        np.zeros(2, np.int64), none, none.reshape(0, 3), none, np.float32(0.1),
        np.array([0.1, 0.2, 0.3], np.float32), image, depth, opacity,
    )  # fmt: skip
    np.testing.assert_allclose(image[0], [0.1, 0.2, 0.3])
    assert opacity[0] == 0.0


@given(st.lists(st.floats(0.0, 200.0), min_size=1, max_size=40), st.floats(0.001, 0.2))
def test_weights_and_light_add_to_one(sigmas, step):
    n = len(sigmas)
    weights, light = weights_of(
        torch.tensor(sigmas), torch.tensor([0, n]), torch.zeros(n, dtype=torch.int64), step
    )
    assert float(weights.sum() + light[0]) == pytest.approx(1.0, abs=1e-5)
    assert (weights >= 0).all()


@given(st.integers(0, 2**31))
def test_distortion_equals_the_double_sum(seed):
    rng = np.random.default_rng(seed)
    w, s = rng.random((2, 3, 12))
    s.sort(axis=1)
    step = 0.03
    wanted = [
        (w[r][:, None] * w[r] * abs(s[r][:, None] - s[r])).sum() + (w[r] ** 2).sum() * step / 3
        for r in range(3)
    ]
    got = distortion_of(
        torch.from_numpy(w.ravel()).float(),
        torch.from_numpy(s.ravel()).float(),
        torch.tensor([0, 12, 24, 36]),
        torch.arange(3).repeat_interleave(12),
        step,
    )
    np.testing.assert_allclose(got.numpy(), wanted, rtol=1e-4)


def test_huber_is_quadratic_then_linear():
    error = torch.tensor([-0.05, 0.1, 0.5])
    np.testing.assert_allclose(huber(error, 0.1).numpy(), [0.00125, 0.005, 0.045], rtol=1e-5)


@given(st.lists(st.tuples(*[st.floats(-20, 20)] * 3), min_size=1, max_size=20))
def test_contraction_stays_in_the_cube_and_can_be_undone(points):
    points = np.array(points)
    u = contract(points)
    assert ((u > 0) & (u < 1)).all()
    np.testing.assert_allclose(expand(u), points, rtol=1e-6, atol=1e-6)


def test_contraction_leaves_the_object_alone():
    points = np.array([[0.3, -0.9, 1.0]])
    np.testing.assert_allclose(contract(points), (points + 2) / 4)


def test_focus_is_where_the_cameras_look():
    target = np.array([0.3, -0.2, 0.5])
    poses = np.stack(
        [
            look_at(target + np.array([2 * np.cos(a), 2 * np.sin(a), 1.0]), target)
            for a in (0.0, 1.5, 4.0)
        ]
    )
    np.testing.assert_allclose(focus_point(poses), target, atol=1e-9)


def test_focus_of_parallel_cameras_lies_ahead():
    pose = look_at(np.zeros(3), np.array([1.0, 0.0, 0.0]))
    other = pose.copy()
    other[:3, 3] = [0.0, 0.4, 0.0]
    assert focus_point(np.stack([pose, other]))[0] > 0.2


class WallBackend(TorchBackend):
    """An opaque wall in the plane x = 0 of scene units, empty elsewhere."""

    def __init__(self):
        config = FieldConfig(levels=1, log2_table_size=8, coarsest=2, finest=2)
        super().__init__(config, initial_parameters(config, 0), 1)

    def densities(self, points, open_levels):
        return np.where(points[:, 0] > 0.5, 1e4, 0.0).astype(np.float32)


def test_rays_end_at_the_first_surface_and_keep_their_order():
    rng = np.random.default_rng(0)
    rays = 300
    origins = np.tile(np.array([[-3.0, 0.0, 0.0]], np.float32), (rays, 1))
    d = np.stack([np.ones(rays), *rng.uniform(-0.2, 0.2, (2, rays))], axis=1).astype(np.float32)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    samples = sample_rays(
        WallBackend(), np.ones((32, 32, 32), bool), origins, d, rng.random(rays, np.float32),
        near=0.5, step=1 / 64, open_levels=8.0, transmittance=1e-3, least_weight=0.0, chunks=2,
    )  # fmt: skip
    last = samples.starts[1:] - 1
    # All samples before the wall are kept, and exactly one inside it.
    np.testing.assert_array_equal(
        np.add.reduceat((samples.points[:, 0] > 0.5).astype(int), samples.starts[:-1]), 1
    )
    np.testing.assert_allclose(samples.points[last, 0], 0.5, atol=1 / 64)
    assert (np.diff(samples.ray_ids) >= 0).all()
    same = np.diff(samples.ray_ids) == 0
    np.testing.assert_allclose(np.diff(samples.ss)[same], 1 / 64, rtol=1e-4)
    x = origins[samples.ray_ids] + samples.ts[:, None] * d[samples.ray_ids]
    np.testing.assert_allclose(contract(x.astype(float)), samples.points, atol=1e-5)


def test_empty_cells_are_skipped():
    occupied = np.zeros((32, 32, 32), bool)
    occupied[20] = True
    origins = np.array([[-3.0, 0.01, 0.01]], np.float32)
    samples = sample_rays(
        WallBackend(), occupied, origins, np.array([[1, 0, 0]], np.float32),
        np.zeros(1, np.float32),
        near=0.5, step=1 / 64, open_levels=8.0, transmittance=0.0, least_weight=0.0, chunks=1,
    )  # fmt: skip
    cells = np.floor(samples.points[:, 0] * 32)
    assert len(cells) > 0
    assert (cells == 20).all()
