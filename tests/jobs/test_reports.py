"""What a training leaves behind for people to look at."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from server.jobs.plan import KnownPlaces
from server.jobs.reports import FieldReports, keep_renderings
from server.jobs.spec import EVENTS
from server.jobs.worker import Reporter
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import write_tiny_scene


def test_a_rendering_is_kept_as_it_was(tmp_path: Path) -> None:
    image_rgb = np.zeros((24, 32, 3), np.float32)
    image_rgb[..., 0] = 1.2  # Redder than red, as a rendering may be.
    image_rgb[..., 2] = 0.25
    keep_renderings(tmp_path)(8, image_rgb)
    kept_bgr = cv2.imread(str(tmp_path / "held_out/0008.jpg"))
    assert kept_bgr is not None
    assert kept_bgr.shape == (24, 32, 3)
    assert np.abs(kept_bgr.mean((0, 1)) - (63.75, 0.0, 255.0)).max() < 4.0


@pytest.mark.slow
def test_what_is_known_is_told_as_the_planner_reads_it(tmp_path: Path) -> None:
    dataset = load_dataset(write_tiny_scene(tmp_path / "scene"))
    field = FieldConfig(levels=6, log2_table_size=13, features=2, coarsest=8, finest=128)
    train = TrainConfig(rays_per_step=512, memory_cells=32)
    trainer = Trainer(dataset, field, train, held_out=[], threads=1)
    trainer.run(steps=200)
    FieldReports(trainer, Reporter(tmp_path), tmp_path, images=4).tell_known(seed=0)
    (line,) = (tmp_path / EVENTS).read_text().splitlines()
    event = json.loads(line)
    assert event["event"] == "known"
    known = KnownPlaces.model_validate(event)
    assert known.points
    assert len(known.points) == len(known.normals) == len(known.uncertainty)
