"""Compiled loops of greedy start and simulated annealing.

Each proposal is judged by what it changes, O(S + G + K^2), never by evaluating the whole choice;
``server.planner.fitness`` is the definition and the tests hold the two together.

Symbols: the arrays of ``SearchArrays``, in which all weights are already multiplied in; ``slot``
is a position within the chosen set, ``out`` and ``into`` are candidates.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from server.planner.fitness import FitnessProblem, baseline_worth, total_weight, view_worth

Array = NDArray[np.float64]


class SearchArrays(NamedTuple):
    """A fitness problem for K views as the compiled loops want it.

    Attributes:
        quality: float32 ``(D, S)`` how much of a view of the sample each candidate is.
        cover_weight: ``(S,)`` weight of each sample's coverage.
        worth: ``(K + 2,)`` g(n), the worth of n views of a sample; linear in between.
        gain: float32 ``(D, M)`` columns of which the best view counts (detail, then spread).
        gain_weight: ``(M,)``.
        single: ``(D,)`` what a view adds by itself.
        overlap: float32 ``(D, D)`` penalty of each pair.
        baseline: float32 ``(D, D)`` worth of each as the other's neighbour.
        baseline_weight: Weight of each view's best neighbour.
        neighbours: int64 ``(D, N)``.
        taken: How many candidates, the last ones, are part of every choice.
    """

    quality: NDArray[np.float32]
    cover_weight: Array
    worth: Array
    gain: NDArray[np.float32]
    gain_weight: Array
    single: Array
    overlap: NDArray[np.float32]
    baseline: NDArray[np.float32]
    baseline_weight: float
    neighbours: NDArray[np.int64]
    taken: int


def search_arrays(problem: FitnessProblem, views: int) -> SearchArrays:
    """Multiply the weights in; the sum over all parts is then the fitness itself."""
    config, scale = problem.config, 1.0 / total_weight(problem.config)
    directions = problem.spread.shape[1]
    baseline = np.empty_like(problem.angles_rad)
    for rows, angles in zip(baseline, problem.angles_rad, strict=True):
        rows[:] = baseline_worth(angles, config, views)
    np.fill_diagonal(baseline, 0.0)
    return SearchArrays(
        quality=problem.quality.astype(np.float32),
        cover_weight=scale
        * (
            config.weight_visibility * problem.area_share
            + config.weight_priority * problem.priority_share
        ),
        # One more entry, so that interpolation at exactly K views stays inside.
        worth=np.append(view_worth(config, views), 1.0),
        gain=np.concatenate([problem.detail, problem.spread], axis=1).astype(np.float32),
        gain_weight=scale
        * np.concatenate(
            [
                config.weight_detail * problem.area_share,
                np.full(directions, config.weight_spread / directions),
            ]
        ),
        single=scale * config.weight_agreement / views * problem.agreement,
        overlap=np.float32(scale * config.weight_overlap / views) * problem.overlap_pairs,
        baseline=baseline,
        baseline_weight=scale * config.weight_baseline / views,
        neighbours=problem.neighbours,
        taken=problem.taken,
    )


@numba.njit(cache=True)
def worth_at(worth: Array, views: float) -> float:
    """Return g at ``views``, which may lie between whole numbers."""
    # Sums and differences of qualities may end a rounding error below zero or above K.
    whole = min(max(int(views), 0), len(worth) - 2)
    part = min(max(views - whole, 0.0), 1.0)
    return worth[whole] + part * (worth[whole + 1] - worth[whole])


@numba.njit(cache=True)
def greedy(a: SearchArrays, views: int) -> NDArray[np.int64]:
    """Return ``views`` candidates: those taken already, then each the one that adds most.

    Every candidate is tried in every step: overlap and baseline make the fitness neither monotone
    nor submodular, so that lazy evaluation could skip the right one, and a full pass is cheap.
    """
    count, samples = a.quality.shape
    columns = a.gain.shape[1]
    chosen = np.empty(views, np.int64)
    taken = np.zeros(count, np.bool_)
    seen = np.zeros(samples)
    top = np.zeros(columns)
    nearest = np.zeros(views)
    for step in range(views):
        best, best_value = count - a.taken + step, -np.inf
        for into in range(count):
            if taken[into] or step < a.taken:
                continue
            value = a.single[into]
            for s in range(samples):
                if a.quality[into, s] > 0.0:
                    after = worth_at(a.worth, seen[s] + a.quality[into, s])
                    value += a.cover_weight[s] * (after - worth_at(a.worth, seen[s]))
            for m in range(columns):
                if a.gain[into, m] > top[m]:
                    value += a.gain_weight[m] * (a.gain[into, m] - top[m])
            own = 0.0
            for t in range(step):
                other = chosen[t]
                value -= a.overlap[into, other]
                pair = a.baseline[into, other]
                own = max(own, pair)
                value += a.baseline_weight * max(0.0, pair - nearest[t])
            value += a.baseline_weight * own
            if value > best_value:
                best, best_value = into, value
        chosen[step] = best
        taken[best] = True
        for s in range(samples):
            seen[s] += a.quality[best, s]
        for m in range(columns):
            top[m] = max(top[m], a.gain[best, m])
        for t in range(step):
            pair = a.baseline[best, chosen[t]]
            nearest[t] = max(nearest[t], pair)
            nearest[step] = max(nearest[step], pair)
    return chosen


def gains(a: SearchArrays, chosen: NDArray[np.int64]) -> Array:
    """Return for each candidate ``(D,)`` what it would add to ``chosen``; NaN for those in it.

    Not compiled: it is asked for once in a plan, and a first flight waits for every compilation.
    """
    counts = range(len(a.worth))
    seen, top = a.quality[chosen].sum(axis=0, dtype=float), a.gain[chosen].max(axis=0)
    covered = a.cover_weight @ np.interp(seen, counts, a.worth)
    after = [a.cover_weight @ np.interp(seen + row, counts, a.worth) for row in a.quality]
    pairs = a.baseline[:, chosen].astype(float)
    nearest = pairs[chosen].max(axis=1)
    value = a.single + np.array(after) - covered
    value += np.maximum(a.gain - top, 0.0) @ a.gain_weight - a.overlap[:, chosen].sum(axis=1)
    value += a.baseline_weight * (np.maximum(pairs - nearest, 0.0).sum(axis=1) + pairs.max(axis=1))
    value[chosen] = np.nan
    return value


@numba.njit(cache=True)
def rank_columns(
    a: SearchArrays, chosen: NDArray[np.int64], top: Array, second: Array, owner: NDArray[np.int64]
) -> None:
    """Fill best and second-best gain ``(M,)`` per column and the slot that owns the best."""
    for m in range(len(top)):
        top[m], second[m], owner[m] = 0.0, 0.0, -1
        for slot in range(len(chosen)):
            value = a.gain[chosen[slot], m]
            if value > top[m]:
                second[m], top[m], owner[m] = top[m], value, slot
            elif value > second[m]:
                second[m] = value


@numba.njit(cache=True)
def baseline_sum(a: SearchArrays, chosen: NDArray[np.int64], slot: int, into: int) -> float:
    """Return the sum of best neighbours when ``slot`` holds ``into``."""
    total = 0.0
    for i in range(len(chosen)):
        one = into if i == slot else chosen[i]
        best = 0.0
        for j in range(len(chosen)):
            other = into if j == slot else chosen[j]
            if a.baseline[one, other] > best and i != j:
                best = a.baseline[one, other]
        total += best
    return total


@numba.njit(cache=True)
def swap_change(
    a: SearchArrays,
    chosen: NDArray[np.int64],
    slot: int,
    into: int,
    seen: Array,
    top: Array,
    second: Array,
    owner: NDArray[np.int64],
) -> float:
    """Return by how much the fitness changes when ``into`` takes the place in ``slot``."""
    out = chosen[slot]
    change = a.single[into] - a.single[out]
    for s in range(len(seen)):
        difference = a.quality[into, s] - a.quality[out, s]
        if difference != 0.0:
            after = worth_at(a.worth, seen[s] + difference)
            change += a.cover_weight[s] * (after - worth_at(a.worth, seen[s]))
    for m in range(len(top)):
        rest = second[m] if owner[m] == slot else top[m]
        change += a.gain_weight[m] * (max(rest, a.gain[into, m]) - top[m])
    for t in range(len(chosen)):
        if t != slot:
            change += a.overlap[out, chosen[t]] - a.overlap[into, chosen[t]]
    before = baseline_sum(a, chosen, slot, out)
    return change + a.baseline_weight * (baseline_sum(a, chosen, slot, into) - before)


@numba.njit(cache=True)
def anneal(
    a: SearchArrays,
    chosen: NDArray[np.int64],
    best: NDArray[np.int64],
    values: Array,
    temperature: float,
    cooling: float,
    slots: NDArray[np.int64],
    targets: NDArray[np.int64],
    chances: Array,
) -> float:
    """Try one batch of moves; ``chosen``, ``best`` and ``values`` are updated in place.

    Args:
        a: The problem.
        chosen: Current choice ``(K,)``.
        best: Best choice so far ``(K,)``.
        values: Fitness of the two ``(2,)``.
        temperature: Temperature of the first move.
        cooling: Factor on the temperature after each move.
        slots: Slot of each move ``(n,)``; the slots of pictures taken already do not move.
        targets: Per move ``(n,)``: a candidate to swap in, or minus one minus the number of the
            neighbour to adjust to.
        chances: Uniform numbers ``(n,)`` in [0, 1).

    Returns:
        The temperature after the batch.
    """
    count, samples = a.quality.shape
    columns = a.gain.shape[1]
    taken = np.zeros(count, np.bool_)
    seen = np.zeros(samples)
    for candidate in chosen:
        taken[candidate] = True
        for s in range(samples):
            seen[s] += a.quality[candidate, s]
    top, second = np.empty(columns), np.empty(columns)
    owner = np.empty(columns, np.int64)
    rank_columns(a, chosen, top, second, owner)
    for move in range(len(slots)):
        slot = slots[move]
        out = chosen[slot]
        into = int(targets[move])
        if into < 0:
            into = int(a.neighbours[out, -1 - into])
        if not taken[into]:
            change = swap_change(a, chosen, slot, into, seen, top, second, owner)
            if change >= 0.0 or chances[move] < np.exp(change / temperature):
                chosen[slot] = into
                taken[out], taken[into] = False, True
                for s in range(samples):
                    seen[s] += a.quality[into, s] - a.quality[out, s]
                rank_columns(a, chosen, top, second, owner)
                values[0] += change
                if values[0] > values[1]:
                    values[1] = values[0]
                    best[:] = chosen
        temperature *= cooling
    return temperature
