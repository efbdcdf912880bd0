"""What a field says of the surface that it knows: what is sharp and was shown is known."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.poses import look_at
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.training import Trainer
from server.nerf.uncertainty import KnownSurface, ending_entropy, known_surface
from tests.nerf.tiny_scene import BALL_CENTRE, BALL_RADIUS, BOX, CAMERA, write_tiny_scene

FIELD = FieldConfig(levels=6, log2_table_size=13, features=2, coarsest=8, finest=128)
TRAIN = TrainConfig(rays_per_step=512, memory_cells=32)


def known_after(folder: Path, pictures: int, steps: int) -> KnownSurface:
    """Return what a field knows that saw the first so many of 24 views around the ball."""
    hidden = range(pictures, 24)
    trainer = Trainer(load_dataset(folder), FIELD, TRAIN, held_out=hidden, seed=3, threads=2)
    trainer.run(steps=steps)
    return known_surface(trainer, BOX, np.random.default_rng(0))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_scene(tmp_path_factory.mktemp("tiny") / "scene")


@pytest.fixture(scope="module")
def from_all_sides(scene: Path) -> KnownSurface:
    return known_after(scene, 24, 300)


@pytest.mark.slow
def test_the_places_are_on_the_surface(from_all_sides: KnownSurface) -> None:
    away = np.linalg.norm(from_all_sides.points - BALL_CENTRE, axis=1)
    assert len(away) > 100
    assert np.percentile(np.abs(away - BALL_RADIUS), 80) < 0.06
    np.testing.assert_allclose(np.linalg.norm(from_all_sides.normals, axis=1), 1.0)
    assert ((from_all_sides.uncertainty >= 0.0) & (from_all_sides.uncertainty <= 1.0)).all()


@pytest.mark.slow
def test_what_was_shown_is_known_better_than_the_far_side(
    scene: Path, from_all_sides: KnownSurface
) -> None:
    # The first half of the views stands at y > 0.
    from_one_side = known_after(scene, 12, 300)
    shown = from_one_side.normals[:, 1] > 0.5
    hidden = from_one_side.normals[:, 1] < -0.5
    unknown = from_one_side.uncertainty
    assert unknown[hidden].mean() > unknown[shown].mean() + 0.2
    assert from_all_sides.uncertainty.mean() < unknown[hidden].mean() - 0.2


def test_a_field_that_was_never_trained_has_no_surface(scene: Path) -> None:
    assert len(known_after(scene, 24, 0).points) == 0


def test_the_entropy_is_none_at_a_sharp_end_and_whole_where_all_ends_are_alike() -> None:
    sharp, alike = np.zeros(7), np.full(7, 1.0 / 8.0)
    sharp[3] = 1.0
    found = ending_entropy(np.stack([sharp, alike]), np.array([0.0, 1.0 / 8.0]))
    np.testing.assert_allclose(found, [0.0, 1.0], atol=1e-9)


class _Slab:
    """A field that is solid below a height and nothing above, seen by one camera straight above."""

    top_m = 0.5
    training_pictures = (0,)

    def __init__(self) -> None:
        above = look_at(np.array([0.0, 0.01, 3.0]), np.array([0.0, 0.0, 0.5]))
        self.dataset = SimpleNamespace(T_world_cam=above[None], intrinsics=(CAMERA,))

    def densities_at(self, points_world: np.ndarray) -> np.ndarray:
        return np.where(points_world[:, 2] < self.top_m, 1e4, 0.0)


def test_a_sharp_surface_is_as_unknown_as_its_one_picture_leaves_it() -> None:
    slab = _Slab()
    box = Box3(np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 1.0]))
    known = known_surface(cast("Trainer", slab), box, np.random.default_rng(1))
    # Rays that come in by the sides below the top end there; the others end on the top.
    on_top = np.abs(known.points[:, 2] - slab.top_m) < 0.03
    assert on_top.sum() > 100
    inner = on_top & (np.abs(known.points[:, :2]).max(axis=1) < 0.4)
    towards = slab.dataset.T_world_cam[0, :3, 3] - known.points[inner]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    straight = np.maximum((towards * known.normals[inner]).sum(axis=1), 0.0)
    np.testing.assert_allclose(known.uncertainty[inner], np.exp(-straight), atol=0.02)
    # No light reaches the camera from a place inside the slab.
    below = known.points[:, 2] < slab.top_m - 0.2
    assert below.any()
    np.testing.assert_allclose(known.uncertainty[below], 1.0, atol=1e-6)
