"""How much of the object the pictures show: what lies before them, and nothing behind."""

import asyncio

import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.mission import coverage
from server.mission.coverage import CoverageNews, surface_seen
from server.mission.events import EventStream, SurfaceSeen
from server.planner.config import FitnessConfig
from server.stages import SeedGeometry, Viewpoint

BOX = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 0.8]))
SEED = SeedGeometry(BOX, (BOX,), views=4)


def picture(azimuth_rad: float) -> Viewpoint:
    """Return a picture of the box from two metres away that shows all of it."""
    place = np.array([2.0 * np.cos(azimuth_rad), 2.0 * np.sin(azimuth_rad), 0.8])
    return Viewpoint(place, azimuth_rad + np.pi)


def seen_from(*azimuths_rad: float) -> SurfaceSeen:
    return surface_seen(
        SEED,
        [picture(azimuth) for azimuth in azimuths_rad],
        TELLO_INTRINSICS,
        TELLO_TILT_RAD,
        FitnessConfig(),
    )


def test_a_picture_shows_the_side_it_was_taken_from() -> None:
    seen = seen_from(0.0)
    east = np.isclose(seen.points[:, 0], 0.3)
    west = np.isclose(seen.points[:, 0], -0.3)
    assert (seen.pictures[east] == 1).mean() > 0.9
    assert (seen.pictures[west] == 0).all()
    assert 0.1 < seen.coverage.once < 0.4
    assert seen.coverage.thrice == 0.0


def test_more_pictures_show_more_and_some_of_it_thrice() -> None:
    four = seen_from(*np.arange(4) * np.pi / 2.0)
    twelve = seen_from(*np.arange(12) * np.pi / 6.0)
    assert twelve.coverage.once >= four.coverage.once > 0.7
    assert twelve.coverage.thrice > 0.7 > four.coverage.thrice


def test_what_faces_the_floor_is_left_out() -> None:
    seen = seen_from(0.0)
    assert seen.points[:, 2].min() > 0.0


def test_the_shares_are_of_the_area() -> None:
    seen = seen_from(0.0, 0.01, 0.02)
    assert seen.coverage.once == pytest.approx((seen.pictures >= 1).mean(), abs=0.03)
    assert seen.coverage.thrice == pytest.approx((seen.pictures >= 3).mean(), abs=0.03)


async def test_what_fails_ends_nothing_and_the_newest_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    events = EventStream()
    news = CoverageNews(events, FitnessConfig())
    ring = [picture(azimuth) for azimuth in np.arange(4) * np.pi / 2.0]
    with events.subscribe() as subscription, monkeypatch.context() as broken:
        broken.setattr(coverage, "visibility_table", lambda *_: 1 / 0)
        news.tell(SEED, ring, TELLO_INTRINSICS, TELLO_TILT_RAD)
        while "could not be worked out" not in caplog.text:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        broken.undo()
        news.tell(SEED, ring[:1], TELLO_INTRINSICS, TELLO_TILT_RAD)
        news.tell(SEED, ring, TELLO_INTRINSICS, TELLO_TILT_RAD)
        event = await asyncio.wait_for(anext(subscription), 10.0)
        assert isinstance(event, SurfaceSeen)
        assert event.coverage.once > 0.7
