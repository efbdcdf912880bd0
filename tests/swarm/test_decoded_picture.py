"""What is converted late and in part is what an early, whole conversion gives."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from server.stages import Frame
from server.swarm.decoded_picture import DecodedPicture, PictureConverter

WIDTH, HEIGHT = 960, 720


def smooth_image() -> NDArray[np.uint8]:
    """Colours that change slowly enough for half-sized colour planes."""
    noise = np.random.default_rng(3).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 12.0)
    stretched = cv2.normalize(blurred, np.empty_like(blurred), 10.0, 245.0, cv2.NORM_MINMAX)
    return stretched.astype(np.uint8)


def decoded(image_bgr: NDArray[np.uint8], form: str = "yuv420p") -> av.VideoFrame:
    return av.VideoFrame.from_ndarray(image_bgr, format="bgr24").reformat(format=form)


@pytest.fixture
def picture() -> DecodedPicture:
    made = PictureConverter().picture(decoded(smooth_image()))
    assert isinstance(made, DecodedPicture)
    return made


def test_the_whole_picture_is_that_which_was_sent(picture: DecodedPicture) -> None:
    assert picture.size_px == (WIDTH, HEIGHT)
    error = picture.bgr().astype(float) - smooth_image()
    assert np.sqrt((error**2).mean()) < 3.0
    assert picture.bgr() is picture.bgr(), "converted once"


@pytest.mark.parametrize(
    ("size", "off"),
    # What is shown has coarser colours; what is searched is right to a level.
    [((640, 480), 1.5), ((480, 360), 0.3), ((240, 180), 0.3), ((120, 90), 0.3)],
)
def test_a_reduced_picture_is_the_mean_over_areas(
    picture: DecodedPicture, size: tuple[int, int], off: float
) -> None:
    frame = Frame("d", 0, 0.0, picture, False)
    reduced = frame.reduced_bgr(*size)
    expected = cv2.resize(picture.bgr(), size, interpolation=cv2.INTER_AREA)
    assert reduced.shape == expected.shape
    assert reduced.dtype == np.uint8
    error = reduced.astype(float) - expected
    assert abs(error.mean()) < 0.2
    assert np.abs(error).mean() < off


def test_a_frame_of_an_array_reduces_likewise(picture: DecodedPicture) -> None:
    late = Frame("d", 0, 0.0, picture, False)
    early = Frame("d", 0, 0.0, picture.bgr(), False)
    assert late.size_px == early.size_px == (WIDTH, HEIGHT)
    assert np.array_equal(late.image_bgr, early.image_bgr)
    difference = late.reduced_bgr(240, 180).astype(float) - early.reduced_bgr(240, 180)
    assert np.abs(difference).max() <= 2


def test_several_threads_may_convert_the_pictures_of_one_stream() -> None:
    converter = PictureConverter()
    shades = [np.full((HEIGHT, WIDTH, 3), shade, np.uint8) for shade in range(20, 220, 20)]
    pictures = [converter.picture(decoded(shade)) for shade in shades]
    sizes = [(640, 480), (240, 180), (320, 240), (160, 120), (480, 360), (80, 60)]

    def reduced(number: int) -> float:
        picture = pictures[number % len(pictures)]
        assert isinstance(picture, DecodedPicture)
        return float(picture.reduced_bgr(*sizes[number % len(sizes)]).mean())

    with ThreadPoolExecutor(4) as pool:
        means = list(pool.map(reduced, range(120)))
    for number, mean in enumerate(means):
        assert mean == pytest.approx(20 + 20 * (number % len(pictures)), abs=3)


@pytest.mark.parametrize(
    ("form", "size"),
    [
        ("yuv444p", (960, 720)),
        ("gray", (960, 720)),
        ("yuv420p10le", (960, 720)),
        ("yuv420p", (321, 242)),
        ("yuv420p", (322, 241)),
    ],
)
def test_what_is_no_cameras_form_is_converted_at_once(form: str, size: tuple[int, int]) -> None:
    """Its conversion may fail, and then it must fail where the decoder's errors are caught."""
    made = PictureConverter().picture(av.VideoFrame(*size, form))
    assert isinstance(made, np.ndarray)
    assert made.shape == (size[1], size[0], 3)
