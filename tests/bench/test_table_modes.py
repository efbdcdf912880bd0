"""With which cameras each mode of the table uses a flight's pictures, and what that is worth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.bench.poses_flight import FlownCapture, TrueView, fly_capture
from server.bench.table.fields import judge
from server.bench.table.modes import Posed, posed_as, true_poses
from server.bench.table.views import HeldOutViews
from server.geometry.cameras import TELLO_TILT_RAD, Intrinsics
from server.geometry.poses import Similarity, look_at, yaw_of_camera
from server.nerf.dataset import PosedFile, load_dataset, write_transforms
from server.nerf.flight import FlightPicture, append_picture, read_pictures
from server.nerf.sightings import Sightings, write_sightings
from server.sim.camera import STILL
from server.sim.config import SimConfig
from server.stages import Viewpoint
from tests.nerf.tiny_scene import BALL_CENTRE, CAMERA, ball_mask, trace, write_tiny_scene

SHIFT = np.array([0.3, -0.2, 0.1])
KEY_FRAME = 5


def flown(folder: Path) -> FlownCapture:
    """Return a flight around the tiny scene that believes itself ``SHIFT`` off the truth.

    Its drones were sent 10 cm beside where they believe to be; one key frame is among the stills.
    """
    run = write_tiny_scene(folder / "run", 24)
    dataset = load_dataset(run)
    truth: list[TrueView] = []
    sent_to: list[Viewpoint | None] = []
    for k, T in enumerate(dataset.T_world_cam):
        if k == KEY_FRAME:
            append_picture(
                run, FlightPicture("key.jpg", None, False, "drone-1", 0.0, -1, T, 0.1, 0.1)
            )
            truth.append(TrueView(T, STILL, CAMERA, ()))
            sent_to.append(None)
        file = f"images/{k:03d}.png"
        append_picture(run, FlightPicture(file, None, True, "drone-1", 0.0, 0, T, 0.1, 0.1))
        T_true = T.copy()
        T_true[:3, 3] += SHIFT
        truth.append(TrueView(T_true, STILL, replace(CAMERA, fx=61.0), ()))
        sent_to.append(Viewpoint(T[:3, 3] + 0.1, yaw_of_camera(T)))
    return FlownCapture(run, tuple(truth), tuple(sent_to), 60.0, SimConfig())


def test_nominal_poses_are_where_the_drones_were_sent(tmp_path: Path) -> None:
    capture = flown(tmp_path)
    posed = posed_as("standard_paper", capture, 0, 1)
    believed = load_dataset(capture.run)
    T = posed.dataset.T_world_cam
    np.testing.assert_allclose(T[:, :3, 3], believed.T_world_cam[:, :3, 3] + 0.1)
    np.testing.assert_allclose(-np.arcsin(T[:, 2, 2]), TELLO_TILT_RAD)
    assert posed.dataset.intrinsics == believed.intrinsics
    assert posed.used == list(range(24))


def test_true_poses_come_with_true_lenses_and_take_along_what_refinement_found(
    tmp_path: Path,
) -> None:
    capture = flown(tmp_path)
    believed = load_dataset(capture.run)
    # As a refinement leaves them, one picture of which it cannot place and leaves far off.
    told = [{"refined": k != 3} for k in range(24)]
    (capture.run / "poses.json").write_text(json.dumps({"pictures": told}))
    astray = believed.T_world_cam.copy()
    astray[3, :3, 3] += 2.0
    files = [PosedFile(f"images/{k:03d}.png", T) for k, T in enumerate(astray)]
    write_transforms(capture.run, files, CAMERA, believed.object_box)
    seen = replace(CAMERA, fx=61.0).project(BALL_CENTRE[None], believed.T_world_cam[7])[0]
    one, point = np.array([7]), np.array([0])
    write_sightings(capture.run, Sightings(BALL_CENTRE[None], one, point, seen))

    posed = posed_as("optimized_true_poses", capture, 0, 1)
    expected = believed.T_world_cam[:, :3, 3] + SHIFT
    np.testing.assert_allclose(posed.dataset.T_world_cam[:, :3, 3], expected)
    np.testing.assert_allclose(posed.T_true, true_poses(capture))
    assert posed.used == list(range(24))
    assert {camera.fx for camera in posed.dataset.intrinsics} == {61.0}
    assert posed.dataset.object_box is not None
    assert believed.object_box is not None
    np.testing.assert_allclose(
        posed.dataset.object_box.corners, believed.object_box.corners + SHIFT, atol=1e-9
    )
    distance = np.linalg.norm(BALL_CENTRE - believed.T_world_cam[7, :3, 3])
    assert [len(known.pixels) for known in posed.dataset.known] == [int(k == 7) for k in range(24)]
    np.testing.assert_allclose(posed.dataset.known[7].distances_m, [distance], rtol=1e-5)


def test_without_refinement_the_poses_are_those_believed_in_flight(tmp_path: Path) -> None:
    capture = flown(tmp_path)
    posed = posed_as("optimized", capture, 0, 1, without="refinement")
    believed = load_dataset(capture.run).T_world_cam
    np.testing.assert_array_equal(posed.dataset.T_world_cam, believed)
    np.testing.assert_allclose(posed.T_true[:, :3, 3], believed[:, :3, 3] + SHIFT)


def held_out() -> HeldOutViews:
    places = [[1.2 * np.cos(a), 1.2 * np.sin(a), 0.9] for a in (0.4, 2.5, 4.6)]
    poses = np.stack([look_at(np.array(place), BALL_CENTRE) for place in places])
    return HeldOutViews(
        poses,
        tuple(trace(CAMERA, T) for T in poses),
        tuple(ball_mask(T) for T in poses),
        CAMERA,
    )


def test_test_views_are_carried_into_the_frame_of_a_field(tmp_path: Path) -> None:
    dataset = load_dataset(write_tiny_scene(tmp_path / "run", 24))
    T_true, views = dataset.T_world_cam, held_out()
    turn = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()
    frame = Similarity(1.3, turn, np.array([0.8, 0.1, 0.4]))
    back = Similarity(1.0 / 1.3, turn.T, -turn.T @ frame.t / 1.3)

    def render(camera: Intrinsics, T: np.ndarray) -> NDArray[np.float32]:
        """Show a perfect field that lives in another frame, somewhat darker on its left."""
        shown = trace(camera, back.poses(T[None])[0]).astype(np.float32) / np.float32(255.0)
        shown[:, : camera.width // 2] *= np.float32(0.9)
        return shown

    centre = frame.points(BALL_CENTRE[None])[0]
    used = list(range(24))
    posed = Posed(replace(dataset, T_world_cam=frame.poses(T_true)), used, T_true)
    scores, shown, turned = judge(render, centre, posed, views)
    astray, _, _ = judge(render, centre, Posed(posed.dataset, used, frame.poses(T_true)), views)
    assert max(turned) < 1.0
    assert min(s.psnr_db for s in scores) > 20.0 > max(s.psnr_db for s in astray)
    for score, rgb, image, mask in zip(scores, shown, views.images_rgb, views.masks, strict=True):
        # The object's figure is that of its pixels alone.
        square = (rgb - image / 255.0) ** 2
        assert score.psnr_db == pytest.approx(-10.0 * np.log10(square.mean()), abs=1e-3)
        assert score.psnr_db_object == pytest.approx(-10 * np.log10(square[mask].mean()), abs=1e-3)
        assert score.psnr_db_object != pytest.approx(score.psnr_db, abs=0.05)


@pytest.mark.slow
def test_a_standard_flight_is_sent_round_one_circle_and_takes_its_pictures_there(
    tmp_path: Path,
) -> None:
    capture = fly_capture("recycle_bin", 1, 8, tmp_path, mode="standard")
    stills = [k for k, view in enumerate(capture.sent_to) if view is not None]
    assert len(stills) == sum(p.still for p in read_pictures(capture.run)) == 8
    sent = np.stack([view.position_world for view in capture.sent_to if view is not None])
    taken = np.stack([capture.truth[k].T_world_cam[:3, 3] for k in stills])
    assert np.ptp(sent[:, 2]) < 1e-9
    middle = sent[:, :2].mean(axis=0)
    radii = np.linalg.norm(sent[:, :2] - middle, axis=1)
    assert np.ptp(radii) < 1e-6
    azimuths = np.sort(np.arctan2(*(sent[:, 1::-1] - middle[::-1]).T))
    np.testing.assert_allclose(np.diff(azimuths), np.pi / 4)
    # The world is where the start places said it is, which is off by decimetres.
    assert np.linalg.norm(taken - sent, axis=1).max() < 0.6
    assert 10.0 < capture.flight_s < 300.0
