"""What a finished field is good for: its surface, a film of it, files for other programs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import av
import numpy as np
import pycolmap
import pytest
import trimesh

from server.geometry.boxes import Box3
from server.geometry.poses import inverse
from server.jobs import export, render
from server.jobs.results import write_results
from server.jobs.spec import JobSpec
from server.jobs.worker import Reporter
from server.nerf.config import FieldConfig, TrainConfig, suited_configs
from server.nerf.dataset import load_dataset
from server.nerf.exports import write_colmap, write_mesh, write_points
from server.nerf.hull import box_of_masks
from server.nerf.object_part import object_part, on_object
from server.nerf.orbit import fitting_frames, render_orbit
from server.nerf.saved_run import SavedRunError, open_dataset, open_field
from server.nerf.surface import NoSurfaceError, Surface, extract_surface
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import (
    BALL_CENTRE,
    BALL_RADIUS,
    BOX,
    ball_points,
    write_cut_out_scene,
)

CELLS = 40


class Silent(Reporter):
    """A reporter that keeps what it is told."""

    def __init__(self) -> None:  # Without the folder and the signals of a worker.
        self.events: list[dict[str, Any]] = []
        self.stop = False

    def emit(self, event: str, **fields: Any) -> None:
        self.events.append({"event": event} | fields)

    def should_stop(self) -> bool:
        return self.stop


def small_configs() -> tuple[FieldConfig, TrainConfig]:
    small = FieldConfig(levels=6, log2_table_size=13, features=2, coarsest=8, finest=128)
    return small, replace(suited_configs(cut_out=True)[1], rays_per_step=512, memory_cells=32)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder with the field of a ball, cut out of its pictures."""
    folder = write_cut_out_scene(tmp_path_factory.mktemp("results") / "run")
    dataset = load_dataset(folder)
    trainer = Trainer(dataset, *small_configs(), held_out=[], seed=1, threads=1)
    trainer.run(steps=250)
    trainer.save(folder / "checkpoint.npz")
    (folder / "metrics.json").write_text(json.dumps({"dataset": str(folder)}))
    return folder


@pytest.fixture(scope="module")
def field(run: Path) -> Trainer:
    return open_field(run, open_dataset(run), 1)


@pytest.fixture(scope="module")
def surface(field: Trainer) -> Surface:
    told: list[float] = []
    found = extract_surface(field, CELLS, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    return found


def test_the_surface_is_that_of_the_ball(surface: Surface) -> None:
    from_centre = surface.vertices - BALL_CENTRE
    # All cameras look down: what is below, nobody has seen.
    seen = from_centre[:, 2] > -0.1
    from_centre = from_centre[seen]
    radii = np.linalg.norm(from_centre, axis=1)
    cell_m = 1.1 * float(BOX.size.max()) / CELLS
    assert np.median(np.abs(radii - BALL_RADIUS)) < cell_m
    assert np.percentile(np.abs(radii - BALL_RADIUS), 90) < 3.0 * cell_m
    outwards = (surface.normals[seen] * from_centre).sum(axis=1) / radii
    assert np.median(outwards) > 0.9
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * BALL_RADIUS**3, rel=0.5)


def test_its_colours_are_those_of_the_pictures(field: Trainer, surface: Surface) -> None:
    shown = np.concatenate(
        [
            image[mask]
            for image, mask in zip(field.dataset.images, field.dataset.masks, strict=True)
            if mask is not None
        ]
    )
    np.testing.assert_allclose(surface.colours.mean(axis=0), shown.mean(axis=0), atol=25.0)


def test_a_field_that_shows_nothing_has_no_surface(run: Path) -> None:
    dataset = open_dataset(run)
    fresh = Trainer(dataset, *suited_configs(cut_out=True), held_out=[], threads=1)
    with pytest.raises(NoSurfaceError, match="no surface"):
        extract_surface(fresh, 16)


def test_what_most_masks_show_beside_the_object_is_not_on_it(field: Trainer) -> None:
    assert on_object(field.dataset, ball_points()).all()
    beside = BALL_CENTRE + np.array([[2.0 * BALL_RADIUS, 0.0, 0.0], [0.0, 0.0, 3.0 * BALL_RADIUS]])
    assert not on_object(field.dataset, beside).any()


def test_the_box_is_found_by_the_masks_where_they_agree(field: Trainer) -> None:
    shift = np.array([0.15, -0.1, 0.1])
    found = box_of_masks(field.dataset, Box3(BOX.lower + shift, BOX.upper + shift))
    assert found is not None
    np.testing.assert_allclose(found.centre, BALL_CENTRE, atol=0.1)
    assert (found.lower < BALL_CENTRE - 0.7 * BALL_RADIUS).all()
    assert (found.upper > BALL_CENTRE + 0.7 * BALL_RADIUS).all()
    nothing = tuple(np.zeros_like(mask) for mask in field.dataset.masks if mask is not None)
    assert box_of_masks(replace(field.dataset, masks=nothing), BOX) is None


def test_a_glb_stands_upright_and_a_ply_keeps_the_worlds_axes(
    surface: Surface, tmp_path: Path
) -> None:
    for ending, up in ((".glb", 1), (".ply", 2)):
        file = tmp_path / f"mesh{ending}"
        write_mesh(surface, file)
        mesh = trimesh.load(file, force="mesh")
        assert isinstance(mesh, trimesh.Trimesh)
        assert len(mesh.faces) == len(surface.faces)
        top = surface.vertices[:, 2].max()
        assert mesh.vertices[:, up].max() == pytest.approx(top, abs=1e-5)
        visual: Any = mesh.visual
        colours = np.asarray(visual.vertex_colors)[:, :3]
        np.testing.assert_allclose(colours.mean(axis=0), surface.colours.mean(axis=0), atol=1.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mesh.glb", "mesh.ply"]


def test_points_are_written(surface: Surface, tmp_path: Path) -> None:
    write_points(surface.vertices, surface.colours, tmp_path / "points.ply")
    cloud: Any = trimesh.load(tmp_path / "points.ply")
    np.testing.assert_allclose(cloud.vertices, surface.vertices, atol=1e-5)


def test_colmap_reads_cameras_poses_and_points(
    field: Trainer, surface: Surface, tmp_path: Path
) -> None:
    write_colmap(field.dataset, surface.vertices, surface.colours, tmp_path / "colmap")
    model = pycolmap.Reconstruction(str(tmp_path / "colmap"))
    assert model.num_reg_images() == len(field.dataset)
    assert model.num_points3D() == len(surface.vertices)
    by_name = {model.image(i).name: model.image(i) for i in model.reg_image_ids()}
    point = BALL_CENTRE + np.array([0.05, -0.04, 0.03])
    for index, file in enumerate(field.dataset.files):
        image = by_name[str(file.relative_to(field.dataset.folder))]
        T = field.dataset.T_world_cam[index]
        np.testing.assert_allclose(image.cam_from_world().matrix(), inverse(T)[:3], atol=1e-9)
        here, _ = field.dataset.intrinsics[index].project(point[None], T)
        theirs = image.project_point(point)
        assert theirs is not None
        # COLMAP counts from the picture's corner, we from the middle of the first pixel.
        np.testing.assert_allclose(theirs, here[0] + 0.5, atol=1e-6)


def test_a_film_goes_once_round(field: Trainer, tmp_path: Path) -> None:
    file = tmp_path / "orbit.mp4"
    assert render_orbit(field, file, frames=6, fps=12, width=64, height=48)
    with av.open(str(file)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) == 6
    assert pictures[0].shape == (48, 64, 3)
    assert all(np.ptp(picture) > 50 for picture in pictures), "each shows the ball"


def test_a_film_that_would_take_too_long_has_fewer_pictures_and_its_length(
    field: Trainer, tmp_path: Path
) -> None:
    file = tmp_path / "orbit.mp4"
    assert render_orbit(field, file, frames=24, fps=12, width=64, height=48, most_s=0.0)
    with av.open(str(file)) as film:
        (stream,) = film.streams.video
        assert stream.average_rate == 6
        assert sum(1 for _ in film.decode(video=0)) == 12
    assert fitting_frames(60, 0.5, 45.0) == 60
    assert fitting_frames(60, 1.5, 45.0) == 30
    assert fitting_frames(8, 100.0, 45.0) == 8


def test_a_film_of_the_object_alone_is_white_around_it(field: Trainer, tmp_path: Path) -> None:
    file = tmp_path / "orbit.mp4"
    ball = Box3(BALL_CENTRE - BALL_RADIUS, BALL_CENTRE + BALL_RADIUS)
    assert render_orbit(field, file, around=ball, frames=4, fps=4, width=128, height=96)
    with av.open(str(file)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    for picture in pictures:
        assert (picture[:, :4] > 240).all()
        assert picture[40:56, 56:72].min() < 200, "the ball is in the middle"
        dark = np.flatnonzero(np.any(picture < 200, axis=(1, 2)))
        assert dark[-1] - dark[0] > 40, "and large"


def test_what_is_rendered_of_a_part_lies_in_it(field: Trainer) -> None:
    part = field.object_part(CELLS)
    camera, pose = field.dataset.intrinsics[0], field.dataset.T_world_cam[0]
    shown = field.render(camera, pose, only=part, background=(0.0, 1.0, 0.0))
    distance_m = np.linalg.norm(pose[:3, 3] - BALL_CENTRE)
    solid = shown.opacity > 0.9
    assert solid.any()
    assert np.abs(shown.depth_m[solid] - distance_m).max() < np.linalg.norm(part.box.size)
    empty = shown.opacity < 0.01
    np.testing.assert_allclose(
        shown.rgb[empty], np.tile([0.0, 1.0, 0.0], (empty.sum(), 1)), atol=0.02
    )
    everywhere = replace(part, cells=np.zeros_like(part.cells))
    assert field.render(camera, pose, only=everywhere).opacity.max() == 0.0


@pytest.mark.parametrize("floor_z", [0.1, 0.3])
def test_what_lies_on_the_floor_is_no_part_of_the_object(field: Trainer, floor_z: float) -> None:
    def lowest_m(height: float | None) -> float:
        dataset = replace(field.dataset, floor_z=height)
        return float(object_part(dataset, field.space, CELLS, 32).points()[:, 2].min())

    assert lowest_m(None) < 0.1
    assert lowest_m(floor_z) >= floor_z + 0.01


def test_what_the_memory_calls_occupied_is_where_the_object_is(field: Trainer) -> None:
    whole, occupied = field.object_part(CELLS), field.object_part(CELLS, occupied=True)
    assert occupied.coarse.sum() < whole.coarse.sum()
    camera, pose = field.dataset.intrinsics[0], field.dataset.T_world_cam[0]
    all_of_it = field.render(camera, pose, only=whole).rgb
    np.testing.assert_allclose(
        field.render(camera, pose, only=occupied).rgb.mean(), all_of_it.mean(), atol=0.01
    )


def test_every_finished_field_leaves_mesh_and_film(field: Trainer, tmp_path: Path) -> None:
    reporter = Silent()
    assert write_results(field, tmp_path, reporter, cells=CELLS, frames=4) is None
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mesh.glb", "orbit.mp4"]
    assert {event["stage"] for event in reporter.events} == {"mesh", "film"}


def test_a_field_without_surface_is_filmed_and_says_that_it_has_no_mesh(
    run: Path, tmp_path: Path
) -> None:
    fresh = Trainer(open_dataset(run), *small_configs(), held_out=[], threads=1)
    missing = write_results(fresh, tmp_path, Silent(), cells=CELLS, frames=4)
    assert missing is not None
    assert "no mesh" in missing
    assert [file.name for file in tmp_path.iterdir()] == ["orbit.mp4"]


def test_a_stopped_job_makes_no_results(field: Trainer, tmp_path: Path) -> None:
    reporter = Silent()
    reporter.stop = True
    assert "stopped" in str(write_results(field, tmp_path, reporter))
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_is_stopped_leaves_nothing(field: Trainer, tmp_path: Path) -> None:
    asked = iter([False, False, True])
    film = tmp_path / "orbit.mp4"
    stop = asked.__next__
    assert not render_orbit(field, film, frames=6, width=64, height=48, should_stop=stop)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="even"):
        render_orbit(field, film, width=63, height=48)


def test_the_jobs_make_what_they_say(run: Path, tmp_path: Path) -> None:
    reporter = Silent()
    small = {"run": str(run), "cells": 20}
    for kind in ("glb", "ply", "points", "colmap", "transforms"):
        out = tmp_path / (f"object.{kind}" if kind in ("glb", "ply") else kind)
        made = export.run(JobSpec("export", small | {"format": kind, "out": str(out)}), reporter)
        assert Path(made["file"]) == out
        assert out.exists()
    copied = load_dataset(tmp_path / "transforms")
    assert len(copied) == len(load_dataset(run))
    made = render.run(
        JobSpec("render", {"run": str(run), "pictures": str(tmp_path / "beside")}), reporter
    )
    assert made["pictures"] == len(copied)
    assert len(list((tmp_path / "beside").iterdir())) == len(copied)
    assert {event["stage"] for event in reporter.events} == {"surface", "pictures"}
    reporter.stop = True
    with pytest.raises(ValueError, match="stopped"):
        render.run(
            JobSpec("render", {"run": str(run), "room": True, "width": 64, "height": 48}), reporter
        )


def test_what_is_no_run_is_refused_in_one_line(run: Path, tmp_path: Path) -> None:
    with pytest.raises(SavedRunError, match="no run"):
        open_dataset(tmp_path)
    (tmp_path / "checkpoint.npz").write_bytes(b"no archive")
    with pytest.raises(SavedRunError, match="cannot be opened"):
        open_field(tmp_path, open_dataset(run), 1)
    with pytest.raises(ValueError, match=r"\.glb"):
        export.run(JobSpec("export", {"run": str(run), "out": str(tmp_path / "a.obj")}), Silent())
