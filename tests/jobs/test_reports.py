"""What a training leaves behind for people to look at."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from server.jobs.plan import KnownPlaces
from server.jobs.reports import FieldReports, keep_renderings
from server.jobs.worker import Reporter
from server.mission.events import TrainingProgressed
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import write_tiny_scene


class Told(Reporter):
    """Keeps what it is told instead of a file, and takes no signal."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.events: list[tuple[str, dict[str, Any]]] = []

    def emit(self, event: str, **fields: Any) -> None:
        self.events.append((event, fields))


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
    told = Told(tmp_path)
    FieldReports(trainer, told, tmp_path, images=4).tell_known(seed=0)
    ((event, fields),) = told.events
    assert event == "known"
    known = KnownPlaces.model_validate_json(json.dumps(fields | {"at_s": 1.0}))
    assert known.points
    assert len(known.points) == len(known.normals) == len(known.uncertainty)


@pytest.mark.parametrize(("downscale", "measured"), [(1, True), (2, False)])
def test_held_out_pictures_are_judged_as_the_training_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, downscale: int, measured: bool
) -> None:
    """A picture smaller than the window of SSIM has none, which ends no training."""
    monkeypatch.setattr("server.jobs.reports._SCORE_S", 0.0)
    monkeypatch.setattr("server.jobs.reports._REPORT_S", 0.0)
    dataset = load_dataset(write_tiny_scene(tmp_path / "scene", 4), downscale=downscale)
    trainer = Trainer(dataset, FieldConfig(), TrainConfig(), held_out=[0], threads=1)
    told = Told(tmp_path)
    reports = FieldReports(trainer, told, tmp_path, images=4)
    reports.begin("train", 10.0, [0])
    trainer.run(steps=2, on_progress=reports.on_step)
    first, *_, last = (
        TrainingProgressed(**fields) for event, fields in told.events if event == "progressed"
    )
    assert first.held_out_psnr_db is None
    assert first.held_out_ssim is None
    assert last.held_out_psnr_db is not None
    assert (last.held_out_ssim is not None) == measured
    if last.held_out_ssim is not None:
        assert -1.0 < last.held_out_ssim < 1.0
