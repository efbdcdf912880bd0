"""Corners keep their numbers and their places as long as they are seen."""

from __future__ import annotations

import cv2
import numpy as np

from server.stages import Frame
from server.vision.config import FeatureConfig
from server.vision.features import FeatureTracker

CONFIG = FeatureConfig()
WIDTH, HEIGHT = 960, 720


def wallpaper(seed: int) -> np.ndarray:
    """Return a picture larger than the camera's, with corners everywhere."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 256, (30, 40, 3), dtype=np.uint8)
    return cv2.resize(coarse, (1200, 900), interpolation=cv2.INTER_CUBIC)


def picture(wall: np.ndarray, right: int, down: int, at_s: float) -> Frame:
    image = np.ascontiguousarray(wall[down : down + HEIGHT, right : right + WIDTH])
    return Frame("d", round(30 * at_s), at_s, image, damaged=False)


def test_corners_are_found_again_where_they_have_moved_to() -> None:
    tracker, wall = FeatureTracker(CONFIG), wallpaper(1)
    first = tracker.update(picture(wall, 40, 40, 0.0))
    assert first is not None
    assert CONFIG.fewest <= len(first.numbers) <= CONFIG.most
    last = first
    for k in range(1, 6):
        last = tracker.update(picture(wall, 40 + 6 * k, 40 - 4 * k, 0.1 * k))
    assert last is not None
    _, before, after = np.intersect1d(first.numbers, last.numbers, return_indices=True)
    assert len(before) > 0.7 * len(first.numbers)
    moved = last.px[after] - first.px[before]
    np.testing.assert_allclose(np.median(moved, axis=0), [-30.0, 20.0], atol=0.5)
    assert (np.abs(moved - [-30.0, 20.0]).max(axis=1) < 2.0).mean() > 0.9


def test_a_picture_that_comes_too_soon_tells_nothing_new() -> None:
    tracker, wall = FeatureTracker(CONFIG), wallpaper(2)
    first = tracker.update(picture(wall, 40, 40, 0.0))
    assert tracker.update(picture(wall, 60, 40, CONFIG.every_s / 2)) is first
    assert tracker.update(picture(wall, 60, 40, CONFIG.every_s * 1.01)) is not first


def test_numbers_are_never_used_again() -> None:
    tracker = FeatureTracker(CONFIG)
    seen: set[int] = set()
    newest = -1
    for k in range(4):  # A new room each time: hardly a corner can be followed.
        features = tracker.update(picture(wallpaper(10 + k), 40, 40, float(k)))
        assert features is not None
        new = set(features.numbers.tolist()) - seen
        assert min(new) > newest
        seen |= new
        newest = max(seen)


def test_a_picture_of_nothing_has_no_corners() -> None:
    tracker = FeatureTracker(CONFIG)
    plain = Frame("d", 0, 0.0, np.full((HEIGHT, WIDTH, 3), 128, np.uint8), damaged=False)
    features = tracker.update(plain)
    assert features is not None
    assert features.px.shape == (0, 2)
