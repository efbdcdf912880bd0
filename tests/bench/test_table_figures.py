"""The table's means, deviations, and paired intervals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from server.bench.table.fields import FIGURES
from server.bench.table.figures import difference, mode_figures, paired, pooled


def sample(psnr: list[float | None], **plain: float) -> dict[str, Any]:
    numbers = {"images": 24, "images_used": 24, "surface_seen": 0.8, "flight_s": 100, "wall_s": 60}
    numbers["settled_deg"] = 0.5
    return {"per_view": dict.fromkeys(FIGURES, psnr)} | numbers | plain


def test_the_interval_over_flights_is_that_of_the_paired_t_test() -> None:
    rng = np.random.default_rng(3)
    better, worse = rng.normal(22.0, 2.0, (6, 40)), rng.normal(20.0, 2.0, (6, 40))
    told = difference(better.tolist(), worse.tolist())
    test = stats.ttest_rel(better.mean(axis=1), worse.mean(axis=1))
    interval = test.confidence_interval(0.95)
    assert told["diff"] == pytest.approx((better - worse).mean(), abs=1e-4)
    assert told["ci"] == pytest.approx([interval.low, interval.high], abs=1e-4)
    assert (told["pairs"], told["over"]) == (6, "flights")


def test_the_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(400):
        # Three flights, whose own errors are larger than those between test views.
        flights = rng.normal(1.0, 0.8, (3, 1)) + rng.normal(0.0, 0.3, (3, 10))
        low, high = difference(flights.tolist(), np.zeros((3, 10)).tolist())["ci"]
        held += low <= 1.0 <= high
    assert 0.91 <= held / 400 <= 0.99


def test_a_single_pair_is_judged_over_its_test_views_and_says_so() -> None:
    told = difference([[3.0, 4.0, 8.0]], [[1.0, 1.0, 1.0]])
    assert told["diff"] == pytest.approx(4.0)
    assert told["over"] == "views"
    half = stats.t.ppf(0.975, 2) * np.std([2.0, 3.0, 7.0], ddof=1) / np.sqrt(3.0)
    assert told["ci"] == pytest.approx([4.0 - half, 4.0 + half], abs=1e-4)


def test_views_without_the_object_count_nowhere() -> None:
    told = difference([[3.0, None, 5.0]], [[1.0, None, 1.0]])
    assert told["diff"] == pytest.approx(3.0)
    assert mode_figures([sample([3.0, None, 5.0])])["psnr_db_object"] == pytest.approx(4.0)


def test_means_and_deviations_are_over_flights_not_over_views() -> None:
    figures = mode_figures([sample([10.0, 30.0]), sample([22.0, 22.0], flight_s=200)])
    assert figures["psnr_db"] == pytest.approx(21.0)
    assert figures["psnr_db_sd"] == pytest.approx(np.std([20.0, 22.0], ddof=1), abs=1e-4)
    assert figures["flight_s"] == pytest.approx(150.0)
    assert mode_figures([sample([10.0, 30.0])])["psnr_db_sd"] is None


def test_only_flights_of_one_seed_are_paired() -> None:
    runs = [
        {"optimized": sample([25.0]), "standard_refined": sample([20.0])},
        {"optimized": sample([99.0])},  # Its standard flight failed.
        {"optimized": sample([23.0]), "standard_refined": sample([20.0])},
    ]
    told = paired(runs)
    assert set(told) == {"standard_refined"}
    assert told["standard_refined"]["psnr_db"]["diff"] == pytest.approx(4.0)
    assert told["standard_refined"]["psnr_db"]["pairs"] == 2


def test_scenes_of_a_seed_weigh_alike() -> None:
    both = pooled([sample([10.0, 12.0], wall_s=10), sample([20.0, 22.0], wall_s=30)])
    figures = mode_figures([both])
    assert figures["psnr_db"] == pytest.approx(16.0)
    assert figures["wall_s"] == pytest.approx(20.0)
