"""Volumes that no drone may enter bind candidates, ways and the ring."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planner_objects import box, pose_at, seed_of

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.assignment import assign
from server.planner.candidates import generate_candidates
from server.planner.config import FlightSpace, PlannerConfig
from server.planner.errors import PlanError
from server.planner.no_go import intrusion, space_about
from server.planner.ring import facing, standard_ring

# A curtain on the object's east side, as wide and high as drones may fly.
CURTAIN = (0.9, -0.5, 0.0, 4.0, 0.5, 2.5)
OBJECT = seed_of(box(-0.2, -0.2, 0.0, 0.2, 0.2, 0.6))


def config_with(*volumes: tuple[float, float, float, float, float, float]) -> PlannerConfig:
    return PlannerConfig(space=FlightSpace(no_go=volumes, no_go_clearance_m=0.3))


def test_candidates_keep_clear_and_the_rest_stays() -> None:
    free = generate_candidates(OBJECT, TELLO_INTRINSICS, TELLO_TILT_RAD, PlannerConfig())
    bound = generate_candidates(OBJECT, TELLO_INTRINSICS, TELLO_TILT_RAD, config_with(CURTAIN))
    curtain = box(*CURTAIN)
    assert any(curtain.distance(view.position_world) < 0.3 for view in free)
    assert all(curtain.distance(view.position_world) >= 0.3 - 1e-9 for view in bound)
    assert len(bound) > 300


@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_intrusion_agrees_with_the_distance_to_the_box(point: list[float]) -> None:
    space = FlightSpace(no_go=(CURTAIN,), no_go_clearance_m=0.3)
    place = np.array(point)
    missing = 0.3 - box(*CURTAIN).distance(place)
    found = float(intrusion(place, space))
    assert (found > 1e-12) == (missing > 1e-12)
    if 0.0 < missing < 0.3:
        assert found == pytest.approx(missing)


def test_nothing_is_forbidden_by_default() -> None:
    assert intrusion(np.zeros((2, 5, 3)), FlightSpace()).shape == (2, 5)
    assert not intrusion(np.zeros((2, 5, 3)), FlightSpace()).any()


def test_volumes_move_with_the_frame() -> None:
    space = FlightSpace(no_go=(CURTAIN,))
    centre = np.array([0.5, -1.0, 0.3])
    places = np.array([[1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]])
    moved = places - np.array([0.5, -1.0, 0.0])
    np.testing.assert_allclose(
        intrusion(places, space), intrusion(moved, space_about(centre, space))
    )


def test_nobody_flies_through_it() -> None:
    space = config_with(CURTAIN).space
    centre = OBJECT.outer.centre
    # Six places all round except east; the short way from one end to the other is barred.
    azimuths = np.deg2rad([50.0, 100.0, 150.0, 210.0, 260.0, 310.0])
    views = [facing(centre, float(a), 1.4, 1.0) for a in azimuths]
    start = {"d0": pose_at("d0", *facing(centre, np.deg2rad(40.0), 1.4, 1.0).position_world)}
    flown = assign(views, start, centre, space)
    places = [view.position_world for row in flown.rounds for view in row.values()]
    order_deg = [float(np.rad2deg(np.arctan2(p[1], p[0])) % 360.0) for p in places]
    assert sorted(order_deg) == pytest.approx(np.rad2deg(azimuths))
    # Each way is one step on the free side: none is the short cut across the east.
    assert np.abs(np.diff(order_deg)).max() < 90.0


def test_what_cannot_be_is_said() -> None:
    everywhere = config_with((-5.0, -5.0, 0.0, 5.0, 5.0, 3.0))
    with pytest.raises(PlanError, match="no-go"):
        generate_candidates(OBJECT, TELLO_INTRINSICS, TELLO_TILT_RAD, everywhere)
    with pytest.raises(PlanError, match="no-go"):
        standard_ring(
            OBJECT.outer, 4, 6, TELLO_INTRINSICS, TELLO_TILT_RAD, config_with(CURTAIN), [0, 1, 2, 3]
        )
    large = seed_of(box(-5.0, -0.2, 0.0, 5.0, 0.2, 0.6))
    with pytest.raises(PlanError, match="larger than the fence"):
        generate_candidates(large, TELLO_INTRINSICS, TELLO_TILT_RAD, PlannerConfig())


@pytest.mark.parametrize("bad", [(0, 0, 0, 1, 1), (1, 0, 0, 0, 1, 1), (0, 0, 0, 1, 1, np.inf)])
def test_a_bad_volume_is_refused_by_name(bad: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="no_go"):
        dataclasses.replace(FlightSpace(), no_go=(bad,))
