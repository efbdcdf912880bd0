"""Bounds really bound, and the tighter ones are tighter."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest

from server.planner.annealing import greedy, search_arrays
from server.planner.bound import (
    fitness_bound,
    linear_value,
    proven_optimum,
    submodular_bound,
    upper_bound,
    views_enough,
)
from server.planner.config import AnnealingConfig, FitnessConfig
from server.planner.errors import PlanError
from server.planner.fitness import FitnessProblem, evaluate, problem_from_table
from server.planner.placement import choose, place
from server.planner.visibility import VisibilityTable


@pytest.fixture(scope="module")
def few(dog_problem: FitnessProblem) -> FitnessProblem:
    """Every choice of three of these can be tried."""
    return _restricted(dog_problem, np.arange(0, len(dog_problem.candidates), 70))


def _restricted(problem: FitnessProblem, rows: np.ndarray) -> FitnessProblem:
    table = problem.table
    return problem_from_table(
        [problem.candidates[i] for i in rows],
        problem.samples,
        VisibilityTable(table.visible[rows], table.detail_px_per_m2[rows], table.agreement[rows]),
        FitnessConfig(samples=300),
    )


def test_bounds_hold_for_every_choice(few: FitnessProblem) -> None:
    choices = [np.array(c) for c in combinations(range(len(few.candidates)), 3)]
    linear = max(linear_value(few, c, 3) for c in choices)
    whole = max(evaluate(few, c, 3)[0] for c in choices)
    programmed = upper_bound(few, 3)
    proven = proven_optimum(few, 3, seconds=20.0)
    start = greedy(search_arrays(few, 3), 3).astype(np.intp)
    modular = submodular_bound(few, start, 3)
    assert proven.linear == pytest.approx(linear, abs=1e-4)
    assert linear <= proven.linear + 1e-6
    assert proven.linear <= programmed.linear + 1e-6
    assert linear <= modular.linear + 1e-9
    for bound in (programmed, proven, modular):
        assert whole <= bound.fitness + 1e-6


def test_the_submodular_bound_is_below_the_sum_of_single_views(dog_problem: FitnessProblem) -> None:
    chosen = greedy(search_arrays(dog_problem, 8), 8).astype(np.intp)
    none = submodular_bound(dog_problem, chosen[:0], 8)
    all_steps = submodular_bound(dog_problem, chosen, 8)
    assert all_steps.linear < none.linear
    assert linear_value(dog_problem, chosen, 8) <= all_steps.linear


def test_where_the_program_is_too_large_the_bound_is_the_submodular_one_and_named_so(
    few: FitnessProblem,
) -> None:
    chosen = greedy(search_arrays(few, 3), 3).astype(np.intp)
    programmed, modular = upper_bound(few, 3).fitness, submodular_bound(few, chosen, 3).fitness
    entries = int(np.count_nonzero(few.quality))
    assert fitness_bound(few, chosen, 3, entries) == (programmed, "linear program")
    assert fitness_bound(few, chosen, 3, entries - 1) == (modular, "submodular")
    assert fitness_bound(few, chosen, 3)[1] == "linear program"


def test_more_views_than_candidates_is_said(few: FitnessProblem) -> None:
    with pytest.raises(PlanError, match="candidates"):
        upper_bound(few, len(few.candidates) + 1)
    with pytest.raises(PlanError, match="candidates are feasible"):
        place(few, len(few.candidates) + 1, AnnealingConfig(), np.random.default_rng(0))


def test_how_many_views_are_enough(dog_problem: FitnessProblem) -> None:
    answer = views_enough(dog_problem, share=0.9, most=24)
    assert answer.needed is not None
    assert answer.sufficient is not None
    assert 1 <= answer.needed <= answer.sufficient <= 24
    seen = answer.reached[answer.sufficient - 1]
    assert seen >= 0.9
    assert answer.sufficient == 1 or answer.reached[answer.sufficient - 2] < 0.9
    # Nobody reaches the whole surface with one view of a body.
    assert views_enough(dog_problem, share=1.0, most=1).sufficient is None


def test_progress_shows_the_best_choice(few: FitnessProblem) -> None:
    reports = []
    config = AnnealingConfig(swaps=400, report_every=100)
    chosen, _ = choose(few, 3, config, np.random.default_rng(0), reports.append)
    iterations = [r.iteration for r in reports]
    assert iterations == sorted(set(iterations))
    assert iterations[-1] == 400
    # The best so far never gets worse, also not where an annealing starts anew.
    assert all(a.fitness <= b.fitness for a, b in pairwise(reports))
    last = {tuple(view.position_world) for view in reports[-1].best}
    assert last == {tuple(few.candidates[i].position_world) for i in chosen}
