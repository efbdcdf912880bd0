"""How much better any other choice could be: an upper bound by linear programming.

Symbols: x_c in [0, 1] is how much candidate c is chosen, u_si how much of the i-th view of sample
s there is, q_cs how much of a view c is of s, g_i the worth of i views. The linear terms are
visibility, priority and agreement:

    max sum_s w_s sum_i (g_i - g_(i-1)) u_si + sum_c a_c x_c
    with sum_i u_si <= sum_c q_cs x_c,  sum_c x_c = K,  0 <= u, x <= 1.

Every real choice is a feasible point, so the optimum bounds them all. The other terms are bounded
by themselves: detail and spread by what all candidates together reach, baseline by 1, and overlap
by none. The sum bounds the whole fitness, less tightly than the linear terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

from server.planner.errors import PlanError
from server.planner.fitness import (
    Chosen,
    FitnessProblem,
    agreement,
    coverage,
    detail,
    spread,
    total_weight,
    view_worth,
)
from server.stages import BoundKind

# At the hundred bytes or so that each takes in a solver's copies: two gigabytes.
_MOST_ENTRIES = 20_000_000


@dataclass(frozen=True, slots=True)
class UpperBound:
    """What no choice of K candidates exceeds.

    Attributes:
        linear: Bound of the linear terms, weighted and normalised like the fitness.
        fitness: Bound of the whole fitness.
    """

    linear: float
    fitness: float


def linear_value(problem: FitnessProblem, chosen: Chosen, views: int) -> float:
    """Return the weighted linear terms of a choice, comparable with ``UpperBound.linear``."""
    config = problem.config
    value = (
        config.weight_visibility * coverage(problem, chosen, problem.area_share, views)
        + config.weight_priority * coverage(problem, chosen, problem.priority_share, views)
        + config.weight_agreement * agreement(problem, chosen, views)
    )
    return value / total_weight(config)


def fitness_bound(
    problem: FitnessProblem, chosen: Chosen, views: int, most_entries: int = _MOST_ENTRIES
) -> tuple[float, BoundKind]:
    """Bound the fitness of any choice of ``views`` candidates, and name the bound.

    It is ``upper_bound``'s, or ``submodular_bound``'s about ``chosen`` where the linear program
    would have more than ``most_entries`` and so outgrow the memory.

    Raises:
        PlanError: As ``upper_bound``.
    """
    if np.count_nonzero(problem.quality) > most_entries:
        return submodular_bound(problem, chosen, views).fitness, "submodular"
    return upper_bound(problem, views).fitness, "linear program"


def upper_bound(problem: FitnessProblem, views: int) -> UpperBound:
    """Bound the fitness of any choice of ``views`` candidates.

    Raises:
        PlanError: If there are fewer candidates than views, or the solver fails.
    """
    linear = _linear_bound(problem, views)
    return UpperBound(linear, linear + _rest_bound(problem))


def proven_optimum(problem: FitnessProblem, views: int, seconds: float) -> UpperBound:
    """Bound like ``upper_bound``, with whole candidates: the linear terms' optimum itself.

    Branch and bound needs time; after ``seconds`` its bound so far is returned, which lies between
    the optimum and the linear program's.

    Raises:
        PlanError: If there are fewer candidates than views, or the solver finds no bound.
    """
    program = _linear_program(problem, views)
    whole = np.zeros(len(program.cost))
    whole[: len(problem.candidates)] = 1.0
    solved = milp(
        program.cost,
        integrality=whole,
        # Its types know single numbers only.
        bounds=Bounds(program.lower, 1.0),  # pyright: ignore[reportArgumentType]
        constraints=[
            LinearConstraint(program.rows, -np.inf, 0.0),
            LinearConstraint(program.total, views, views),
        ],
        options={"time_limit": seconds},
    )
    if solved.mip_dual_bound is None or not np.isfinite(solved.mip_dual_bound):
        raise PlanError(f"the bound's integer program failed: {solved.message}")
    linear = float(-solved.mip_dual_bound)
    return UpperBound(linear, linear + _rest_bound(problem))


def submodular_bound(problem: FitnessProblem, chosen: Chosen, views: int) -> UpperBound:
    """Bound the fitness from one choice alone, without a program: F(O) + the K greatest gains.

    For monotone submodular F no set of K exceeds F(S) + sum over the K greatest F(S + c) - F(S)
    (Nemhauser, Wolsey and Fisher 1978); of several S, here the choice and its beginnings down to
    none, the least counts. Linear terms, detail and spread are of that kind and are bounded
    together in ``fitness``; baseline is bounded by 1 and overlap by none. Needs memory for one
    ``(D, S)`` array alone, where the linear program outgrows it.
    """
    linear = _submodular(problem, chosen, views, best_views=False)
    both = _submodular(problem, chosen, views, best_views=True)
    config = problem.config
    return UpperBound(linear, both + config.weight_baseline / total_weight(config))


def _submodular(problem: FitnessProblem, chosen: Chosen, views: int, *, best_views: bool) -> float:
    config, scale = problem.config, 1.0 / total_weight(problem.config)
    worth = view_worth(config, max(views, 1))
    weight = scale * (
        config.weight_visibility * problem.area_share
        + config.weight_priority * problem.priority_share
    )
    single = scale * config.weight_agreement / views * problem.agreement
    seen, value = np.zeros(len(weight)), 0.0
    parts = [(problem.detail, scale * config.weight_detail * problem.area_share)]
    directions = problem.spread.shape[1]
    parts.append((problem.spread, np.full(directions, scale * config.weight_spread / directions)))
    parts = [part for part in parts if best_views and part[1].any()]
    tops = [np.zeros(len(shares)) for _, shares in parts]
    least = np.inf
    for step in range(len(chosen) + 1):
        reached = np.interp(seen, range(len(worth)), worth)
        gains = single.copy()
        for row in range(len(gains)):
            after = np.interp(seen + problem.quality[row], range(len(worth)), worth)
            gains[row] += weight @ (after - reached)
        for (terms, shares), top in zip(parts, tops, strict=True):
            gains += np.maximum(terms - top, 0.0) @ shares
        least = min(least, value + float(np.sort(gains)[-views:].sum()))
        if step < len(chosen):
            value += float(gains[chosen[step]])
            seen += problem.quality[chosen[step]]
            for (terms, _), top in zip(parts, tops, strict=True):
                np.maximum(top, terms[chosen[step]], out=top)
    return least


class _Program(NamedTuple):
    """min cost x with rows x <= 0, total x = K, lower <= x <= 1.

    x holds x_c of the candidates, then u_si of the ``seen`` samples; ``lower`` is 1 for pictures
    taken already, else 0.
    """

    cost: NDArray[np.float64]
    rows: sparse.csr_array
    total: sparse.csr_array
    lower: NDArray[np.float64]
    seen: int


def _linear_program(problem: FitnessProblem, views: int) -> _Program:
    config, scale = problem.config, 1.0 / total_weight(problem.config)
    count = len(problem.candidates)
    if views > count:
        raise PlanError(f"{views} views of {count} candidates cannot be chosen")
    sample_weight = scale * (
        config.weight_visibility * problem.area_share
        + config.weight_priority * problem.priority_share
    )
    # Samples that no candidate sees add nothing and need no row.
    seen = problem.table.visible.any(axis=0)
    quality, weight = problem.quality[:, seen].T, sample_weight[seen]
    increments = np.diff(view_worth(config, views))
    increments = increments[increments > 0]
    cost = np.concatenate(
        [
            -scale * config.weight_agreement / views * problem.agreement,
            -(weight[:, None] * increments[None, :]).ravel(),
        ]
    )
    counted = sparse.kron(sparse.eye_array(len(weight)), np.ones((1, len(increments))))
    rows = sparse.csr_array(sparse.hstack([-sparse.csr_array(quality), counted]))
    total = sparse.csr_array(np.concatenate([np.ones(count), np.zeros(len(cost) - count)])[None, :])
    lower = np.zeros(len(cost))
    lower[count - problem.taken : count] = 1.0
    return _Program(cost, rows, total, lower, len(weight))


def _linear_bound(problem: FitnessProblem, views: int) -> float:
    program = _linear_program(problem, views)
    solved = linprog(
        program.cost,
        A_ub=program.rows,
        b_ub=np.zeros(program.seen),
        A_eq=program.total,
        b_eq=[views],
        bounds=np.stack([program.lower, np.ones_like(program.lower)], axis=1),
        method="highs",
    )
    if not solved.success:
        raise PlanError(f"the bound's linear program failed: {solved.message}")
    return float(-solved.fun)


def _rest_bound(problem: FitnessProblem) -> float:
    """Bound the terms that are not linear: by what all candidates reach together, and by 1."""
    config, everything = problem.config, np.arange(len(problem.candidates))
    rest = (
        config.weight_detail * detail(problem, everything)
        + config.weight_spread * spread(problem, everything)
        + config.weight_baseline
    )
    return rest / total_weight(config)


@dataclass(frozen=True, slots=True)
class EnoughViews:
    """How many pictures see a share of the surface that can be seen at all.

    Attributes:
        sufficient: Least number with which a plan was found, None up to the most asked for.
        needed: Fewer than this cannot be enough, whatever the plan; None: not even the most are.
        reached: Share seen with 1, 2, ... views by the plans found.
    """

    sufficient: int | None
    needed: int | None
    reached: tuple[float, ...]


def views_enough(problem: FitnessProblem, share: float, most: int) -> EnoughViews:
    """Answer "how many pictures are enough to see ``share`` of the surface?", 0 < share <= 1.

    Greedy choice gives the plans. K views see no more than the K best single views together, nor
    than greedy's share plus the K greatest gains (``submodular_bound``); where that stays below
    ``share``, K is proven too few.
    """
    most = min(most, len(problem.candidates))
    visible = problem.table.visible
    seen = np.zeros(visible.shape[1], bool)
    reached: list[float] = []
    bounds = np.full(most, np.inf)
    for step in range(most + 1):
        value = float(problem.area_share @ seen)
        gains = np.sort((visible & ~seen) @ problem.area_share)[::-1]
        bounds = np.minimum(bounds, value + np.cumsum(gains[:most]))
        if step > 0:
            reached.append(value)
        seen |= visible[int(((visible & ~seen) @ problem.area_share).argmax())]
    # Sums of shares end a rounding error below one.
    enough = [k + 1 for k, value in enumerate(reached) if value >= share - 1e-9]
    possible = [k + 1 for k, bound in enumerate(bounds) if bound >= share - 1e-9]
    return EnoughViews(
        enough[0] if enough else None, possible[0] if possible else None, tuple(reached)
    )
