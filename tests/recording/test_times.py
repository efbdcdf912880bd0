from hypothesis import given
from hypothesis import strategies as st

from server.recording.times import TimeBase, timestamp


@given(st.floats(0.0, 1e7), st.floats(-100.0, 1e5))
def test_times_advance_as_the_monotonic_clock_does(begun_s, later_s):
    base = TimeBase(1_700_000_000_000_000_000, begun_s)
    passed_ns = base.ns(begun_s + later_s) - base.wall_ns
    assert abs(passed_ns - later_s * 1e9) <= 10  # Doubles near 1e7 s are no finer.


@given(st.integers(0, 2**62))
def test_timestamps_keep_every_nanosecond(ns):
    at = timestamp(ns)
    assert at.seconds * 10**9 + at.nanos == ns
    assert 0 <= at.nanos < 10**9
