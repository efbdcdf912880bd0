"""Cut-out pictures: what is read as such, where their object can be, and that it is learned."""

import dataclasses

import cv2
import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.nerf.config import FieldConfig, suited_configs
from server.nerf.dataset import DatasetError, load_dataset
from server.nerf.hull import grown_mask, tight_space, visual_hull
from server.nerf.rays import PixelSource
from server.nerf.space import contract, scene_space
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import (
    BALL_CENTRE,
    BALL_RADIUS,
    BOX,
    CAMERA,
    ball_mask,
    ball_points,
    write_cut_out_scene,
    write_tiny_scene,
)

CELLS = 64


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The tiny scene with every picture transparent around the ball."""
    return write_cut_out_scene(tmp_path_factory.mktemp("cut") / "scene")


@pytest.fixture(scope="module")
def dataset(folder):
    return load_dataset(folder)


def cells_of(points, space):
    return tuple((contract(space.to_scene(points)) * CELLS).astype(int).T)


def test_transparent_pictures_are_cut_out_and_lie_on_white(dataset):
    assert dataset.cut_out
    for image, mask, T in zip(dataset.images, dataset.masks, dataset.T_world_cam, strict=True):
        np.testing.assert_array_equal(mask, ball_mask(T))
        assert (image[~mask] == 255).all()


def test_opaque_pictures_with_an_alpha_channel_show_a_room(tmp_path):
    folder = write_tiny_scene(tmp_path / "scene", pictures=4)
    for file in sorted((folder / "images").iterdir()):
        image = np.asarray(cv2.imread(str(file)))
        cv2.imwrite(str(file), np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]))
    assert not load_dataset(folder).cut_out


def test_masks_cut_out_only_when_asked_for(tmp_path):
    folder = write_tiny_scene(tmp_path / "scene", pictures=4)
    with pytest.raises(DatasetError, match=r"000\.png has no mask"):
        load_dataset(folder, object_only=True)
    text = (folder / "transforms.json").read_text()
    (folder / "transforms.json").write_text(
        text.replace('"file_path"', '"mask_path": "mask.png",\n"file_path"')
    )
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    mask[10:30, 20:40] = 255
    cv2.imwrite(str(folder / "mask.png"), mask)
    assert not load_dataset(folder).cut_out
    cut = load_dataset(folder, object_only=True)
    assert cut.cut_out
    assert (cut.images[0][mask == 0] == 255).all()
    assert (cut.images[0][mask > 0] == load_dataset(folder).images[0][mask > 0]).all()


def test_hull_keeps_all_of_the_object_and_little_else(dataset):
    space = scene_space(dataset)
    hull = visual_hull(dataset, range(len(dataset)), space, CELLS)
    assert hull[cells_of(ball_points(), space)].all()
    cell_m = 4.0 / CELLS * space.half_size
    ball_cells = 4.0 / 3.0 * np.pi * (BALL_RADIUS / cell_m) ** 3
    assert hull.sum() < 2.5 * ball_cells


def test_one_wrong_mask_of_many_costs_nothing(dataset):
    empty = np.zeros_like(dataset.alphas[3])
    wrong = dataclasses.replace(dataset, alphas=(*dataset.alphas[:3], empty, *dataset.alphas[4:]))
    space = scene_space(dataset)
    hull = visual_hull(wrong, range(len(wrong)), space, CELLS)
    assert hull[cells_of(ball_points(), space)].all()


def test_masks_that_contradict_each_other_leave_the_whole_cube(dataset):
    nothing = dataclasses.replace(
        dataset, alphas=tuple(np.zeros_like(alpha) for alpha in dataset.alphas)
    )
    hull = visual_hull(nothing, range(len(nothing)), scene_space(nothing), CELLS)
    assert hull.sum() == (CELLS // 2) ** 3


def test_the_object_is_found_without_a_box(dataset):
    space = tight_space(dataclasses.replace(dataset, object_box=None))
    assert np.abs(space.to_scene(ball_points())).max() <= 1.0
    assert np.linalg.norm(space.centre - BALL_CENTRE) < 0.1
    assert space.half_size < 1.5 * BALL_RADIUS


def test_only_pixels_that_may_show_the_object_are_drawn(dataset):
    space = scene_space(dataset)
    batch = PixelSource(
        dataset, [2], space, object_share=0.0, surface_share=0.0, hull_cells=CELLS
    ).draw(3000, np.random.default_rng(0))
    near = grown_mask(dataset, 2, space, CELLS, times=2)
    assert near.mean() < 0.7
    # Every pixel drawn lies there, and some of them beside the object.
    share = ball_mask(dataset.T_world_cam[2])[near].mean()
    assert batch.alphas.mean() == pytest.approx(share, abs=0.05)
    assert set(np.unique(batch.alphas)) == {0.0, 1.0}
    assert (batch.targets[batch.alphas == 0.0] == 1.0).all()


@pytest.mark.slow
def test_the_object_is_learned_and_nothing_around_it(dataset):
    field = FieldConfig(levels=6, log2_table_size=13, features=2, coarsest=8, finest=128)
    train = dataclasses.replace(suited_configs(cut_out=True)[1], rays_per_step=512, memory_cells=32)
    trainer = Trainer(dataset, field, train, held_out=(0, 8), seed=0, threads=2)
    trainer.run(steps=300)
    metrics = trainer.evaluate((0, 8)).metrics
    assert metrics.psnr_db > 18.0
    shown = trainer.render(CAMERA, dataset.T_world_cam[0])
    mask = ball_mask(dataset.T_world_cam[0])
    # Cells of the hull blur the edge by two pixels.
    inner = cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    outer = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    assert shown.opacity[inner].mean() > 0.95
    assert shown.opacity[outer].mean() < 0.05


def test_a_box_that_is_given_is_kept(dataset):
    assert isinstance(dataset.object_box, Box3)
    assert Trainer(
        dataset, *suited_configs(cut_out=True), held_out=[0], threads=1
    ).space.half_size == pytest.approx(BOX.size.max() / 2.0 * 1.15)
