"""Where previews are wanted from: what was asked for last counts, and nonsense changes nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.jobs.spec import VIEW
from server.jobs.wanted_view import WantedView, want_view
from server.nerf.orbit_view import OrbitView

AHEAD, ABOVE = OrbitView(0.0, 0.2, 1.0), OrbitView(1.0, 1.5, 0.5)


def test_the_last_wish_counts_and_is_news_once(tmp_path: Path) -> None:
    wanted = WantedView(tmp_path)
    assert not wanted.changed()
    want_view(tmp_path, AHEAD)
    want_view(tmp_path, ABOVE)
    assert wanted.changed()
    assert wanted.view == ABOVE
    assert not wanted.changed()
    want_view(tmp_path, ABOVE)
    assert not wanted.changed(), "the same again is no news"
    want_view(tmp_path, None)
    assert wanted.changed()
    assert wanted.view is None


@pytest.mark.parametrize(
    "nonsense",
    ["", "{", "7", '{"azimuth_rad": 1}', '{"azimuth_rad": 0, "elevation_rad": 2, "distance": 1}'],
)
def test_nonsense_changes_nothing(tmp_path: Path, nonsense: str) -> None:
    wanted = WantedView(tmp_path)
    want_view(tmp_path, AHEAD)
    assert wanted.changed()
    (tmp_path / VIEW).write_text(nonsense)
    assert not wanted.changed()
    assert wanted.view == AHEAD


@pytest.mark.parametrize(
    "place", [(float("nan"), 0.0, 1.0), (0.0, 1.6, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, float("inf"))]
)
def test_there_are_places_nothing_is_seen_from(place: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        OrbitView(*place)
