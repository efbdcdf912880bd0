"""What is sent so that a drone flies its wish in wind, and no faster than allowed."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.mission.wing import share_flown

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
