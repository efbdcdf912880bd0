"""What a field says of the surface that it knows: what is sharp and was shown is known."""

from pathlib import Path

import numpy as np
import pytest

from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.training import Trainer
from server.nerf.uncertainty import KnownSurface, known_surface
from tests.nerf.tiny_scene import BALL_CENTRE, BALL_RADIUS, BOX, write_tiny_scene

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
    assert abs(np.median(away) - BALL_RADIUS) < 0.03
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


def test_a_field_that_was_never_trained_knows_nothing(scene: Path) -> None:
    known = known_after(scene, 24, 0)
    assert len(known.points) == 0 or known.uncertainty.mean() > 0.8
