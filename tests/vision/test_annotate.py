"""The annotated picture is a JPEG of the asked size that shows region and box."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from server.stages import Box, Frame, Region
from server.vision.annotate import annotate, outlines_px

FRAME = Frame("d", 0, 0.0, np.full((720, 960, 3), 128, np.uint8), False)


def decoded(jpeg: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.astype(int)


def test_region_and_box_are_drawn_in_the_drones_colour():
    mask = np.zeros((180, 240), bool)
    mask[60:120, 80:160] = True
    region = Region(np.array([480.0, 360.0]), 80.0, 10.0, mask, 4.0, 0.9)
    box = Box(np.array([319.5, 239.5, 639.5, 479.5]), 0.9, False)
    image = decoded(annotate(FRAME, region, box, "North", "#ff0000", quality=95))
    assert image.shape == (480, 640, 3)
    red = (image[..., 2] > 180) & (image[..., 1] < 90) & (image[..., 0] < 90)
    on_left_edge = red[170:310, 210:217].any(axis=1)
    assert on_left_edge.mean() > 0.9
    assert not red[200:230, 240:280].any()


def test_a_picture_without_the_object_says_so():
    plain = decoded(annotate(FRAME, None, None, "North", "#ff0000"))
    assert plain[30:60, 0:200].min() < 60  # The plate of "object not seen".


def plates(image: np.ndarray) -> np.ndarray:
    """Where labels stand: their dark ground on the plain grey picture."""
    return np.asarray((image < 60).all(axis=2))


def test_how_far_to_turn_is_told_with_its_side():
    region = Region(np.array([480.0, 360.0]), 80.0, 10.0, np.zeros((180, 240), bool), 4.0, 0.9)
    box = Box(np.array([319.5, 239.5, 639.5, 479.5]), 0.9, False)
    texts = {turn: annotate(FRAME, region, box, "N", "#ff0000", yaw_error_rad=turn) for turn in (
        None, 0.0, 0.2, -0.2)}  # fmt: skip
    assert len(set(texts.values())) == 4
    widths = {
        turn: plates(decoded(jpeg))[135:160].any(axis=0).sum() for turn, jpeg in texts.items()
    }
    assert widths[None] < widths[0.0] < min(widths[0.2], widths[-0.2])


def test_the_name_is_never_written_over():
    corner = Box(np.array([-0.5, -0.5, 300.0, 400.0]), 0.9, True)
    with_box = decoded(annotate(FRAME, None, corner, "North", "#ff0000", quality=95))
    without = decoded(annotate(FRAME, None, None, "North", "#ff0000", quality=95))
    name = (slice(10, 26), slice(12, 55))
    assert np.abs(with_box[name] - without[name]).max() < 40


def test_a_note_is_shown_as_damage_is():
    plain = plates(decoded(annotate(FRAME, None, None, "N", "#ff0000")))
    noted = plates(decoded(annotate(FRAME, None, None, "N", "#ff0000", note="look here")))
    damaged = Frame("d", 0, 0.0, FRAME.image_bgr, True)
    broken = plates(decoded(annotate(damaged, None, None, "N", "#ff0000")))
    assert not plain[60:76].any()
    assert noted[60:76].any()
    assert broken[60:76].any()


def test_drawing_leaves_the_frame_as_it_is():
    annotate(FRAME, None, None, "N", "#ff0000", size=(960, 720))
    assert (FRAME.image_bgr == 128).all()


def test_a_malformed_colour_is_refused():
    with pytest.raises(ValueError, match="#rrggbb"):
        annotate(FRAME, None, None, "North", "red")


def test_outlines_are_told_in_pixels_of_the_picture_and_kept_short() -> None:
    mask = np.zeros((180, 240), bool)
    mask[60:120, 80:160] = True
    (outline,) = outlines_px(Region(np.array([480.0, 360.0]), 80.0, 10.0, mask, 4.0, 0.9))
    assert sorted(map(tuple, outline.tolist())) == [(322, 242), (322, 478), (638, 242), (638, 478)]
    rng = np.random.default_rng(1)
    ragged = Region(np.array([480.0, 360.0]), 80.0, 10.0, rng.random((180, 240)) > 0.5, 4.0, 0.9)
    coarse = outlines_px(ragged, most_points=50)
    assert sum(len(outline) for outline in coarse) <= 50
    assert outlines_px(replace(ragged, mask=np.zeros((180, 240), bool))) == ()
