"""A run is made larger: poses, box, points, field and mesh stay in step."""

import json
from typing import Any

import numpy as np
import pytest
import trimesh

from server.nerf import rescaled_run
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.rescaled_run import rescale_runs
from server.nerf.sightings import Sightings, write_sightings
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import BOX, CAMERA, ball_points, write_tiny_scene

FIELD = FieldConfig(levels=4, log2_table_size=10, features=2, coarsest=8, finest=64)
TRAIN = TrainConfig(rays_per_step=128, memory_cells=32)
FACTOR = 1.25
COLOUR = [200, 100, 50, 255]


@pytest.fixture
def run(tmp_path):
    """A run folder with everything that has metres in it."""
    run = write_tiny_scene(tmp_path / "run-1", pictures=6)
    dataset = load_dataset(run)
    points = ball_points(20)
    pixels = np.concatenate([CAMERA.project(points, T)[0] for T in dataset.T_world_cam])
    numbers = np.arange(20)
    write_sightings(
        run, Sightings(points, np.repeat(np.arange(6), 20), np.tile(numbers, 6), pixels)
    )
    trainer = Trainer(load_dataset(run), FIELD, TRAIN, held_out=())
    trainer.run(steps=30)
    trainer.save(run / "checkpoint.npz")
    box = trimesh.creation.box((0.4, 0.6, 0.8))
    colours = np.tile(np.array([COLOUR], np.uint8), (len(box.vertices), 1))
    trimesh.Trimesh(box.vertices, box.faces, vertex_colors=colours).export(run / "mesh.glb")
    about = {"pictures": [{"file": "a", "refined": True, "sigma_m": 0.004, "sigma_deg": 0.1}]}
    (run / "poses.json").write_text(json.dumps(about))
    return run


def test_all_lengths_grow_and_the_field_shows_the_same(run):
    before = load_dataset(run)
    shown = Trainer.load(run / "checkpoint.npz", before).render(CAMERA, before.T_world_cam[0])
    rescale_runs([run], FACTOR, {"length_m": 0.5})
    after = load_dataset(run)
    np.testing.assert_allclose(
        after.T_world_cam[:, :3, 3], FACTOR * before.T_world_cam[:, :3, 3], atol=1e-9
    )
    np.testing.assert_allclose(
        after.T_world_cam[:, :3, :3], before.T_world_cam[:, :3, :3], atol=1e-9
    )
    assert after.object_box is not None
    np.testing.assert_allclose(after.object_box.size, FACTOR * BOX.size)
    for old, new in zip(before.known, after.known, strict=True):
        assert old.pixels.tolist() == new.pixels.tolist()
        np.testing.assert_allclose(new.distances_m, FACTOR * old.distances_m, rtol=1e-5)
    again = Trainer.load(run / "checkpoint.npz", after).render(CAMERA, after.T_world_cam[0])
    np.testing.assert_allclose(again.rgb, shown.rgb, atol=2e-3)
    np.testing.assert_allclose(again.depth_m, FACTOR * shown.depth_m, rtol=1e-3, atol=1e-3)
    mesh: Any = trimesh.load(run / "mesh.glb", force="mesh")
    np.testing.assert_allclose(sorted(mesh.extents), FACTOR * np.array([0.4, 0.6, 0.8]))
    assert np.unique(mesh.visual.vertex_colors, axis=0).tolist() == [COLOUR]
    assert json.loads((run / "poses.json").read_text())["pictures"][0]["sigma_m"] == 0.005
    assert not list(run.glob("*.part"))


def test_factors_add_up(run):
    rescale_runs([run], 2.0, {"length_m": 1.0})
    rescale_runs([run], 0.6, {"length_m": 0.6})
    told = json.loads((run / "scale.json").read_text())
    assert told == {"factor": pytest.approx(1.2), "length_m": 0.6}


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_no_scale_at_all_is_refused(run, factor):
    with pytest.raises(ValueError, match="positive"):
        rescale_runs([run], factor, {})


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("fails_at", [1, 4, 7])
def test_a_disk_that_fills_up_on_the_way_changes_nothing(run, monkeypatch, fails_at):
    anew = run.parent / "anew"
    anew.mkdir()
    (anew / "checkpoint.npz").write_bytes((run / "checkpoint.npz").read_bytes())
    before, written = contents(run.parent), []

    def full(_fd):
        written.append(1)
        if len(written) == fails_at:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(rescaled_run.os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        rescale_runs([anew, run], FACTOR, {})
    assert len(written) == fails_at
    assert contents(run.parent) == before


@pytest.mark.parametrize(
    "name", ["checkpoint.npz", "sightings.npz", "poses.json", "scale.json", "transforms.json"]
)
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04half", b"{}"])
def test_a_damaged_file_is_named_and_nothing_is_changed(run, name, content):
    (run / name).write_bytes(content)
    before = contents(run)
    with pytest.raises(ValueError, match=name.replace(".", r"\.")):
        rescale_runs([run], FACTOR, {})
    assert contents(run) == before


def test_a_run_without_poses_of_its_own_is_scaled_all_the_same(run):
    (run.parent / "anew").mkdir()
    rescale_runs([run.parent / "anew"], FACTOR, {})
    assert json.loads((run.parent / "anew" / "scale.json").read_text()) == {"factor": FACTOR}
