"""Annealing: equal to the definition, better than greedy, repeatable, below its bound."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from server.bench.planner_plans import objective
from server.geometry.boxes import Box3
from server.planner.annealing import (
    baseline_sum,
    gains,
    greedy,
    rank_columns,
    search_arrays,
    swap_change,
)
from server.planner.bound import linear_value, upper_bound
from server.planner.config import AnnealingConfig
from server.planner.errors import PlanError
from server.planner.fitness import FitnessProblem, evaluate, problem_from_table
from server.planner.placement import ChoiceRule, PlanProgress, choose, place
from server.planner.policies import choose_farthest
from server.planner.surfaces import sample_surface
from server.planner.visibility import VisibilityTable
from server.stages import Viewpoint

QUICK = AnnealingConfig(swaps=4000, report_every=500)


def part_of(problem: FitnessProblem, rows: np.ndarray, taken: int = 0) -> FitnessProblem:
    table = problem.table
    return problem_from_table(
        [problem.candidates[i] for i in rows],
        problem.samples,
        VisibilityTable(table.visible[rows], table.detail_px_per_m2[rows], table.agreement[rows]),
        problem.config,
        taken=taken,
    )


@pytest.mark.slow
def test_one_more_view_adds_what_the_definition_says(dog_problem: FitnessProblem) -> None:
    rng = np.random.default_rng(5)
    for views in (1, 4, 12):
        chosen = rng.choice(len(dog_problem.candidates), views, replace=False).astype(np.int64)
        found = gains(search_arrays(dog_problem, views + 1), chosen)
        assert set(np.flatnonzero(np.isnan(found))) == set(chosen)
        before = evaluate(dog_problem, chosen, views + 1)[0]
        for into in rng.choice(np.setdiff1d(np.arange(len(found)), chosen), 20):
            after = evaluate(dog_problem, np.append(chosen, into), views + 1)[0]
            assert found[into] == pytest.approx(after - before, abs=2e-6)


@pytest.mark.slow
def test_a_swap_changes_the_fitness_by_what_the_loop_says(dog_problem: FitnessProblem) -> None:
    rng = np.random.default_rng(3)
    for views in (1, 4, 24):
        arrays = search_arrays(dog_problem, views)
        for _ in range(20):
            drawn = rng.choice(len(dog_problem.candidates), views + 1, replace=False)
            chosen, into, slot = drawn[:views].astype(np.int64), int(drawn[views]), 0
            slot = int(rng.integers(views))
            columns = arrays.gain.shape[1]
            top, second = np.empty(columns), np.empty(columns)
            owner = np.empty(columns, np.int64)
            rank_columns(arrays, chosen, top, second, owner)
            seen = arrays.quality[chosen].sum(axis=0, dtype=float)
            change = swap_change(arrays, chosen, slot, into, seen, top, second, owner)
            after = chosen.copy()
            after[slot] = into
            expected = (
                evaluate(dog_problem, after, views)[0] - evaluate(dog_problem, chosen, views)[0]
            )
            assert change == pytest.approx(expected, abs=2e-6)


@pytest.mark.slow
def test_annealing_beats_greedy_and_greedy_beats_chance(dog_problem: FitnessProblem) -> None:
    views = 12
    start = evaluate(dog_problem, greedy(search_arrays(dog_problem, views), views), views)[0]
    chosen, stopped = choose(dog_problem, views, AnnealingConfig(), np.random.default_rng(0))
    assert not stopped
    rng = np.random.default_rng(5)
    chance = [
        evaluate(dog_problem, rng.choice(len(dog_problem.candidates), views, False), views)[0]
        for _ in range(20)
    ]
    assert evaluate(dog_problem, chosen, views)[0] > start > max(chance)


@pytest.mark.slow
def test_annealing_finds_the_best_of_a_small_problem(dog_problem: FitnessProblem) -> None:
    rows = np.random.default_rng(7).choice(len(dog_problem.candidates), 24, replace=False)
    small = part_of(dog_problem, rows)
    best = max(evaluate(small, np.array(c), 3)[0] for c in combinations(range(24), 3))
    chosen, _ = choose(small, 3, QUICK, np.random.default_rng(0))
    assert evaluate(small, chosen, 3)[0] == pytest.approx(best, abs=1e-6)
    bound = upper_bound(small, 3)
    assert best <= bound.fitness + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("views", [4, 24])
def test_no_choice_exceeds_the_bound(dog_problem: FitnessProblem, views: int) -> None:
    placement = place(dog_problem, views, QUICK, np.random.default_rng(0))
    bound = upper_bound(dog_problem, views)
    assert placement.bound == pytest.approx(bound.fitness)
    assert placement.bound_kind == "linear program"
    assert placement.fitness < bound.fitness
    rng = np.random.default_rng(1)
    for _ in range(20):
        chosen = rng.choice(len(dog_problem.candidates), views, replace=False)
        assert linear_value(dog_problem, chosen, views) <= bound.linear + 1e-9
    chosen = greedy(search_arrays(dog_problem, views), views).astype(np.intp)
    assert linear_value(dog_problem, chosen, views) <= bound.linear + 1e-9


@pytest.mark.slow
def test_a_seed_repeats_and_no_candidate_is_taken_twice(dog_problem: FitnessProblem) -> None:
    first, second, other = (
        choose(dog_problem, 24, QUICK, np.random.default_rng(seed))[0] for seed in (1, 1, 2)
    )
    assert first.tolist() == second.tolist()
    assert sorted(first) != sorted(other)
    assert len(set(first.tolist())) == 24


@pytest.mark.slow
def test_progress_is_reported_and_cancelling_keeps_the_best(dog_problem: FitnessProblem) -> None:
    reports: list[PlanProgress] = []
    chosen, stopped = choose(
        dog_problem,
        6,
        QUICK,
        np.random.default_rng(0),
        on_progress=reports.append,
        cancelled=lambda: len(reports) >= 3,
    )
    assert stopped
    assert [r.iteration for r in reports] == [500, 1000, 1500]
    assert reports[0].temperature > reports[-1].temperature > 0
    assert reports[-1].fitness >= reports[0].fitness
    assert evaluate(dog_problem, chosen, 6)[0] == pytest.approx(reports[-1].fitness, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("rule", [choose, choose_farthest])
def test_pictures_taken_are_part_of_every_choice(
    dog_problem: FitnessProblem, rule: ChoiceRule
) -> None:
    count = len(dog_problem.candidates)
    half = np.flatnonzero([view.position_world[0] > 0.0 for view in dog_problem.candidates])
    done = np.random.default_rng(2).choice(half, 6, replace=False)
    problem = part_of(dog_problem, np.concatenate([np.arange(count), done]), taken=6)
    chosen, _ = rule(problem, 10, QUICK, np.random.default_rng(0), None, None)
    assert sorted(chosen[:6]) == list(range(count, count + 6))
    # Six pictures of the front have been taken: the back is worth more.
    new = [problem.candidates[i] for i in chosen[6:]]
    assert np.mean([view.position_world[0] for view in new]) < 0.0
    blind, _ = rule(
        part_of(dog_problem, np.arange(count)), 4, QUICK, np.random.default_rng(0), None, None
    )
    together = evaluate(problem, np.concatenate([chosen[:6], blind]), 10)[0]
    assert evaluate(problem, chosen, 10)[0] > together


@pytest.mark.slow
def test_a_placement_tells_what_one_more_picture_would_add(dog_problem: FitnessProblem) -> None:
    count = len(dog_problem.candidates)
    done = np.array([0, 40, 80])
    problem = part_of(dog_problem, np.concatenate([np.arange(count), done]), taken=3)
    placement = place(problem, 7, QUICK, np.random.default_rng(0))
    assert len(placement.viewpoints) == 4
    assert placement.candidates == count
    assert len(placement.spare) == len(placement.spare_gains) == count - 4
    assert placement.bound is not None
    assert placement.fitness <= placement.bound
    # Where a picture was taken, one more is worth little.
    again = [placement.spare.index(v) for v in problem.candidates[-3:] if v in placement.spare]
    assert placement.spare_gains[again].max() < 0.5 * placement.spare_gains.max()


def test_neighbours_are_counted_without_oneself(dog_problem: FitnessProblem) -> None:
    arrays = search_arrays(dog_problem, 1)
    assert baseline_sum(arrays, np.array([5]), 0, 5) == 0.0


def test_too_few_candidates_are_an_error(dog_problem: FitnessProblem) -> None:
    small = part_of(dog_problem, np.arange(3))
    with pytest.raises(PlanError, match="3 candidates"):
        choose(small, 4, QUICK, np.random.default_rng(0))
    with pytest.raises(ValueError, match="at least one"):
        choose(small, 0, QUICK, np.random.default_rng(0))


def test_all_candidates_chosen_leave_nothing_to_swap(dog_problem: FitnessProblem) -> None:
    chosen, _ = choose(part_of(dog_problem, np.arange(3)), 3, QUICK, np.random.default_rng(0))
    assert sorted(chosen.tolist()) == [0, 1, 2]


def test_a_ring_that_no_choice_one_by_one_comes_upon_is_where_the_search_begins() -> None:
    samples = sample_surface([Box3(np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 1.0]))], 400)
    azimuths = np.arctan2(samples.points[:, 1], samples.points[:, 0]) + np.pi / 4
    quarter = (azimuths % (2.0 * np.pi)) // (np.pi / 2.0)
    ring = [quarter == number for number in range(4)]
    # It sees more than any of the ring, and makes two of them worth half.
    half = np.arange(len(samples)) % 2 == 0
    trap = (ring[0] & half) | (ring[1] & half) | (samples.points[:, 2] > 0.99)
    visible = np.stack([*ring, trap])
    places = [(2.0, 0.0), (0.0, 2.0), (-2.0, 0.0), (0.0, -2.0), (1.6, 1.6)]
    problem = problem_from_table(
        [Viewpoint(np.array([x, y, 0.5]), float(np.arctan2(-y, -x))) for x, y in places],
        samples,
        VisibilityTable(visible, visible * 1e4, visible.astype(float)),
        objective("visibility"),
    )
    assert 4 in greedy(search_arrays(problem, 4), 4)
    still = AnnealingConfig(swaps=0, restarts=0)
    chosen, _ = choose(problem, 4, still, np.random.default_rng(0))
    assert set(chosen) == {0, 1, 2, 3}
