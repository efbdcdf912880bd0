from datetime import UTC, datetime

import cv2
import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import camera_pose
from server.nerf.dataset import load_dataset
from server.nerf.flight import FlightPicture, append_picture, read_pictures
from server.stages import CameraPose, Capture, Region, Telemetry
from server.store.atomic import write_atomic
from server.store.runs import RunFolder, list_runs


def _telemetry() -> Telemetry:
    zero = np.zeros(3)
    return Telemetry("drone-1", 0.0, 0.0, 0.0, 0.0, zero, zero, 0.8, 0.8, 0.0, 90, 60.0, 1.0)


def _capture(index: int) -> Capture:
    T = camera_pose(np.array([1.5, 0.1 * index, 0.8]), np.pi, 0.2)
    pose = CameraPose("drone-1", 1.0 + index, T, np.diag([0.01, 0.01, 0.01, 0.0025]))
    return Capture(
        index,
        0,
        pose,
        TELLO_INTRINSICS,
        _telemetry(),
        None,
        f"images/{index:04d}.jpg",
        datetime.now(UTC),
    )


def _jpeg() -> bytes:
    rng = np.random.default_rng(0)
    return cv2.imencode(".jpg", rng.integers(0, 255, (720, 960, 3), np.uint8))[1].tobytes()


def _region() -> Region:
    mask = np.zeros((180, 240), bool)
    mask[60:120, 80:160] = True
    return Region(np.array([480.0, 360.0]), 50.0, 10.0, mask, 4.0, 0.9)


def test_a_run_opens_as_a_dataset_with_masks_and_poses(tmp_path):
    run = RunFolder.create(tmp_path, "First light!")
    box = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.4]))
    for index in range(2):
        run.add_still(_capture(index), _jpeg(), _region(), box)
    dataset = load_dataset(run.path)
    assert len(dataset) == 2
    np.testing.assert_allclose(dataset.T_world_cam[1], _capture(1).pose.T_world_cam, atol=1e-9)
    np.testing.assert_allclose(dataset.intrinsics[0].K, TELLO_INTRINSICS.K)
    mask = dataset.masks[0]
    assert mask is not None
    assert mask[300:420, 400:560].all()
    assert not mask[:200].any()
    assert dataset.object_box is not None
    np.testing.assert_allclose(dataset.object_box.upper, box.upper)


def test_names_are_safe_and_never_reused(tmp_path):
    runs = [RunFolder.create(tmp_path, "../../évil name") for _ in range(3)]
    assert len({run.id for run in runs}) == 3
    assert all(run.path.parent == tmp_path for run in runs)
    assert all(set(run.id) <= set("abcdefghijklmnopqrstuvwxyz0123456789-") for run in runs)


def test_a_torn_last_line_loses_nothing_else(tmp_path):
    picture = FlightPicture("images/0000.jpg", None, True, "drone-1", 1.0, 0, np.eye(4), 0.1, 0.05)
    for _ in range(3):
        append_picture(tmp_path, picture)
    with (tmp_path / "pictures.jsonl").open("a") as stream:
        stream.write('{"file": "images/00')
    assert len(read_pictures(tmp_path)) == 3


def test_a_failed_write_leaves_the_old_file(tmp_path):
    target = tmp_path / "capture.json"
    write_atomic(target, b"old")
    with pytest.raises(TypeError):
        write_atomic(target, "not bytes")  # pyright: ignore[reportArgumentType]
    assert target.read_bytes() == b"old"


def test_only_folders_with_a_state_are_runs(tmp_path):
    (tmp_path / "stray").mkdir()
    run = RunFolder.create(tmp_path, "")
    run.write_state({"id": run.id})
    assert [found.id for found in list_runs(tmp_path)] == [run.id]
    assert list_runs(tmp_path / "missing") == []
    run.path.joinpath("capture.json").write_text("{")
    assert run.state() is None


def test_pictures_of_earlier_versions_have_no_sharpness(tmp_path):
    picture = FlightPicture("images/0000.jpg", None, True, "drone-1", 1.0, 0, np.eye(4), 0.1, 0.05)
    append_picture(tmp_path, picture)
    listed = tmp_path / "pictures.jsonl"
    listed.write_text(listed.read_text().replace(', "sharpness": null', ""))
    assert "sharpness" not in listed.read_text()
    (read,) = read_pictures(tmp_path)
    assert read.sharpness is None
