"""Compositing, distortion, sampling and scene space against closed forms."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.poses import look_at
from server.nerf.kernels.cpu_rays import composite
from server.nerf.rendering import distortion_of, huber, weights_of
from server.nerf.sampling import sample_rays, visible_part
from server.nerf.space import contract, expand, focus_point


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
        np.full(n, step, np.float32),
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
        np.zeros(2, np.int64), none, none.reshape(0, 3), none, none,
        np.array([0.1, 0.2, 0.3], np.float32), image, depth, opacity,
    )  # fmt: skip
    np.testing.assert_allclose(image[0], [0.1, 0.2, 0.3])
    assert opacity[0] == 0.0


@given(st.lists(st.floats(0.0, 200.0), min_size=1, max_size=40), st.floats(0.001, 0.2))
def test_weights_and_light_add_to_one(sigmas, step):
    n = len(sigmas)
    weights, light = weights_of(
        torch.tensor(sigmas),
        torch.tensor([0, n]),
        torch.zeros(n, dtype=torch.int64),
        torch.full((n,), step),
    )
    assert float(weights.sum() + light[0]) == pytest.approx(1.0, abs=1e-5)
    assert (weights >= 0).all()


@given(st.integers(0, 2**31))
def test_distortion_equals_the_double_sum(seed):
    rng = np.random.default_rng(seed)
    w, s = rng.random((2, 3, 12))
    s.sort(axis=1)
    ds = rng.uniform(0.01, 0.1, (3, 12))
    wanted = [
        (w[r][:, None] * w[r] * abs(s[r][:, None] - s[r])).sum() + (w[r] ** 2 * ds[r]).sum() / 3
        for r in range(3)
    ]
    got = distortion_of(
        torch.from_numpy(w.ravel()).float(),
        torch.from_numpy(s.ravel()).float(),
        torch.tensor([0, 12, 24, 36]),
        torch.arange(3).repeat_interleave(12),
        torch.from_numpy(ds.ravel()).float(),
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


class Grid:
    """A density memory made by hand: cells that are seen, and how dense they are."""

    def __init__(self, cells=32):
        self.seen = np.ones((cells, cells, cells), bool)
        self.densities = np.zeros((cells, cells, cells), np.float32)
        self.far = cells / 4.0


def towards_the_wall(rays=300, seed=0):
    rng = np.random.default_rng(seed)
    origins = np.tile(np.array([[-3.0, 0.0, 0.0]], np.float32), (rays, 1))
    d = np.stack([np.ones(rays), *rng.uniform(-0.2, 0.2, (2, rays))], axis=1).astype(np.float32)
    return origins, d / np.linalg.norm(d, axis=1, keepdims=True)


def spread(grid, origins, directions, slots=16, even=0.2, seed=1):
    jitters = np.random.default_rng(seed).random((len(origins), slots), np.float32)
    return sample_rays(
        grid, origins, directions, jitters, near=0.5, bin_length=1 / 20, even=even, chunks=2
    )


@given(even=st.floats(0.05, 1.0), seed=st.integers(0, 1000))
def test_samples_are_ordered_and_cover_all_of_the_ray_that_is_seen(even, seed):
    grid = Grid()
    grid.densities[:] = np.random.default_rng(seed).exponential(1.0, grid.densities.shape)
    origins, directions = towards_the_wall(20, seed)
    samples = spread(grid, origins, directions, even=even, seed=seed)
    ss, dss = samples.ss.reshape(20, 16), samples.dss.reshape(20, 16)
    assert (np.diff(ss, axis=1) >= 0).all()
    assert (dss >= 0).all()
    # Every sample lies in the stretch it stands for, and the stretches join without a gap.
    ends = np.cumsum(dss, axis=1)
    assert (ss <= ends + 1e-3).all()
    assert (ss >= ends - dss - 1e-3).all()
    x = origins[samples.ray_ids] + samples.ts[:, None] * directions[samples.ray_ids]
    np.testing.assert_allclose(contract(x.astype(float)), samples.points, atol=1e-5)


def test_a_ray_of_an_object_alone_is_looked_at_only_inside_its_cube():
    grid = Grid()
    grid.far = 1.0
    origins, directions = towards_the_wall(40)
    directions[0] = [0.0, 1.0, 0.0]  # Misses the cube.
    samples = spread(grid, origins, directions)
    x = origins[samples.ray_ids] + samples.ts[:, None] * directions[samples.ray_ids]
    covered = samples.dss > 0.0
    # The last bin may reach beyond the cube's far face by its own length.
    assert np.abs(x[covered]).max() <= 1.0 + 2 / 20
    assert not covered.reshape(40, -1)[0].any()
    np.testing.assert_allclose(
        samples.dss.reshape(40, -1)[1:].sum(axis=1), 2.0 / directions[1:, 0], atol=3 / 20
    )


def test_most_samples_go_where_density_is_remembered():
    grid = Grid()
    grid.densities[16] = 50.0  # A wall at u = 0.5, the plane x = 0.
    samples = spread(grid, *towards_the_wall(), even=0.2)
    near_wall = np.abs(samples.points[:, 0] - 0.5) < 3 / 32
    assert near_wall.mean() > 0.6
    # Yet every ray is also looked at elsewhere, and closely enough to find something new there.
    elsewhere = (~near_wall).reshape(-1, 16).sum(axis=1)
    assert (elsewhere >= 1).all()


def test_nothing_is_sampled_where_no_camera_sees():
    grid = Grid()
    grid.seen[:] = False
    grid.seen[20] = True
    samples = spread(grid, *towards_the_wall(50))
    cells = samples.points[:, 0] * 32
    # Bins are cut by their middles, so a sample may lie up to half a bin outside.
    assert (np.abs(cells - 20.5) < 0.5 + 0.5 * 32 / 20 / 4 + 1e-3).all()
    grid.seen[:] = False
    blind = spread(grid, *towards_the_wall(5))
    np.testing.assert_array_equal(blind.dss, 0.0)
    assert np.isfinite(blind.points).all()


def test_a_rendering_keeps_what_shows_and_nothing_behind_a_wall():
    samples = spread(Grid(), *towards_the_wall(), even=1.0)
    sigmas = np.where(samples.points[:, 0] > 0.5, 1e4, 0.0).astype(np.float32)
    shown = visible_part(samples, sigmas, transmittance=1e-3, least_weight=1e-3)
    np.testing.assert_array_equal(np.diff(shown.starts), 1)
    assert (shown.points[:, 0] > 0.5).all()
    assert (np.diff(shown.ray_ids) == 1).all()
