"""Landing places keep clear of one another, of what stands there, of the object and the fence."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.mission.landing import CLEARANCE_M, landing_places
from server.planner.config import FlightSpace

SPACE = FlightSpace()
OBJECT = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 1.0]))


def at(x: float, y: float) -> np.ndarray:
    return np.array([x, y, 1.0])


def test_drones_apart_land_where_they_are() -> None:
    flying = {"a": at(2.0, 0.0), "b": at(-2.0, 0.0)}
    places = landing_places(flying, [at(0.0, 2.0)], OBJECT, SPACE)
    np.testing.assert_allclose(places["a"], [2.0, 0.0])
    np.testing.assert_allclose(places["b"], [-2.0, 0.0])


def test_nobody_lands_on_a_drone_that_stands_there() -> None:
    places = landing_places({"a": at(2.0, 0.1)}, [at(2.0, 0.0)], OBJECT, SPACE)
    assert np.linalg.norm(places["a"] - [2.0, 0.0]) >= CLEARANCE_M
    assert np.linalg.norm(places["a"] - [2.0, 0.1]) <= 1.2


def test_nobody_lands_near_a_drone_that_was_lost() -> None:
    places = landing_places({"a": at(2.0, 0.1)}, [], OBJECT, SPACE, lost=[at(2.0, 0.0)])
    assert np.linalg.norm(places["a"] - [2.0, 0.0]) >= 2 * CLEARANCE_M


rings = st.tuples(st.floats(1.5, 3.5), st.floats(0.0, 6.28)).map(
    lambda polar: at(polar[0] * np.cos(polar[1]), polar[0] * np.sin(polar[1]))
)


@given(st.lists(rings, min_size=1, max_size=4), st.lists(rings, max_size=4))
def test_places_are_clear(flying: list[np.ndarray], standing: list[np.ndarray]) -> None:
    drones = {str(number): position for number, position in enumerate(flying)}
    places = landing_places(drones, standing, OBJECT, SPACE)
    assert set(places) == set(drones)
    for name, place in places.items():
        others = [other for n, other in places.items() if n != name]
        others += [position[:2] for position in standing]
        assert all(np.linalg.norm(place - other) >= CLEARANCE_M - 1e-9 for other in others)
        assert np.linalg.norm(place) <= SPACE.fence_radius_m + 1e-9


def test_without_any_clear_place_a_drone_stays() -> None:
    crowd = [at(x, y) for x in np.arange(-4, 4.1, 0.8) for y in np.arange(-4, 4.1, 0.8)]
    places = landing_places({"a": at(1.0, 1.0)}, crowd, None, SPACE)
    np.testing.assert_allclose(places["a"], [1.0, 1.0])
