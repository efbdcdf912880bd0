"""Drones take turns with their full searches."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from server.stages import Frame
from server.vision import region
from server.vision.config import RegionConfig
from server.vision.region import RegionTracker

FPS = 30.0


def picture() -> NDArray[np.uint8]:
    """A red disc with a texture that can be followed, on a dull ground."""
    rng = np.random.default_rng(0)
    image = rng.integers(90, 130, (720, 960, 3), np.uint8)
    patches = rng.integers(0, 120, (30, 40), np.uint8).repeat(24, 0).repeat(24, 1)
    disc = np.hypot(*np.ogrid[-400:320, -480:480]) < 130
    image[disc] = np.stack([patches, patches, np.full_like(patches, 220)], axis=2)[disc]
    return image


@pytest.mark.slow
def test_full_searches_of_four_drones_never_fall_together(monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[tuple[int, float]] = []
    at: list[tuple[int, float]] = []
    real = region.search

    def noted(*arguments: object) -> object:
        searched.append(at[-1])
        return real(*arguments)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(region, "search", noted)
    trackers = [RegionTracker(RegionConfig(), turn) for turn in (0.0, 0.25, 0.5, 0.75)]
    image, key_s, seconds = picture(), RegionConfig().key_s, 5
    for number in range(round(seconds * FPS)):
        now_s = 1000.3 + number / FPS
        for drone, tracker in enumerate(trackers):
            at.append((drone, now_s))
            assert tracker.update(Frame("d", number, now_s, image, False), None) is not None
    steady = [(d, at_s) for d, at_s in searched if at_s > 1000.3 + 1.6 * key_s]
    times = sorted(at_s for _, at_s in steady)
    assert np.diff(times).min() > 0.2 * key_s
    for each in range(4):
        own = [at_s for d, at_s in steady if d == each]
        assert len(own) >= 2
        assert np.diff(own) == pytest.approx(key_s, abs=1.5 / FPS)
