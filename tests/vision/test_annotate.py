"""The annotated picture is a JPEG of the asked size that shows region and box."""

import cv2
import numpy as np
import pytest

from server.stages import Box, Frame, Region
from server.vision.annotate import annotate

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


def test_a_malformed_colour_is_refused():
    with pytest.raises(ValueError, match="#rrggbb"):
        annotate(FRAME, None, None, "North", "red")
