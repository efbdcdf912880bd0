"""One drone as the pilot knows it: the wind it flies in, and whether it is low by mistake."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.mission.config import FlightConfig, MissionConfig
from server.mission.wing import Wing, share_flown
from server.planner.config import PlannerConfig
from server.stages import Telemetry, Viewpoint
from server.swarm.config import DroneConfig, SafetyConfig
from server.vision.config import VisionConfig

FASTEST_M_S = 0.5

speeds = st.floats(-0.5, 0.5)
winds = st.tuples(st.floats(0.0, 0.45), st.floats(-np.pi, np.pi))


@given(st.tuples(speeds, speeds, speeds), winds)
def test_the_drone_goes_where_it_wants_or_slower_but_never_elsewhere(
    wish: tuple[float, float, float], wind: tuple[float, float]
) -> None:
    velocity = np.array(wish)
    blows = wind[0] * np.array([np.cos(wind[1]), np.sin(wind[1]), 0.0])
    share = share_flown(velocity, blows, FASTEST_M_S)
    assert 0.0 <= share <= 1.0
    assert np.linalg.norm(share * velocity - blows) <= FASTEST_M_S + 1e-9
    # It is no slower than it must be.
    if share < 1.0 - 1e-9:
        faster = min(1.0, share + 1e-3) * velocity - blows
        assert np.linalg.norm(faster) > FASTEST_M_S - 1e-3 * np.linalg.norm(velocity)


def test_wind_that_takes_nearly_all_speed_leaves_none_towards_the_fence() -> None:
    """The wish along the fence was scaled together with what held the drone off it."""
    along, outwards = np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.45, 0.0])
    flown = share_flown(along, outwards, FASTEST_M_S) * along
    assert flown[1] == 0.0
    assert 0.2 < flown[0] < 0.5


def in_wind(wind: tuple[float, float, float]) -> Wing:
    drone: Any = HeardDrone(True)
    eye: Any = SimpleNamespace(sight=None)
    flight = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
    wing = Wing(drone, eye, Viewpoint(np.array([2.0, 0.0, 1.0]), 0.0), flight, 0)
    wing.wind = np.array(wind)
    return wing


def test_a_wind_that_may_be_none_is_left_to_the_limits() -> None:
    """It once made a drone whose link died drift on to the object, by limits it had kept to."""
    weak = in_wind((0.03, -0.04, 0.0))
    assert np.array_equal(weak.doubtful_wind, weak.wind)
    sent = np.array([0.1, 0.2, 0.0])
    assert weak.against_wind(sent) == pytest.approx(sent)
    between = in_wind((0.0, 0.07, 0.0))
    assert between.doubtful_wind == pytest.approx([0.0, 0.03, 0.0])
    assert between.against_wind(np.zeros(3)) == pytest.approx([0.0, -0.04, 0.0])
    strong = in_wind((0.0, 0.3, 0.0))
    assert not strong.doubtful_wind.any()
    assert strong.against_wind(np.zeros(3)) == pytest.approx([0.0, -0.3, 0.0])


class HeardDrone(SimpleNamespace):
    """As much of a drone as its wing asks for; it says that it flies forwards."""

    def __init__(self, hears: bool, activity: str = "flying") -> None:
        super().__init__(
            config=DroneConfig(), hears=hears, activity=activity, airborne=True, telemetry=None
        )

    def reports(self, at_s: float, height_m: float = 0.8, climb_m_s: float = 0.0) -> None:
        velocity = np.array([0.5, 0.0, climb_m_s])
        self.telemetry = Telemetry(
            "d", at_s, 0, 0, 0, velocity, np.zeros(3), height_m, height_m + 0.1, 0, 90, 60, at_s
        )


def flown(drone: HeardDrone, seconds: float, height_m: float = 0.8) -> Wing:
    """Let a wing watch its drone fly forwards although it is told to hover."""
    config = FlightConfig(MissionConfig(), PlannerConfig(), VisionConfig(), SafetyConfig())
    anything: Any = drone
    blind: Any = SimpleNamespace(sight=None)
    wing = Wing(anything, blind, Viewpoint(np.array([2.0, 0.0, 0.0]), np.pi), config, 0)
    nobody: Any = None
    for k in range(1, int(10.0 * seconds)):
        climbed_m = min(0.04 * k, height_m)
        drone.reports(0.1 * k, climbed_m, 0.4 if climbed_m < height_m else 0.0)
        wing.observe(nobody, None)
        wing.feel_wind(0.1 * k, 0.1)
    return wing


def test_what_a_drone_does_beyond_its_orders_is_wind_unless_it_does_not_hear_them() -> None:
    assert np.hypot(*flown(HeardDrone(hears=True), 5.0).wind[:2]) == pytest.approx(0.45, abs=0.03)
    assert np.hypot(*flown(HeardDrone(hears=False), 5.0).wind[:2]) == 0.0


def test_wind_is_forgotten_while_it_cannot_be_known() -> None:
    drone = HeardDrone(hears=True)
    wing = flown(drone, 5.0)
    drone.hears = False
    for k in range(50, 130):
        drone.reports(0.1 * k)
        wing.feel_wind(0.1 * k, 0.1)
    assert np.hypot(*wing.wind[:2]) < 0.1


@pytest.mark.parametrize(
    ("activity", "rises_to_m", "minds"),
    [
        ("flying", 0.8, True),
        ("holding", 0.8, True),
        ("landing", 0.8, False),
        ("flying", 0.1, False),
    ],
)
def test_the_floor_counts_for_who_has_risen_and_is_not_landing(
    activity: str, rises_to_m: float, minds: bool
) -> None:
    assert flown(HeardDrone(hears=True, activity=activity), 3.0, rises_to_m).minds_floor is minds
