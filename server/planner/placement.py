"""Choosing O, the K best viewpoints of P: greedy start, then simulated annealing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from server.planner.annealing import SearchArrays, anneal, greedy, search_arrays
from server.planner.bound import upper_bound
from server.planner.config import AnnealingConfig
from server.planner.errors import PlanError
from server.planner.fitness import FitnessProblem, evaluate
from server.stages import Placement


@dataclass(frozen=True, slots=True)
class PlanProgress:
    """How far the annealing is.

    Attributes:
        iteration: Moves tried.
        iterations: Moves in all.
        temperature: Present temperature, in units of the fitness.
        fitness: Best fitness so far.
    """

    iteration: int
    iterations: int
    temperature: float
    fitness: float


ProgressReport = Callable[[PlanProgress], None]
CancelCheck = Callable[[], bool]


def place(
    problem: FitnessProblem,
    k: int,
    config: AnnealingConfig,
    rng: np.random.Generator,
    on_progress: ProgressReport | None = None,
    cancelled: CancelCheck | None = None,
) -> Placement:
    """Choose ``k`` different candidates of ``problem``.

    The same problem, ``k``, configuration and state of ``rng`` give the same placement. When
    ``cancelled`` returns True the best choice so far is returned, without an upper bound.

    Raises:
        ValueError: If ``k`` is less than 1.
        PlanError: If there are fewer than ``k`` candidates.
    """
    chosen, stopped = choose(problem, k, config, rng, on_progress, cancelled)
    fitness, terms = evaluate(problem, chosen, k)
    placement = Placement(
        viewpoints=tuple(problem.candidates[i] for i in chosen),
        fitness=fitness,
        terms=terms,
        candidates=len(problem.candidates),
    )
    if config.prove and not stopped:
        placement = replace(placement, bound=upper_bound(problem, k).fitness)
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

    Arguments and errors are those of ``place``.
    """
    count = len(problem.candidates)
    if k < 1:
        raise ValueError("at least one viewpoint must be placed")
    if count < k:
        raise PlanError(f"{k} viewpoints are wanted but only {count} candidates are feasible")
    arrays = search_arrays(problem, k)
    current = greedy(arrays, k)
    best = current.copy()
    start = evaluate(problem, best, k)[0]
    values = np.array([start, start])
    temperature = config.start_temperature * max(start, 1e-9)
    # No candidate can be exchanged when all are chosen.
    swaps = config.swaps if count > k else 0
    cooling = config.end_factor ** (1.0 / max(swaps, 1))
    done = 0
    while done < swaps:
        if cancelled is not None and cancelled():
            return best.astype(np.intp), True
        batch = min(config.report_every, swaps - done)
        slots, targets, chances = _draw_moves(arrays, k, batch, config, rng)
        temperature = anneal(
            arrays, current, best, values, temperature, cooling, slots, targets, chances
        )
        # Sums of tiny changes drift; each batch starts from the true value again.
        values[0] = evaluate(problem, current.astype(np.intp), k)[0]
        done += batch
        if on_progress is not None:
            on_progress(PlanProgress(done, swaps, temperature, float(values[1])))
    return best.astype(np.intp), False


def _draw_moves(
    arrays: SearchArrays, k: int, batch: int, config: AnnealingConfig, rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Draw slots, targets (see ``anneal``) and chances of ``batch`` moves."""
    count, neighbours = arrays.neighbours.shape
    swap = rng.integers(0, count, batch)
    adjust = -1 - rng.integers(0, neighbours, batch)
    targets = np.where(rng.random(batch) < config.adjust_share, adjust, swap)
    return rng.integers(0, k, batch), targets, rng.random(batch)
