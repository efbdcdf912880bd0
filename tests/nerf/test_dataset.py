"""Datasets: what is read, what is written, and every way to fail."""

import json

import cv2
import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.dataset import DatasetError, PosedFile, load_dataset, write_transforms
from server.nerf.sightings import Sightings, write_sightings

CAMERA = Intrinsics(40, 30, 35.0, 36.0, 19.2, 14.8, (0.01, -0.02, 0.001, 0.002, 0.003))
POSES = [look_at(np.array([np.cos(a), np.sin(a), 0.5]), np.zeros(3)) for a in (0.0, 1.0, 2.0)]


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"{k}.png"), rng.integers(0, 255, (30, 40, 3), np.uint8))
    box = Box3(np.array([-0.1, -0.2, 0.0]), np.array([0.1, 0.2, 0.5]))
    write_transforms(tmp_path, [PosedFile(f"{k}.png", T) for k, T in enumerate(POSES)], CAMERA, box)
    return tmp_path


def edit(folder, change):
    path = folder / "transforms.json"
    description = json.loads(path.read_text())
    change(description)
    path.write_text(json.dumps(description))


def test_what_is_written_is_read_back(folder):
    dataset = load_dataset(folder)
    np.testing.assert_allclose(dataset.T_world_cam, POSES, atol=1e-12)
    assert [f.name for f in dataset.files] == ["0.png", "1.png", "2.png"]
    camera = dataset.intrinsics[0]
    np.testing.assert_allclose(
        [camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion],
        [CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, *CAMERA.distortion],
    )
    assert dataset.object_box is not None
    np.testing.assert_allclose(dataset.object_box.upper, [0.1, 0.2, 0.5])
    assert dataset.masks == (None, None, None)
    assert not list(folder.glob("*.part"))


@pytest.mark.parametrize("floor_z", [None, 0.0, -0.25])
def test_the_floor_s_height_is_kept(folder, floor_z):
    files = [PosedFile(f"{k}.png", T) for k, T in enumerate(POSES)]
    write_transforms(folder, files, CAMERA, None, floor_z)
    assert load_dataset(folder).floor_z == floor_z


def test_a_floor_that_is_no_height_is_named(folder):
    edit(folder, _set("floor_z", "low"))
    with pytest.raises(DatasetError, match="floor_z"):
        load_dataset(folder)


def sightings_of(points):
    """Where ``points`` (m, 3) appear in the three pictures."""
    pixels = np.concatenate([CAMERA.project(points, T)[0] for T in POSES])
    count = len(points)
    return Sightings(points, np.repeat(np.arange(3), count), np.tile(np.arange(count), 3), pixels)


POINTS = np.array([[0.02, 0.01, 0.0], [-0.05, 0.04, 0.03], [0.0, -0.06, -0.02]])


@pytest.mark.parametrize("downscale", [1, 2])
def test_distances_of_points_that_were_seen_are_known(folder, downscale):
    assert all(len(known.pixels) == 0 for known in load_dataset(folder).known)
    write_sightings(folder, sightings_of(POINTS))
    dataset = load_dataset(folder, downscale=downscale)
    for known, camera, T in zip(
        dataset.known, dataset.intrinsics, dataset.T_world_cam, strict=True
    ):
        wanted = np.linalg.norm(POINTS - T[:3, 3], axis=1)
        np.testing.assert_allclose(known.distances_m, wanted, rtol=1e-5)
        pixels, _ = camera.project(POINTS, T)
        rows, columns = np.divmod(known.pixels, camera.width)
        assert np.abs(np.stack([columns, rows], axis=1) - pixels).max() <= 0.51


def test_sightings_that_do_not_fit_the_poses_are_not_believed(folder):
    seen = sightings_of(POINTS)
    moved = POINTS + np.outer([1.0, 0.0, 0.0], [0.0, 0.0, 0.2])
    write_sightings(folder, Sightings(moved, seen.pictures, seen.points, seen.pixels))
    assert [len(known.pixels) for known in load_dataset(folder).known] == [2, 2, 2]


def test_some_pictures_sightings_are_numbered_anew(folder):
    some = sightings_of(POINTS).of(np.array([2, 0]))
    assert some.pictures.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(some.pixels[:3], CAMERA.project(POINTS, POSES[2])[0])
    np.testing.assert_allclose(some.points_world[some.points[3:]], POINTS)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04half"])
def test_damaged_sightings_are_named(folder, content):
    (folder / "sightings.npz").write_bytes(content)
    with pytest.raises(DatasetError, match=r"sightings\.npz"):
        load_dataset(folder)


def test_pictures_are_rgb(folder):
    blue = np.zeros((30, 40, 3), np.uint8)
    blue[:, :, 0] = 255
    cv2.imwrite(str(folder / "0.png"), blue)
    assert load_dataset(folder).images[0][0, 0].tolist() == [0, 0, 255]


def test_file_has_half_pixel_offset_and_opengl_axes(folder):
    description = json.loads((folder / "transforms.json").read_text())
    assert description["cx"] == CAMERA.cx + 0.5
    matrix = np.array(description["frames"][0]["transform_matrix"])
    # An OpenGL camera looks along its -z, which is the OpenCV camera's +z.
    np.testing.assert_allclose(matrix[:3, 2], -POSES[0][:3, 2])


def test_downscale_keeps_rays(folder):
    whole, half = load_dataset(folder), load_dataset(folder, downscale=2)
    assert half.images[0].shape == (15, 20, 3)
    # The corner between the first 2x2 pixels is the centre of the first half-size pixel.
    np.testing.assert_allclose(
        half.intrinsics[0].directions(np.array([[0.0, 0.0]])),
        whole.intrinsics[0].directions(np.array([[0.5, 0.5]])),
        atol=1e-9,
    )


def test_long_side_is_limited(folder):
    assert load_dataset(folder, max_side=20).images[0].shape == (15, 20, 3)


def test_described_size_may_differ_from_the_picture(folder):
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.zeros((15, 20, 3), np.uint8))
    np.testing.assert_allclose(load_dataset(folder).intrinsics[0].fx, CAMERA.fx / 2)


def test_camera_angle_stands_in_for_focal_length(folder):
    def change(d):
        angle = 2 * np.arctan(40 / (2 * 35.0))
        for key in ("fl_x", "fl_y", "cx", "cy", "camera_angle_y"):
            d.pop(key)
        d["camera_angle_x"] = angle

    edit(folder, change)
    camera = load_dataset(folder).intrinsics[0]
    np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [35, 35, 19.5, 14.5])


def test_frames_may_have_their_own_camera(folder):
    edit(folder, lambda d: d["frames"][1].update(fl_x=50.0))
    assert [c.fx for c in load_dataset(folder).intrinsics] == [35.0, 50.0, 35.0]


def test_pinhole_ignores_distortion(folder):
    edit(folder, lambda d: d.update(camera_model="PINHOLE"))
    assert load_dataset(folder).intrinsics[0].distortion == (0, 0, 0, 0, 0)


def test_transparency_is_white_and_mask(folder):
    picture = np.zeros((30, 40, 4), np.uint8)
    picture[10:20, 10:20] = [0, 0, 255, 255]
    cv2.imwrite(str(folder / "0.png"), picture)
    dataset = load_dataset(folder)
    assert dataset.images[0][0, 0].tolist() == [255, 255, 255]
    assert dataset.images[0][15, 15].tolist() == [255, 0, 0]
    assert dataset.masks[0] is not None
    assert dataset.masks[0].sum() == 100


def test_mask_file(folder):
    mask = np.zeros((30, 40), np.uint8)
    mask[:, 20:] = 255
    cv2.imwrite(str(folder / "m.png"), mask)
    edit(folder, lambda d: d["frames"][2].update(mask_path="m.png"))
    dataset = load_dataset(folder)
    assert dataset.masks[2] is not None
    assert dataset.masks[2].mean() == 0.5


def _set(key, value):
    return lambda d: d.update({key: value})


def _one_place(d):
    for frame in d["frames"]:
        for row in range(3):
            frame["transform_matrix"][row][3] = 0.5


def _pose(row, column, value):
    def change(d):
        d["frames"][1]["transform_matrix"][row][column] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("frames", []), "no frames"),
        (lambda d: d["frames"].__delitem__(slice(1, None)), "one picture only"),
        (lambda d: d["frames"][1].update(file_path="gone.png"), "1 of 3 .* first gone.png"),
        (lambda d: d["frames"][1].pop("file_path"), "frame 1 .* no file_path"),
        (lambda d: d["frames"][1].pop("transform_matrix"), "pose of 1.png is missing"),
        (_pose(0, 3, float("nan")), "not finite"),
        (_one_place, "taken from one point"),
        (lambda d: d["frames"][1].update(transform_matrix=np.zeros((4, 4)).tolist()), "singular"),
        (lambda d: d["frames"][1].update(transform_matrix=[[1, 2], [3, 4]]), "not 4x4"),
        (_set("camera_model", "OPENCV_FISHEYE"), "unknown: OPENCV_FISHEYE"),
        (_set("k4", 0.1), "unknown"),
        (_set("fl_x", "wide"), "not numbers"),
        (_set("fl_x", -1.0), "positive"),
        (_set("object_box", [[1, 1, 1], [0, 0, 0]]), "object_box"),
        (lambda d: d["frames"][0].update(mask_path="no.png"), "mask no.png"),
    ],
)
def test_bad_descriptions_are_named(folder, change, message):
    edit(folder, change)
    with pytest.raises(DatasetError, match=message) as failure:
        load_dataset(folder)
    assert "\n" not in str(failure.value)


def test_no_focal_length(folder):
    edit(folder, lambda d: [d.pop(k) for k in ("fl_x", "camera_angle_x")])
    with pytest.raises(DatasetError, match="neither fl_x nor camera_angle_x"):
        load_dataset(folder)


def test_no_transforms(tmp_path):
    with pytest.raises(DatasetError, match=r"has no transforms\.json"):
        load_dataset(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", "\x00"])
def test_broken_json(tmp_path, text):
    (tmp_path / "transforms.json").write_text(text)
    with pytest.raises(DatasetError, match="JSON"):
        load_dataset(tmp_path)


def test_unreadable_picture(folder):
    (folder / "1.png").write_bytes(b"not a picture")
    with pytest.raises(DatasetError, match="cannot be read"):
        load_dataset(folder)


def test_downscale_below_one(folder):
    with pytest.raises(DatasetError, match="downscale"):
        load_dataset(folder, downscale=0)
