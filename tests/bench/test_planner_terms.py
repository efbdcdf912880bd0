"""What each term of the fitness is worth, as the planner bench tells it."""

from __future__ import annotations

import pytest

from server.bench.planner_plans import MEASURES
from server.bench.planner_terms import TERMS, without_terms


@pytest.mark.slow
def test_every_term_is_left_out_once() -> None:
    found = without_terms("recycle_bin", 0, (4,), 300)
    assert list(found) == ["k4"]
    assert list(found["k4"]) == ["nothing", *TERMS]
    assert {"agreement", "visibility", "baseline", "overlap"} <= set(TERMS)
    for shares in found["k4"].values():
        assert list(shares) == list(MEASURES)
        assert all(0.2 < share < 3.0 for share in shares.values())
    # Another fitness is another plan, for some of them at least.
    assert len({tuple(shares.values()) for shares in found["k4"].values()}) > 2
