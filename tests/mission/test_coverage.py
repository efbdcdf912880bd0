"""How much of the object the pictures show: what lies before them, and nothing behind."""

import numpy as np
import pytest

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.mission.coverage import surface_seen
from server.mission.events import SurfaceSeen
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
