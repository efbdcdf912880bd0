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

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

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


def bound_gap(problem: FitnessProblem, chosen: Chosen, views: int) -> float:
    """Return (bound - value) / bound on the linear terms."""
    bound = upper_bound(problem, views).linear
    return (bound - linear_value(problem, chosen, views)) / bound


def upper_bound(problem: FitnessProblem, views: int) -> UpperBound:
    """Bound the fitness of any choice of ``views`` candidates.

    Raises:
        PlanError: If there are fewer candidates than views, or the solver fails.
    """
    config = problem.config
    everything = np.arange(len(problem.candidates))
    linear = _linear_bound(problem, views)
    rest = (
        config.weight_detail * detail(problem, everything)
        + config.weight_spread * spread(problem, everything)
        + config.weight_baseline
    ) / total_weight(config)
    return UpperBound(linear, linear + rest)


def _linear_bound(problem: FitnessProblem, views: int) -> float:
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
    rows = sparse.hstack([-sparse.csr_array(quality), counted], format="csr")
    total = sparse.csr_array(np.concatenate([np.ones(count), np.zeros(len(cost) - count)])[None, :])
    solved = linprog(
        cost,
        A_ub=rows,
        b_ub=np.zeros(len(weight)),
        A_eq=total,
        b_eq=[views],
        bounds=(0.0, 1.0),
        method="highs",
    )
    if not solved.success:
        raise PlanError(f"the bound's linear program failed: {solved.message}")
    return float(-solved.fun)
