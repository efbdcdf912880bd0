"""Calibration: cameras are known beforehand and must be found again."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from board_pictures import BoardCamera, found_views, various_poses
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.vision.calibration import CalibrationRefusedError, calibrate
from server.vision.calibration_board import (
    Board,
    BoardError,
    BoardFinder,
    BoardView,
    draw_board,
    draw_sheet,
    parse_board,
    sheet_size_px,
)
from server.vision.calibration_views import CalibrationConfig, ViewPicker, coverage_of

CAMERA = Intrinsics(960, 720, 931.0, 927.0, 468.0, 352.0, (-0.035, 0.105, 0.0013, -0.0016, 0.0))
CHARUCO = parse_board("charuco:7x5:38:28")
CHESSBOARD = parse_board("chessboard:9x6:25")


@cache
def placer(camera: Intrinsics) -> BoardCamera:
    """Return what places a board before a camera."""
    return BoardCamera(camera, CHARUCO)


def seen(
    camera: Intrinsics,
    R_cam_board: NDArray[np.float64],
    t: NDArray[np.float64],
    board: Board = CHARUCO,
    noise_px: float = 0.0,
    rng: np.random.Generator | None = None,
    name: str = "",
) -> BoardView:
    """What a perfect finder, or one with some noise, would say of a board at a pose."""
    points = board.corner_points()
    T_cam_board = np.eye(4)
    T_cam_board[:3, :3], T_cam_board[:3, 3] = R_cam_board, t
    pixels, _ = camera.project(points @ R_cam_board.T + t, np.eye(4))
    if rng is not None:
        pixels = pixels + rng.normal(0.0, noise_px, pixels.shape)
    inside = camera.contains(pixels)
    ids = np.flatnonzero(inside)
    return BoardView(name, camera.width, camera.height, pixels[ids], points[ids], ids, 0.5)


def views_of(
    camera: Intrinsics, count: int, seed: int = 0, noise_px: float = 0.1
) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    return [
        seen(camera, *pose, noise_px=noise_px, rng=rng, name=f"{index:02d}")
        for index, pose in enumerate(various_poses(placer(camera), count, rng))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("board", [CHARUCO, CHESSBOARD, parse_board("charuco:8x6:30:22:4x4_50")])
def test_a_rendered_camera_is_recovered(board: Board) -> None:
    found = calibrate(found_views(BoardCamera(CAMERA, board), 20, seed=1))
    got = found.intrinsics
    for name in ("fx", "fy"):
        assert getattr(got, name) == pytest.approx(getattr(CAMERA, name), rel=0.005)
    for name in ("cx", "cy"):
        # Half a percent of the focal length, too: that is the angle by which it turns the view.
        assert getattr(got, name) == pytest.approx(getattr(CAMERA, name), abs=0.005 * CAMERA.fx)
    # What counts of the distortion is what it does to pixels.
    pixels = np.array([[x, y] for x in (60.0, 480.0, 900.0) for y in (60.0, 360.0, 660.0)])
    rays = CAMERA.directions(pixels)
    again, _ = got.project(rays, np.eye(4))
    turn = again.mean(axis=0) - pixels.mean(axis=0)
    assert np.abs(again - pixels - turn).max() < 2.0
    assert found.rms_px < 0.3


@pytest.mark.parametrize("board", [CHARUCO, CHESSBOARD])
def test_corners_lie_where_the_board_was_drawn(board: Board) -> None:
    camera = BoardCamera(CAMERA, board)
    pose = camera.aimed((0.5, 0.5), 0.5, (20.0, -15.0, 8.0))
    view = BoardFinder(board).find(camera.picture(*pose))
    assert view is not None
    truth = seen(CAMERA, *pose, board=board)
    assert len(view.ids) == board.corners
    got = view.pixels[np.argsort(view.ids)]
    # A chessboard without marks may be read from either end.
    error = min(float(np.abs(got - order).max()) for order in (truth.pixels, truth.pixels[::-1]))
    assert error < 0.3


@pytest.mark.parametrize("noise_px", [0.05, 0.3])
def test_deviations_are_those_of_repeated_calibrations(noise_px: float) -> None:
    found = [calibrate(views_of(CAMERA, 15, seed, noise_px)) for seed in range(24)]
    errors = np.array([item.intrinsics.fx - CAMERA.fx for item in found])
    told = np.array([item.deviations[0] for item in found])
    # The spread of 24 numbers is itself uncertain by 15 %; poses differ, too.
    assert 0.6 < np.sqrt(np.mean((errors / told) ** 2)) < 1.6


def test_terms_that_cannot_be_told_are_left_at_zero() -> None:
    pinhole = replace(CAMERA, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
    found = calibrate(views_of(pinhole, 15, noise_px=0.2))
    assert {"k3", "k2", "p1", "p2"} <= set(found.fixed)
    assert all(abs(term) < 0.02 for term in found.intrinsics.distortion)


def test_terms_that_matter_are_kept() -> None:
    wide = replace(CAMERA, fx=500.0, fy=500.0, distortion=(-0.3, 0.12, 0.003, -0.003, -0.02))
    found = calibrate(views_of(wide, 25, noise_px=0.05))
    assert not {"k1", "k2", "p1", "p2"} & set(found.fixed)
    np.testing.assert_allclose(found.intrinsics.distortion[2:4], (0.003, -0.003), atol=0.001)


def test_a_bad_view_is_dropped_and_named() -> None:
    views = views_of(CAMERA, 16)
    bent = views[5].pixels + np.random.default_rng(1).normal(0.0, 4.0, views[5].pixels.shape)
    views[5] = replace(views[5], pixels=bent)
    found = calibrate(views)
    assert [name for name, _ in found.dropped] == ["05"]
    assert found.intrinsics.fx == pytest.approx(CAMERA.fx, rel=0.005)


def test_too_few_views_are_refused() -> None:
    with pytest.raises(CalibrationRefusedError, match="9 good views are too few, 10"):
        calibrate(views_of(CAMERA, 9))


def test_views_of_one_side_are_refused_and_the_side_is_named() -> None:
    rng = np.random.default_rng(2)
    left = [
        seen(CAMERA, *placer(CAMERA).aimed((0.25, y), 0.75, (*rng.uniform(-30, 30, 2), 0.0)))
        for y in np.linspace(0.25, 0.75, 14)
    ]
    with pytest.raises(CalibrationRefusedError, match="at the picture's right"):
        calibrate(left)


def test_far_away_views_are_refused_for_their_coverage() -> None:
    rng = np.random.default_rng(3)
    corners = [(x, y) for x in (0.08, 0.92) for y in (0.1, 0.9)] * 3
    far = [
        seen(
            CAMERA,
            *placer(CAMERA).aimed(at, 3.0, (*rng.uniform(-35, 35, 2), 0.0)),
            noise_px=0.05,
            rng=rng,
        )
        for at in corners
    ]
    with pytest.raises(CalibrationRefusedError, match=r"cover .*nearer"):
        calibrate(far)


@pytest.mark.parametrize(("axis", "words"), [(0, "up and down"), (1, "left and right")])
def test_a_board_never_tilted_about_one_axis_is_refused(axis: int, words: str) -> None:
    rng = np.random.default_rng(4)
    views = []
    for x in (0.2, 0.5, 0.8):
        for y in (0.25, 0.5, 0.75):
            for turn in (-30.0, 30.0):
                turned = [rng.uniform(-4, 4), rng.uniform(-4, 4), 0.0]
                turned[1 - axis] = turn
                pose = placer(CAMERA).aimed((x, y), 0.5, (turned[0], turned[1], turned[2]))
                views.append(seen(CAMERA, *pose, noise_px=0.1, rng=rng))
    with pytest.raises(CalibrationRefusedError, match=f"tilt the board more.*{words}"):
        calibrate(views)


def test_pictures_of_two_sizes_are_refused_with_their_names() -> None:
    views = views_of(CAMERA, 12)
    views[7] = replace(views[7], width=1280)
    with pytest.raises(CalibrationRefusedError, match=r"960x720 \(00\), 1280x720 \(07\)"):
        calibrate(views)


def test_a_board_described_wrongly_is_refused() -> None:
    rng = np.random.default_rng(5)
    # Markers printed on squares that are not square: the print was stretched.
    views = [
        replace(view, pixels=view.pixels + rng.normal(0, 6.0, view.pixels.shape))
        for view in views_of(CAMERA, 14)
    ]
    with pytest.raises(CalibrationRefusedError, match=r"disagree by \d"):
        calibrate(views)


def test_wrong_boards_are_told_apart() -> None:
    camera = BoardCamera(CAMERA, CHARUCO)
    picture = camera.picture(*camera.aimed((0.5, 0.5), 0.45, (10.0, 10.0, 0.0)))
    cases = {
        "charuco:7x5:38:28:4x4_50": "another dictionary are seen: try :5x5_100",
        "charuco:4x4:38:28": "other columns or rows",
        "chessboard:9x6:25": "corners counted, not squares",
    }
    for text, words in cases.items():
        finder = BoardFinder(parse_board(text))
        assert words in finder.explain(picture)
    assert BoardFinder(CHESSBOARD).find(picture) is None
    empty = np.full((720, 960, 3), 128, np.uint8)
    assert BoardFinder(CHARUCO).find(empty) is None
    assert BoardFinder(CHARUCO).explain(empty) == "no markers are seen"


def test_half_a_charuco_board_is_a_view() -> None:
    camera = BoardCamera(CAMERA, CHARUCO)
    view = BoardFinder(CHARUCO).find(camera.picture(*camera.aimed((0.0, 0.5), 0.4)))
    assert view is not None
    assert 8 <= len(view.ids) < CHARUCO.corners


def test_a_blurred_view_is_less_sharp() -> None:
    camera = BoardCamera(CAMERA, CHARUCO)
    picture = camera.picture(*camera.aimed((0.5, 0.5), 0.5))
    finder = BoardFinder(CHARUCO)
    smeared = np.asarray(cv2.GaussianBlur(picture, (0, 0), 2.0), np.uint8)
    sharp, blurred = finder.find(picture), finder.find(smeared)
    assert sharp is not None
    assert blurred is not None
    assert blurred.sharpness < 0.6 * sharp.sharpness


def test_the_picker_wants_still_sharp_and_new_views() -> None:
    picker = ViewPicker()
    here = seen(CAMERA, *placer(CAMERA).aimed((0.4, 0.4), 0.5, (10.0, 5.0, 0.0)))
    there = seen(CAMERA, *placer(CAMERA).aimed((0.6, 0.6), 0.4, (-20.0, 25.0, 0.0)))
    assert picker.consider(here).hint == "hold_still"
    assert picker.consider(here).view is not None
    assert picker.consider(here).view is None, "the same view again"
    assert picker.consider(None).hint == "show_board"
    assert picker.consider(there).hint == "hold_still"
    blurred = replace(there, sharpness=0.1)
    assert picker.consider(blurred).hint == "blurred"
    assert picker.consider(there).view is not None
    assert [view.name for view in picker.views] == ["view 1", "view 2"]


def test_a_picker_goes_on_alone_with_the_views_of_another() -> None:
    picker = ViewPicker()
    here = seen(CAMERA, *placer(CAMERA).aimed((0.4, 0.4), 0.5, (10.0, 5.0, 0.0)))
    there = seen(CAMERA, *placer(CAMERA).aimed((0.6, 0.6), 0.4, (-20.0, 25.0, 0.0)))
    for _ in range(2):
        picker.consider(here)
    further = picker.continued()
    for _ in range(2):
        picker.consider(there)
        assert further.consider(here).view is None, "it has that one"
    assert (len(picker.views), len(further.views)) == (2, 1)
    for _ in range(2):
        further.consider(there)
    assert [view.name for view in further.views] == ["view 1", "view 2"]


@given(st.lists(st.tuples(st.floats(-0.5, 959.49), st.floats(-0.5, 719.49)), max_size=40))
def test_coverage_counts_every_corner_once(pixels: list[tuple[float, float]]) -> None:
    array = np.array(pixels, float).reshape(-1, 2)
    view = BoardView("", 960, 720, array, np.zeros((len(array), 3)), np.arange(len(array)), 0.5)
    assert coverage_of([view]).sum() == len(array)


@given(
    columns=st.integers(3, 12),
    rows=st.integers(3, 8),
    square=st.integers(20, 400).map(lambda n: n / 10),
)
def test_a_board_is_read_as_it_is_written(columns: int, rows: int, square: float) -> None:
    chessboard = Board("chessboard", columns, rows, square)
    charuco = Board("charuco", columns, rows, square, 0.75 * square, "5x5_100")
    assert parse_board(chessboard.name) == chessboard
    read = parse_board(charuco.name)
    assert (read.columns, read.rows, read.square_mm) == (columns, rows, square)
    assert len(charuco.corner_points()) == charuco.corners


@pytest.mark.parametrize(
    "text",
    [
        "",
        "charuco",
        "charuco:7x5:38",
        "charuco:7x5:28:38",
        "charuco:2x5:38:28",
        "charuco:7x5:38:28:9x9_10",
        "charuco:40x40:38:28",
        "charuco:7x5:nan:28",
        "chessboard:9:25",
        "chessboard:9x6:25:20",
        "chessboard:9x6:-5",
        "checkers:8x8:20",
    ],
)
def test_nonsense_boards_are_refused(text: str) -> None:
    with pytest.raises(BoardError):
        parse_board(text)


def test_config_refuses_impossible_limits() -> None:
    with pytest.raises(ValueError, match="coverage_least"):
        CalibrationConfig(coverage_least=1.5)
    with pytest.raises(ValueError, match="views_least"):
        CalibrationConfig(views_least=2)


def test_the_printed_sheet_has_the_board_in_its_size() -> None:
    sheet = draw_sheet(CHARUCO, 4.0)
    assert sheet.shape == sheet_size_px(CHARUCO, 4.0)[::-1]
    pattern = draw_board(CHARUCO, 4.0)
    assert pattern.shape == (5 * 38 * 4, 7 * 38 * 4)
    # Five millimetres of margin.
    np.testing.assert_array_equal(sheet[20:780, 20:1084], pattern)
    # A4 lying down.
    assert sheet.shape[1] <= 297 * 4
    assert sheet.shape[0] <= 210 * 4
