import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from server.replay.flight import tick_times


@given(st.lists(st.integers(1, 5), min_size=1, max_size=30))
def test_moments_between_told_poses_are_found_again(steps):
    dt_s = 1.0 / 15.0
    told = np.concatenate([[0.0], np.cumsum(steps)]) * dt_s
    ticks = tick_times(told.tolist(), dt_s)
    np.testing.assert_allclose(ticks, np.arange(sum(steps) + 1) * dt_s, atol=1e-9)


def test_without_told_poses_nothing_is_known():
    assert tick_times([], 0.1) == []
