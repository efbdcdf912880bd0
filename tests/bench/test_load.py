"""The load bench: its library is one that a console reads, its figures are those of its parts."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.bench.hovering_fleet import hold_figures, percentiles
from server.bench.load import fill_library, measure
from server.mission.control import _records_on_disk


def test_a_console_reads_the_library(tmp_path: Path) -> None:
    fill_library(tmp_path, 3)
    records = _records_on_disk(tmp_path)
    names = {record.request.name for record in records.values()}
    assert names == {"capture 0", "capture 1", "capture 2"}
    assert {record.status.state for record in records.values()} == {"succeeded"}
    assert all(record.metrics is not None for record in records.values())


def test_presses_that_never_arrive_are_counted() -> None:
    figures = hold_figures([4.0, float("inf"), 6.0])
    assert (figures["presses"], figures["never_arrived"]) == (3, 1)
    assert (figures["p50"], figures["max"]) == (5.0, 6.0)
    assert percentiles([])["p99"] is None


@pytest.mark.loopback
@pytest.mark.slow
def test_a_few_seconds_with_a_few_viewers() -> None:
    figures = measure(viewers=3, captures=5, seconds=6.0)
    assert figures["viewers_lost"] == 0
    assert figures["tiles_per_s_min"] > 0.0
    assert figures["hold_ms"]["never_arrived"] == 0
    assert figures["hold_ms"]["presses"] >= 2
    assert figures["list_ms"]["p95"] > 0.0
    assert min(figures["memory_mb"] + figures["descriptors"]) > 0
