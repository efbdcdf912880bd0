"""What the config says about itself: meanings from its docstrings, bounds from its validation."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.api.settings_view import bounds, meanings_of, settings_from_config
from server.settings import load_settings


@dataclass(frozen=True)
class Inner:
    """Inside.

    Attributes:
        share: Of everything,
            on two lines.
    """

    share: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise ValueError("share")


@dataclass(frozen=True)
class Outer:
    """Outside.

    Attributes:
        count: How many.
        low_m: Lower end.
        high_m: Upper end.
        name: A word.
        inner: Another config.

    Raises:
        ValueError: not a field.
    """

    count: int = 3
    low_m: float = -1.0
    high_m: float = 2.0
    name: str = ""
    inner: Inner = field(default_factory=lambda: Inner(0.25))

    def __post_init__(self) -> None:
        if not 1 <= self.count <= 8:
            raise ValueError("count")
        if not -5.5 <= self.low_m < self.high_m:
            raise ValueError("low_m")


def test_nested_settings_have_names_variables_and_meanings() -> None:
    views = {view.name: view for view in settings_from_config({"outer": Outer()})}
    assert list(views) == ["count", "low_m", "high_m", "name", "inner.share"]
    share = views["inner.share"]
    assert share.variable == "DRONERF_OUTER__INNER__SHARE"
    assert share.meaning == "Of everything, on two lines."
    assert (share.value, share.default) == (0.25, 0.25)
    assert (share.least, share.more_than, share.most) == (None, 0.0, 1.0)
    assert (views["name"].least, views["name"].most) == (None, None)


def test_a_changed_setting_shows_its_default() -> None:
    changed = replace(Outer(), inner=Inner(0.75), count=4)
    views = {view.name: view for view in settings_from_config({"outer": changed})}
    assert (views["count"].value, views["count"].default) == (4, 3)
    assert (views["inner.share"].value, views["inner.share"].default) == (0.75, 0.25)


def test_only_fields_have_meanings() -> None:
    assert set(meanings_of(Outer)) == {"count", "low_m", "high_m", "name", "inner"}


def test_bounds_are_those_of_the_validation() -> None:
    assert bounds(Outer(), "count") == (1.0, 8.0)
    assert bounds(Outer(), "low_m")[0] == pytest.approx(-5.5)
    assert bounds(Outer(), "low_m")[1] == pytest.approx(2.0)
    assert bounds(Outer(), "high_m") == (pytest.approx(-1.0), None)


@given(value=st.floats(0.01, 1.0), low=st.floats(-5.0, -0.1))
def test_bounds_do_not_depend_on_where_one_stands(value: float, low: float) -> None:
    least, most = bounds(Inner(value), "share")
    assert most == pytest.approx(1.0)
    assert least is not None
    assert 0.0 < least < 1e-6
    assert bounds(Outer(low_m=low), "low_m")[0] == pytest.approx(-5.5)


def test_every_real_setting_means_something_and_can_be_set(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in os.environ if name.startswith("DRONERF_")]:
        monkeypatch.delenv(name)
    flight = load_settings().flight()
    groups = {name: getattr(flight, name) for name in ("mission", "planner", "vision", "safety")}
    views = settings_from_config(groups)
    assert [view.variable for view in views if not view.meaning] == []
    for view in views:
        if not isinstance(view.value, int | float) or isinstance(view.value, bool):
            continue
        for edge, sign in ((view.least, -1), (view.most, 1)):
            # Within its bounds, and as long as no bound is known beyond them.
            assert edge is None or sign * view.value <= sign * edge + 1e-9, view.variable
