"""Training on a tiny ray-traced scene: it learns, repeats itself, and survives on disk."""

import dataclasses

import cv2
import numpy as np
import pytest

from server.nerf.config import FieldConfig, TrainConfig, suited_configs
from server.nerf.dataset import load_dataset
from server.nerf.orbit_view import OrbitView, orbit_pose
from server.nerf.preview import render_preview
from server.nerf.rays import PixelSource, camera_rays
from server.nerf.sightings import KnownPixels
from server.nerf.space import scene_space
from server.nerf.training import Trainer
from tests.nerf.tiny_scene import (
    BALL_CENTRE,
    BALL_RADIUS,
    CAMERA,
    ball_mask,
    ball_points,
    write_tiny_scene,
)

FIELD = FieldConfig(levels=6, log2_table_size=13, features=2, coarsest=8, finest=128)
TRAIN = TrainConfig(
    rays_per_step=512,
    memory_cells=32,
)
HELD_OUT = (0, 8)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return load_dataset(write_tiny_scene(tmp_path_factory.mktemp("tiny") / "scene"))


def make(dataset, **changes):
    options = {"held_out": HELD_OUT, "seed": 3, "threads": 2, **changes}
    return Trainer(dataset, FIELD, TRAIN, **options)


@pytest.mark.slow
def test_training_reproduces_pictures_it_has_not_seen(dataset):
    trainer = make(dataset)
    trainer.run(steps=2)
    before = trainer.evaluate(HELD_OUT).metrics
    trainer.run(steps=300)
    after = trainer.evaluate(HELD_OUT).metrics
    assert after.images_held_out == 2
    assert after.images == 24
    assert after.psnr_db > before.psnr_db + 2.5
    assert after.ssim > before.ssim
    assert trainer.samples_per_s > 0.0
    # A wrong camera cannot show the right picture.
    turned = {0: dataset.T_world_cam[4]}
    assert trainer.evaluate([0], turned).metrics.psnr_db < after.psnr_db - 2.0


@pytest.mark.slow
def test_depth_is_in_metres(dataset):
    trainer = make(dataset)
    trainer.run(steps=300)
    shown = trainer.render(CAMERA, dataset.T_world_cam[4])
    distance = np.linalg.norm(dataset.T_world_cam[4][:3, 3] - BALL_CENTRE) - 0.35
    assert shown.opacity[24, 32] > 0.9
    assert shown.depth_m[24, 32] == pytest.approx(distance, abs=0.12)


@pytest.mark.slow
def test_equal_seeds_give_equal_fields(dataset):
    pictures = []
    for seed in (3, 3, 4):
        trainer = make(dataset, seed=seed)
        trainer.run(steps=25)
        pictures.append(trainer.render(CAMERA, dataset.T_world_cam[0]).rgb)
    np.testing.assert_array_equal(pictures[0], pictures[1])
    assert np.abs(pictures[0] - pictures[2]).max() > 1e-4


@pytest.mark.slow
def test_torch_and_numba_take_the_same_steps(dataset):
    losses = []
    for backend in ("torch", "numba"):
        trainer = make(dataset, backend=backend)
        losses.append([trainer.step().loss for _ in range(4)])
    np.testing.assert_allclose(losses[0], losses[1], rtol=2e-3)


@pytest.mark.slow
def test_checkpoint_shows_the_same_picture(dataset, tmp_path):
    trainer = make(dataset)
    trainer.run(steps=30)
    trainer.save(tmp_path / "checkpoint")
    again = Trainer.load(tmp_path / "checkpoint", dataset, threads=2)
    np.testing.assert_array_equal(
        again.render(CAMERA, dataset.T_world_cam[0]).rgb,
        trainer.render(CAMERA, dataset.T_world_cam[0]).rgb,
    )
    assert again.steps == 30
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint"]
    fewer = dataclasses.replace(dataset, files=dataset.files[:5])
    with pytest.raises(ValueError, match="another size"):
        Trainer.load(tmp_path / "checkpoint", fewer)


@pytest.mark.slow
def test_training_goes_on_as_if_it_had_never_stopped(dataset, tmp_path):
    whole = make(dataset)
    whole.run(steps=40)
    first = make(dataset)
    # Stopped in the middle of its schedule, and between two refreshes of the memory.
    first.run(steps=40, should_stop=lambda: first.steps >= 21)
    first.save(tmp_path / "checkpoint", resumable=True)
    second = Trainer.load(tmp_path / "checkpoint", dataset, seed=9, threads=2)
    second.run(steps=19, progress_from=21 / 40)
    assert second.steps == 40
    for trainer in (whole, second):
        trainer.use_threads(1)
    shown = [t.render(CAMERA, dataset.T_world_cam[0]).rgb for t in (whole, second)]
    np.testing.assert_allclose(shown[0], shown[1], atol=1e-4)


def test_a_checkpoint_that_cannot_be_written_leaves_nothing(dataset, tmp_path, monkeypatch):
    trainer = make(dataset)

    def full_disk(stream, **_arrays):
        stream.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full_disk)
    with pytest.raises(OSError, match="No space left"):
        trainer.save(tmp_path / "checkpoint")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_held_out_pictures_do_not_touch_the_field(dataset):
    images = list(dataset.images)
    for index in HELD_OUT:
        images[index] = 255 - images[index]
    changed = dataclasses.replace(dataset, images=tuple(images))
    renderings = []
    for which in (dataset, changed):
        trainer = make(which)
        trainer.run(steps=10)
        renderings.append(trainer.render(CAMERA, dataset.T_world_cam[0]).rgb)
    np.testing.assert_array_equal(*renderings)


@pytest.mark.slow
def test_run_stops_when_asked_and_hurries(dataset):
    trainer = make(dataset)
    trainer.run(steps=50, should_stop=lambda: trainer.steps >= 7)
    assert trainer.steps == 7
    trainer.run(steps=50, hurry=lambda: True)
    assert trainer.steps - 7 == 10
    with pytest.raises(ValueError, match="seconds or steps"):
        trainer.run()


@pytest.mark.slow
def test_all_pictures_may_join_later(dataset):
    trainer = make(dataset)
    trainer.run(steps=20)
    trainer.use_pictures(range(len(dataset)))
    report = trainer.run(steps=20, progress_from=0.5)
    assert report is not None
    assert report.step == 40
    with pytest.raises(ValueError, match="no picture"):
        trainer.use_pictures([])


@pytest.mark.slow
def test_preview_is_a_jpeg_of_the_orbit(dataset):
    trainer = make(dataset)
    trainer.run(steps=5)
    preview = render_preview(trainer, 0.25, width=80, height=60)
    picture = cv2.imdecode(np.frombuffer(preview.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (60, 80, 3)
    pixel, depth = preview.intrinsics.project(BALL_CENTRE[None], preview.T_world_cam)
    np.testing.assert_allclose(pixel[0], [39.5, 29.5], atol=1e-6)
    assert depth[0] > 0.5


@pytest.mark.slow
def test_a_view_is_from_where_it_is_wanted(dataset):
    trainer = make(dataset)
    trainer.run(steps=5)
    view = OrbitView(azimuth_rad=0.5, elevation_rad=1.2, distance=0.8)
    preview = render_preview(trainer, view, width=80, height=60)
    assert preview.view == view
    offset = preview.T_world_cam[:3, 3] - trainer.space.centre
    cameras = dataset.T_world_cam[:, :3, 3] - trainer.space.centre
    distance = np.median(np.linalg.norm(cameras, axis=1))
    np.testing.assert_allclose(np.linalg.norm(offset), 0.8 * distance)
    np.testing.assert_allclose(np.arctan2(offset[1], offset[0]), 0.5)
    np.testing.assert_allclose(np.arctan2(offset[2], np.hypot(*offset[:2])), 1.2)


def test_orbit_closes():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[1, 0, 1], [0, 2, 1], [-1, 0, 1]]
    start, end = (orbit_pose(poses, np.zeros(3), t) for t in (0.0, 1.0))
    np.testing.assert_allclose(start, end, atol=1e-12)
    np.testing.assert_allclose(start[:3, 3], [1, 0, 1], atol=1e-12)


def some_of(dataset, count):
    """The first pictures of ``dataset``."""
    return dataclasses.replace(
        dataset,
        files=dataset.files[:count],
        images=dataset.images[:count],
        masks=dataset.masks[:count],
        alphas=dataset.alphas[:count],
        intrinsics=dataset.intrinsics[:count],
        T_world_cam=dataset.T_world_cam[:count],
        known=dataset.known[:count],
    )


@pytest.mark.slow
def test_new_pictures_are_taken_in_without_forgetting(dataset):
    trainer = make(some_of(dataset, 8), held_out=())
    trainer.run(steps=150)
    before = trainer.render(CAMERA, dataset.T_world_cam[1]).rgb
    trainer.take_in(dataset)
    # Samples lie elsewhere, as more cells are seen; the field is the same.
    after = trainer.render(CAMERA, dataset.T_world_cam[1]).rgb
    assert np.abs(after - before).mean() < 0.05
    unseen = trainer.evaluate([12]).metrics.psnr_db
    trainer.run(steps=150, progress_from=0.35)
    assert trainer.steps == 300
    assert trainer.evaluate([12]).metrics.psnr_db > unseen + 1.0
    with pytest.raises(ValueError, match="24 pictures cannot become 8"):
        trainer.take_in(some_of(dataset, 8))


def test_drawn_rays_carry_their_pixels(dataset):
    space = scene_space(dataset)
    source = PixelSource(dataset, [2, 5], space, object_share=0.5, surface_share=0.3, hull_cells=32)
    batch = source.draw(200, np.random.default_rng(0))
    assert set(batch.pictures) == {2, 5}
    for picture in (2, 5):
        _, directions = camera_rays(CAMERA, dataset.T_world_cam[picture], space)
        rows = np.flatnonzero(batch.pictures == picture)
        nearest = (batch.directions[rows] @ directions.T).argmax(axis=1)
        wanted = dataset.images[picture].reshape(-1, 3)[nearest] / 255.0
        np.testing.assert_allclose(batch.targets[rows], wanted, atol=1e-6)
        # Nothing is known of this scene's distances.
        assert (batch.distances == 0.0).all()


def seen_ball(dataset, every=1):
    """The dataset with the distances of points on the ball's near side known."""
    known = []
    for camera, T in zip(dataset.intrinsics, dataset.T_world_cam, strict=True):
        points = ball_points(400)[::every]
        towards = T[:3, 3] - points
        near = ((points - BALL_CENTRE) * towards).sum(axis=1) > 0.1 * BALL_RADIUS
        points = points[near]
        pixels, _ = camera.project(points, T)
        x, y = np.round(pixels).astype(np.int64).T
        distances = np.linalg.norm(points - T[:3, 3], axis=1).astype(np.float32)
        known.append(KnownPixels(y * camera.width + x, distances))
    return dataclasses.replace(dataset, known=tuple(known))


def test_rays_towards_known_points_carry_their_distances(dataset):
    known = seen_ball(dataset)
    space = scene_space(known)
    source = PixelSource(known, [2], space, object_share=0.0, surface_share=1.0, hull_cells=32)
    batch = source.draw(300, np.random.default_rng(0))
    ends = space.to_world(batch.origins + batch.directions * batch.distances[:, None])
    away = np.linalg.norm(ends - BALL_CENTRE, axis=1)
    # Pixels are as wide as a few centimetres there.
    np.testing.assert_allclose(away, BALL_RADIUS, atol=0.03)


def depth_error(trainer, T):
    """The median error of the ball's rendered depths from a pose, metres."""
    on_ball = ball_mask(T)
    v, u = np.nonzero(on_ball)
    d = CAMERA.directions(np.stack([u, v], axis=1).astype(float)) @ T[:3, :3].T
    o = T[:3, 3] - BALL_CENTRE
    b = d @ o
    true = -b - np.sqrt(b**2 - o @ o + BALL_RADIUS**2)
    return float(np.median(np.abs(trainer.render(CAMERA, T).depth_m[on_ball] - true)))


@pytest.mark.slow
def test_known_distances_put_the_surface_of_few_views_where_it_is(dataset):
    trainers = []
    for data in (dataset, seen_ball(dataset, every=8)):
        trainer = make(data, held_out=[k for k in range(24) if k % 4])
        trainer.run(steps=150)
        trainers.append(trainer)
    # One of the six pictures, and one between two of them.
    for view in (4, 6):
        without, with_known = (depth_error(each, dataset.T_world_cam[view]) for each in trainers)
        assert with_known < 0.5 * without


@pytest.mark.parametrize(
    ("make_config", "name"),
    [
        (lambda: FieldConfig(levels=0), "levels"),
        (lambda: FieldConfig(coarsest=64, finest=32), "coarsest"),
        (lambda: TrainConfig(learning_rate=-1.0), "learning_rate"),
        (lambda: TrainConfig(object_share=1.5), "object_share"),
        (lambda: TrainConfig(rays_per_step=0), "rays_per_step"),
        (lambda: TrainConfig(bin_length=float("nan")), "bin_length"),
    ],
)
def test_bad_configs_are_named(make_config, name):
    with pytest.raises(ValueError, match=name):
        make_config()


def test_trainer_refuses_nonsense(dataset):
    with pytest.raises(ValueError, match="threads"):
        make(dataset, threads=0)
    with pytest.raises(ValueError, match="no picture"):
        make(dataset, held_out=range(24))


def test_a_room_of_known_distances_is_trained_without_other_helps(dataset):
    assert not dataset.distances_known
    assert seen_ball(dataset).distances_known
    _, helped = suited_configs(cut_out=False)
    _, known = suited_configs(cut_out=False, distances_known=True)
    assert helped.distortion_weight > 0.0
    assert helped.window_until > 0.0
    assert (known.distortion_weight, known.window_until) == (0.0, 0.0)
