"""Landing places keep clear of one another, of what stands there, of the object and the fence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.boxes import Box3
from server.mission.landing import CLEARANCE_M, Down, Landing, landing_places
from server.planner.config import FlightSpace

SPACE = FlightSpace()
OBJECT = Box3(np.array([-0.3, -0.3, 0.0]), np.array([0.3, 0.3, 1.0]))


def at(x: float, y: float) -> np.ndarray:
    return np.array([x, y, 1.0])


def stands(x: float, y: float) -> Down:
    return Down(at(x, y), 0.2)


def test_drones_apart_land_where_they_are() -> None:
    flying = {"a": Landing(at(2.0, 0.0)), "b": Landing(at(-2.0, 0.0))}
    places = landing_places(flying, [stands(0.0, 2.0)], OBJECT, SPACE)
    np.testing.assert_allclose(places["a"], [2.0, 0.0])
    np.testing.assert_allclose(places["b"], [-2.0, 0.0])


def test_nobody_lands_on_a_drone_that_stands_there() -> None:
    places = landing_places({"a": Landing(at(2.0, 0.1))}, [stands(2.0, 0.0)], OBJECT, SPACE)
    assert np.linalg.norm(places["a"] - [2.0, 0.0]) >= CLEARANCE_M
    assert np.linalg.norm(places["a"] - [2.0, 0.1]) <= 1.2


def test_the_less_is_known_of_a_place_the_farther_from_it_others_land() -> None:
    unsure = Down(at(2.0, 0.0), 0.7)
    places = landing_places({"a": Landing(at(2.0, 0.1))}, [unsure], OBJECT, SPACE)
    assert np.linalg.norm(places["a"] - [2.0, 0.0]) >= CLEARANCE_M + 0.9 - 1e-9
    assert Down(at(2.0, 0.0), 50.0).apart_m < SPACE.fence_radius_m


rings = st.tuples(st.floats(1.5, 3.5), st.floats(0.0, 6.28)).map(
    lambda polar: at(polar[0] * np.cos(polar[1]), polar[0] * np.sin(polar[1]))
)


@given(st.lists(rings, min_size=1, max_size=4), st.lists(rings, max_size=4))
def test_places_are_clear(flying: list[np.ndarray], standing: list[np.ndarray]) -> None:
    drones = {str(number): Landing(position) for number, position in enumerate(flying)}
    places = landing_places(drones, [Down(p, 0.2) for p in standing], OBJECT, SPACE)
    assert set(places) == set(drones)
    for name, place in places.items():
        others = [other for n, other in places.items() if n != name]
        others += [position[:2] for position in standing]
        assert all(np.linalg.norm(place - other) >= CLEARANCE_M - 1e-9 for other in others)
        assert np.linalg.norm(place) <= SPACE.fence_radius_m + 1e-9


def test_where_nothing_near_is_clear_a_drone_goes_farther() -> None:
    # All near places are taken by the time the last one looks.
    flying = {str(n): Landing(at(x, 0.0)) for n, x in enumerate((2.0, 2.0, 2.0, 3.5))}
    places = landing_places(flying, [Down(at(2.5, 0.0), 0.2)], OBJECT, SPACE)
    points = [*places.values(), np.array([2.5, 0.0])]
    apart_m = [np.linalg.norm(a - b) for k, a in enumerate(points) for b in points[:k]]
    assert min(apart_m) >= CLEARANCE_M - 1e-9


def test_without_any_clear_place_a_drone_takes_the_one_with_most_room() -> None:
    crowd = [stands(x, y) for x in np.arange(-4, 4.1, 0.8) for y in np.arange(-4, 4.1, 0.8)]
    places = landing_places({"a": Landing(at(0.8, 0.8))}, crowd, None, SPACE)
    nearest = min(np.linalg.norm(places["a"] - other.position[:2]) for other in crowd)
    assert nearest > 0.4
    assert np.linalg.norm(places["a"]) <= SPACE.fence_radius_m


def test_a_drone_that_the_wind_drives_begins_to_land_upwind() -> None:
    blown = Landing(at(3.8, 0.0), np.array([0.9, 0.0]))
    place = landing_places({"a": blown}, [], OBJECT, SPACE)["a"]
    assert np.linalg.norm(place + blown.drift_m) <= SPACE.fence_radius_m + 1e-9
    sheltered = Landing(at(2.0, 0.0), np.array([0.0, 0.5]))
    np.testing.assert_allclose(landing_places({"a": sheltered}, [], OBJECT, SPACE)["a"], [2.0, 0.0])


def test_nobody_lands_beside_a_no_go_volume() -> None:
    desk = (1.5, -0.5, 0.0, 2.5, 0.5, 3.0)
    space = replace(SPACE, no_go=(desk,))
    place = landing_places({"a": Landing(at(2.0, 0.0))}, [], OBJECT, space)["a"]
    beside = np.maximum(0.0, np.maximum([1.5, -0.5] - place, place - [2.5, 0.5]))
    assert np.linalg.norm(beside) >= space.no_go_clearance_m
    assert np.linalg.norm(place) <= space.fence_radius_m
