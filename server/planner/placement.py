"""Choosing O, the K best viewpoints of P: greedily or by a ring, then simulated annealing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from server.planner.annealing import SearchArrays, anneal, gains, greedy, search_arrays
from server.planner.bound import fitness_bound
from server.planner.config import AnnealingConfig
from server.planner.errors import PlanError
from server.planner.fitness import FitnessProblem, evaluate
from server.stages import Placement, Viewpoint

# A restart is a look elsewhere; most moves belong to the first start.
_RESTART_SHARE = 0.2


@dataclass(frozen=True, slots=True)
class PlanProgress:
    """How far the annealing is.

    Attributes:
        iteration: Moves tried.
        iterations: Moves in all.
        temperature: Present temperature, in units of the fitness.
        fitness: Best fitness so far.
        best: Best choice so far, viewpoints.
    """

    iteration: int
    iterations: int
    temperature: float
    fitness: float
    best: tuple[Viewpoint, ...] = ()


ProgressReport = Callable[[PlanProgress], None]
CancelCheck = Callable[[], bool]
ChoiceRule = Callable[
    [
        FitnessProblem,
        int,
        AnnealingConfig,
        np.random.Generator,
        ProgressReport | None,
        CancelCheck | None,
    ],
    tuple[NDArray[np.intp], bool],
]


def place(
    problem: FitnessProblem,
    k: int,
    config: AnnealingConfig,
    rng: np.random.Generator,
    on_progress: ProgressReport | None = None,
    cancelled: CancelCheck | None = None,
    rule: ChoiceRule | None = None,
) -> Placement:
    """Choose ``k`` different candidates of ``problem`` by ``rule``, None: by ``choose``.

    Pictures that are taken already are among the ``k`` and are not placed again. The same problem,
    ``k``, configuration and state of ``rng`` give the same placement. When ``cancelled`` returns
    True the best choice so far is returned, without an upper bound.

    Raises:
        ValueError: If no viewpoint is left to place.
        PlanError: If there are too few candidates.
    """
    chosen, stopped = (rule or choose)(problem, k, config, rng, on_progress, cancelled)
    fitness, terms = evaluate(problem, chosen, k)
    more = gains(search_arrays(problem, k + 1), chosen.astype(np.int64))
    spare = np.flatnonzero(~np.isnan(more))
    placement = Placement(
        viewpoints=tuple(problem.candidates[i] for i in chosen[problem.taken :]),
        fitness=fitness,
        terms=terms,
        candidates=len(problem.candidates) - problem.taken,
        spare=tuple(problem.candidates[i] for i in spare),
        spare_gains=more[spare],
    )
    if config.prove and not stopped:
        bound, kind = fitness_bound(problem, chosen, k)
        placement = replace(placement, bound=bound, bound_kind=kind)
    return placement


def choose(
    problem: FitnessProblem,
    k: int,
    config: AnnealingConfig,
    rng: np.random.Generator,
    on_progress: ProgressReport | None = None,
    cancelled: CancelCheck | None = None,
) -> tuple[NDArray[np.intp], bool]:
    """Return the indices ``(k,)`` of the best choice found, and whether the search was cancelled.

    Those of pictures taken already come first. Arguments and errors are those of ``place``.
    """
    refuse_impossible(problem, k)
    count = len(problem.candidates)
    arrays = search_arrays(problem, k)
    starts = _starts(problem, arrays, k, config, rng)
    best = starts[0].copy()
    values = np.array([0.0, evaluate(problem, best.astype(np.intp), k)[0]])
    done = 0
    for number, swaps in enumerate(_shares(config, spare=count > k)):
        current, heat = starts[number], config.restart_heat if number > 0 else 1.0
        values[0] = evaluate(problem, current.astype(np.intp), k)[0]
        temperature = heat * config.start_temperature * max(values[0], 1e-9)
        cooling = (config.end_factor / heat) ** (1.0 / max(swaps, 1))
        end = done + swaps
        while done < end:
            if cancelled is not None and cancelled():
                return best.astype(np.intp), True
            batch = min(config.report_every, end - done)
            slots, targets, chances = _draw_moves(arrays, k, batch, config, rng)
            temperature = anneal(
                arrays, current, best, values, temperature, cooling, slots, targets, chances
            )
            # Sums of tiny changes drift; each batch starts from the true value again.
            values[0] = evaluate(problem, current.astype(np.intp), k)[0]
            done += batch
            if on_progress is not None:
                views = tuple(problem.candidates[i] for i in best)
                fitness = float(values[1])
                on_progress(PlanProgress(done, config.swaps, temperature, fitness, views))
    return best.astype(np.intp), False


def refuse_impossible(problem: FitnessProblem, k: int) -> None:
    """Raise ValueError if nothing is to be placed, PlanError if there are too few candidates."""
    wanted, free = k - problem.taken, len(problem.candidates) - problem.taken
    if wanted < 1:
        raise ValueError("at least one viewpoint must be placed")
    if free < wanted:
        raise PlanError(f"{wanted} viewpoints are wanted but only {free} candidates are feasible")


def _starts(
    problem: FitnessProblem,
    arrays: SearchArrays,
    k: int,
    config: AnnealingConfig,
    rng: np.random.Generator,
) -> list[NDArray[np.int64]]:
    """Return where each annealing starts: the first greedily, the others anywhere.

    Where a ring among the candidates is better than the greedy choice, the first starts there: what
    is good about a ring is good about all of it at once, which no choice one by one comes upon.
    """
    first, free = greedy(arrays, k), len(arrays.quality) - arrays.taken
    if arrays.taken == 0:
        rings = [first.astype(np.intp), *_rings(problem, k)]
        first = max(rings, key=lambda chosen: evaluate(problem, chosen, k)[0]).astype(np.int64)
    anywhere = [rng.choice(free, k - arrays.taken, replace=False) for _ in range(config.restarts)]
    return [first, *(np.concatenate([first[: arrays.taken], start]) for start in anywhere)]


def _rings(problem: FitnessProblem, k: int) -> Iterator[NDArray[np.intp]]:
    """Yield choices of K candidates that stand as evenly around the object as candidates allow."""
    if k < 2:
        return
    positions = np.array([view.position_world for view in problem.candidates])
    lower, upper = problem.samples.points.min(axis=0), problem.samples.points.max(axis=0)
    offsets = positions - (lower + upper) / 2.0
    angles = 2.0 * np.pi / k * np.arange(k)
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    # Rings that begin beyond the first sector are those that begin in it, counted on.
    azimuths = np.arctan2(offsets[:, 1], offsets[:, 0]) % (2.0 * np.pi)
    first = offsets[azimuths < 2.0 * np.pi / k]
    if len(first) == 0:
        return
    wanted = np.einsum("kij,nj->nki", turns, first)
    _, found = KDTree(offsets).query(wanted)
    for chosen in np.reshape(found, (-1, k)):
        if len(set(chosen.tolist())) == k:
            yield chosen.astype(np.intp)


def _shares(config: AnnealingConfig, *, spare: bool) -> list[int]:
    """Return the moves of each annealing; none when there is no ``spare`` candidate to swap in."""
    if not spare:
        return [0] * (config.restarts + 1)
    each = int(config.swaps * _RESTART_SHARE)
    return [config.swaps - each * config.restarts, *[each] * config.restarts]


def _draw_moves(
    arrays: SearchArrays, k: int, batch: int, config: AnnealingConfig, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw slots, targets (see ``anneal``) and chances of ``batch`` moves."""
    count, neighbours = arrays.neighbours.shape
    swap = rng.integers(0, count, batch)
    adjust = -1 - rng.integers(0, neighbours, batch)
    targets = np.where(rng.random(batch) < config.adjust_share, adjust, swap)
    return rng.integers(arrays.taken, k, batch), targets, rng.random(batch)
