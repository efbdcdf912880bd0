"""The picture of the simulated world against the geometry that it must obey."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.geometry.poses import camera_pose, look_at
from server.sim.meshes import ObjectModel
from server.sim.scenes.catalogue import load_object
from server.sim.world import World, WorldError

OFF_CENTRE = Intrinsics(960, 720, 921.0, 880.0, 520.25, 310.5)
MARKER_M = 0.02
MARKERS = np.random.default_rng(4).uniform((-0.5, -0.5, 0.1), (0.5, 0.5, 1.0), (24, 3))
POSES = [
    camera_pose(np.array([2.0, 0.0, 0.9]), np.pi, 0.2),
    camera_pose(np.array([-1.2, 1.5, 0.5]), -0.9, 0.0),
    look_at(np.array([0.3, -2.4, 1.6]), np.array([0.0, 0.0, 0.4])),
]


def marker_model() -> ObjectModel:
    """Return small magenta spheres in the air."""
    ball = trimesh.creation.icosphere(2, MARKER_M)
    n = len(ball.vertices)
    vertices = np.concatenate([ball.vertices + centre for centre in MARKERS])
    faces = np.concatenate([ball.faces + k * n for k in range(len(MARKERS))]).astype(np.int64)
    return ObjectModel(
        vertices, faces, np.tile(np.array([255, 0, 255], np.uint8), (len(vertices), 1))
    )


def magenta(image_bgr: np.ndarray) -> np.ndarray:
    """Return which pixels show a marker; nothing in the room has this colour."""
    blue, green, red = (image_bgr[..., k].astype(int) for k in range(3))
    return (blue > 3 * green + 24) & (red > 3 * green + 24)


def marker_errors(mask: np.ndarray, intrinsics: Intrinsics, T_world_cam: np.ndarray) -> np.ndarray:
    """Return where each free-standing marker is seen minus where it belongs, ``(k, 2)`` pixels."""
    expected, depths = intrinsics.project(MARKERS, T_world_cam)
    radii = intrinsics.fx * MARKER_M / depths
    errors = []
    for k in np.flatnonzero(intrinsics.contains(expected, 40.0)):
        others = np.delete(np.arange(len(MARKERS)), k)
        gaps = np.linalg.norm(expected[others] - expected[k], axis=1)
        if (gaps < radii[others] + radii[k] + 6.0).any():
            continue
        left, top = np.floor(expected[k] - radii[k] - 4.0).astype(int)
        side = int(2 * radii[k] + 9)
        rows, columns = np.nonzero(mask[top : top + side, left : left + side])
        assert len(rows) > 20, "a marker is missing"
        errors.append(np.array([columns.mean() + left, rows.mean() + top]) - expected[k])
    return np.array(errors)


@pytest.fixture(scope="module")
def markers():
    world = World(marker_model(), intrinsics=OFF_CENTRE)
    yield world
    world.close()


@pytest.fixture(scope="module")
def dog():
    world = World(load_object("robot_dog"))
    yield world
    world.close()


@pytest.mark.slow
@pytest.mark.parametrize("pose", range(len(POSES)))
def test_points_appear_where_the_camera_model_projects_them(markers, pose):
    T = POSES[pose]
    errors = marker_errors(magenta(markers.render(T)), OFF_CENTRE, T)
    assert len(errors) >= 6
    assert np.abs(errors).max() < 1.0
    # Snapping is noise, not an offset: it must cancel over the markers.
    assert np.abs(errors.mean(axis=0)).max() < 0.25


@pytest.mark.slow
def test_supersampling_reduces_the_snapping_error():
    T, errors = POSES[0], {}
    for s in (1, 4):
        world = World(marker_model(), intrinsics=OFF_CENTRE, supersample=s)
        image = world.render(T)
        assert image.shape == (720, 960, 3)
        assert world.silhouette(T).shape == (720, 960)
        errors[s] = np.sqrt((marker_errors(world.silhouette(T), OFF_CENTRE, T) ** 2).mean())
        world.close()
    assert errors[4] < errors[1]
    assert errors[4] < 0.25


@pytest.mark.slow
def test_the_silhouette_is_the_object_as_rays_see_it(dog):
    model = load_object("robot_dog")
    T = camera_pose(np.array([1.2, 0.0, 0.5]), np.pi, np.deg2rad(12))
    mask = dog.silhouette(T)
    # One ray for every fourth pixel each way.
    columns, rows = np.meshgrid(np.arange(0, 960, 4), np.arange(0, 720, 4))
    pixels = np.stack([columns.reshape(-1), rows.reshape(-1)], axis=1).astype(float)
    rays = TELLO_INTRINSICS.directions(pixels) @ T[:3, :3].T
    hit = model.trimesh.ray.intersects_any(np.tile(T[:3, 3], (len(rays), 1)), rays)
    drawn = mask[rows.reshape(-1), columns.reshape(-1)]
    assert 0.02 < hit.mean() < 0.5
    # Only pixels on the outline may differ.
    assert (drawn & hit).sum() / (drawn | hit).sum() > 0.96


@pytest.mark.slow
def test_pictures_are_repeatable_and_depend_on_the_pose(dog):
    here, there = POSES[0], POSES[2]
    first = dog.render(here)
    other = dog.render(there)
    np.testing.assert_array_equal(dog.render(here), first)
    assert first.dtype == np.uint8
    assert np.abs(first.astype(int) - other).mean() > 5.0


@pytest.mark.slow
def test_two_worlds_live_side_by_side(dog, markers):
    alone = dog.render(POSES[0])
    markers.render(POSES[1])
    np.testing.assert_array_equal(dog.render(POSES[0]), alone)
    assert magenta(markers.render(POSES[1])).any()
    assert not magenta(alone).any()


@pytest.mark.slow
def test_other_drones_show_where_they_are_and_vanish_again(dog):
    T = camera_pose(np.array([1.5, 0.0, 0.8]), np.pi, np.deg2rad(12))
    position = np.array([-0.8, 0.4, 0.9])
    empty = dog.render(T)
    with_drone = dog.render(T, [(position, 0.4)])
    changed = np.abs(with_drone.astype(int) - empty).max(axis=2) > 12
    rows, columns = np.nonzero(changed)
    centre = TELLO_INTRINSICS.project(position[None], T)[0][0]
    np.testing.assert_allclose([columns.mean(), rows.mean()], centre, atol=8.0)
    # A body of 0.18 m at 2.3 m.
    assert 40 < np.ptp(columns) < 95
    np.testing.assert_array_equal(dog.render(T), empty)
    mask = dog.silhouette(T)
    dog.render(T, [(np.array([0.6, 0.0, 0.6]), 0.0)])
    np.testing.assert_array_equal(dog.silhouette(T), mask)


@pytest.mark.slow
def test_the_room_has_no_holes(dog):
    """The clear colour must show nowhere: the room is closed from everywhere inside."""
    T_up = camera_pose(np.array([0.2, 0.1, 1.0]), 0.3, -np.pi / 4)
    for T in (*POSES, T_up):
        image = dog.render(T)
        clear = (np.abs(image.astype(int) - np.array([66, 71, 76])) <= 1).all(axis=2)
        assert clear.mean() < 1e-3
        # Ordinary texture everywhere: hardly any 32 x 32 patch is flat.
        grey = image.mean(axis=2)[:704].reshape(22, 32, 30, 32)
        assert (grey.std(axis=(1, 3)) > 1.5).mean() > 0.9


@pytest.mark.slow
def test_a_closed_world_says_so():
    world = World(marker_model())
    world.close()
    world.close()
    with pytest.raises(WorldError, match="closed"):
        world.render(POSES[0])


@pytest.mark.parametrize("supersample", [0, 5])
def test_supersample_is_bounded(supersample):
    with pytest.raises(ValueError, match="supersample"):
        World(marker_model(), supersample=supersample)


def test_distortion_is_refused():
    bent = Intrinsics(960, 720, 921, 921, 479.5, 359.5, (0.1, 0, 0, 0, 0))
    with pytest.raises(ValueError, match="distortion"):
        World(marker_model(), intrinsics=bent)


NO_RENDERER = """
import server.sim.world as world
from server.sim.scenes.catalogue import load_object
world._CONFIG = world._CONFIG.replace("p3tinydisplay", "p3_no_such_module")
try:
    world.World(load_object("guitar"))
except world.WorldError as error:
    print(error)
"""


@pytest.mark.slow
def test_a_missing_renderer_is_one_line_and_no_crash():
    """In a process of its own: the display module is loaded once per process."""
    command = [sys.executable, "-c", NO_RENDERER]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert "software renderer" in done.stdout
    assert len(done.stdout.splitlines()) == 1
    assert done.stderr == ""
