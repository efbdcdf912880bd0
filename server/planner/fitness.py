"""What makes a set of views good: named terms, each in [0, 1], and their weighted sum.

Symbols: O is the chosen set of K views (indices into the D candidates), S the samples with area
share a_s and priority share p_s (each sums to 1 over samples that some candidate sees; in a part
that the operator marked, a patch counts as often as was asked for in both shares), n_s the number
of chosen views that see s sharply (below), W the sum of all weights. The fitness is

    F(O) = (sum of weight x term - weight_overlap x overlap) / W.

Agreement is Algorithm 1 (``server.planner.algorithm1``), which alone would take K copies of the
best view; the other terms are the wishes that the paper's text adds to it, and spread is ours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from server.geometry.boxes import Box3, union
from server.geometry.cameras import Intrinsics
from server.planner.config import FitnessConfig
from server.planner.errors import PlanError
from server.planner.surfaces import SurfaceSamples, even_directions, sample_surface
from server.planner.visibility import VisibilityTable, visibility_table
from server.stages import Priority, SeedGeometry, Viewpoint

Array = NDArray[np.float64]
# Tables of pairs grow with the square of D.
PairArray = NDArray[np.float32]
Chosen = NDArray[np.intp]

# A sample this far outside a part of priority still belongs to it.
_ON_FACE_M = 1e-4
# Two candidates that see less than this share of the area together see nothing.
_NOTHING = 1e-9
# Directions in which people look at a finished model: from level up to steeply down.
_SPREAD_DIRECTIONS = 400
_SPREAD_ELEVATION_MAX_RAD = np.pi / 3.0


@dataclass(frozen=True, slots=True, eq=False)
class FitnessProblem:
    """Everything a choice is judged by, laid out for O(S) updates.

    Attributes:
        candidates: D poses.
        samples: S surface samples.
        table: What every candidate sees.
        config: Weights and scales.
        area_share: a_s ``(S,)``.
        priority_share: p_s ``(S,)``.
        quality: ``(D, S)`` how much of a view of the sample each candidate is, in [0, 1].
        detail: ``(D, S)`` saturating detail in [0, 1].
        spread: ``(D, G)`` how well a candidate stands for each viewing direction, in [0, 1].
        agreement: ``(D,)`` Algorithm 1 of each candidate, scaled so that the best has 1.
        overlap_pairs: float32 ``(D, D)`` needless overlap of two candidates, in [0, 1].
        angles_rad: float32 ``(D, D)`` angles between candidates, seen from the object.
        neighbours: ``(D, N)`` indices of each candidate's nearest others.
        taken: How many candidates, the last ones, are pictures already: part of every choice.
    """

    candidates: tuple[Viewpoint, ...]
    samples: SurfaceSamples
    table: VisibilityTable
    config: FitnessConfig
    area_share: Array
    priority_share: Array
    quality: Array
    detail: Array
    spread: Array
    agreement: Array
    overlap_pairs: PairArray
    angles_rad: PairArray
    neighbours: NDArray[np.int64]
    taken: int = 0


def build_problem(
    seed: SeedGeometry,
    candidates: Sequence[Viewpoint],
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: FitnessConfig,
    neighbours: int = 12,
    weigh: Callable[[Array, Array], Array] | None = None,
    taken: Sequence[Viewpoint] = (),
) -> FitnessProblem:
    """Sample the surface of ``seed``, cast the rays and prepare every term.

    ``weigh`` tells for points and normals ``(s, 3)`` how many times each patch counts, beside the
    operator's wishes.
    Where pictures were ``taken`` already they join the candidates, at their end.

    Raises:
        PlanError: If no candidate sees anything.
    """
    boxes: tuple[Box3, ...] = seed.boxes or (seed.outer,)
    samples = sample_surface(boxes, config.samples)
    candidates = [*candidates, *taken]
    table = visibility_table(candidates, samples, boxes, intrinsics, tilt_rad, config)
    weights = patch_weights(samples, seed.priorities)
    if weigh is not None:
        weights = weights * weigh(samples.points, samples.normals)
    return problem_from_table(
        candidates, samples, table, config, neighbours, weights, taken=len(taken)
    )


def patch_weights(samples: SurfaceSamples, priorities: Sequence[Priority]) -> Array:
    """Return how many times each sample counts ``(S,)``: the greatest weight of its parts, else 1.

    A part bounds patches that lie on its faces too, whatever rounding did to them.
    """
    weights = np.zeros(len(samples))
    for part in priorities:
        inside = part.box.grown(_ON_FACE_M).contains(samples.points)
        weights[inside] = np.maximum(weights[inside], part.weight)
    return np.where(weights > 0.0, weights, 1.0)


def problem_from_table(
    candidates: Sequence[Viewpoint],
    samples: SurfaceSamples,
    table: VisibilityTable,
    config: FitnessConfig,
    neighbours: int = 12,
    weights: Array | None = None,
    taken: int = 0,
) -> FitnessProblem:
    """Prepare every term from a ready table; see ``build_problem``.

    ``weights`` ``(S,)`` say how many times each sample counts, None: once. The last ``taken``
    candidates are pictures already.
    """
    seeable = table.visible.any(axis=0)
    if not seeable.any():
        raise PlanError("no place for a picture: no candidate sees any of the object's surface")
    counted = samples.areas_m2 * seeable * (1.0 if weights is None else weights)
    # Every patch keeps a little priority, so that an object without hollows is no special case.
    priority = counted * (0.02 + samples.concavity**2)
    area_share = counted / counted.sum()
    # What candidates are measured by is what candidates can do, wherever pictures were taken.
    free = slice(len(candidates) - taken)
    agreement = table.agreement @ area_share
    finest = max(float(table.detail_px_per_m2[free].max()), 1e-9)
    detail = np.log1p(table.detail_px_per_m2 / config.detail_px_per_m2)
    lower, upper = samples.points.min(axis=0), samples.points.max(axis=0)
    positions = np.array([v.position_world for v in candidates])
    directions = positions - union((Box3(lower, upper),)).centre
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    angles = _angles(directions, directions).astype(np.float32)
    return FitnessProblem(
        candidates=tuple(candidates),
        samples=samples,
        table=table,
        config=config,
        area_share=area_share,
        priority_share=priority / priority.sum(),
        quality=_quality(table, free, config),
        detail=np.minimum(1.0, detail / np.log1p(finest / config.detail_px_per_m2)),
        spread=_spread_gain(directions, config),
        agreement=np.minimum(1.0, agreement / max(float(agreement[free].max()), 1e-12)),
        overlap_pairs=_overlap_pairs(angles, table, area_share, config),
        angles_rad=angles,
        neighbours=_nearest(positions, neighbours),
        taken=taken,
    )


def evaluate(problem: FitnessProblem, chosen: Chosen, views: int) -> tuple[float, dict[str, float]]:
    """Return the fitness of the candidates ``chosen`` ``(k,)`` and every term before weighting.

    ``views`` is K; with fewer chosen, the rest counts as not yet taken.
    """
    terms = {
        "agreement": agreement(problem, chosen, views),
        "visibility": coverage(problem, chosen, problem.area_share, views),
        "detail": detail(problem, chosen),
        "priority": coverage(problem, chosen, problem.priority_share, views),
        "spread": spread(problem, chosen),
        "baseline": baseline(problem, chosen, views),
        "overlap": overlap(problem, chosen, views),
    }
    signs = {name: -1.0 if name == "overlap" else 1.0 for name in terms}
    weights = {name: float(getattr(problem.config, f"weight_{name}")) for name in terms}
    value = sum(signs[name] * weights[name] * terms[name] for name in terms)
    return value / total_weight(problem.config), terms


def total_weight(config: FitnessConfig) -> float:
    """Return W, the sum of all weights."""
    return float(
        sum(getattr(config, n) for n in config.__dataclass_fields__ if n.startswith("weight_"))
    )


def agreement(problem: FitnessProblem, chosen: Chosen, views: int) -> float:
    """Return (1/K) sum_c A_c / max A, with A_c = sum_s a_s F'(c, s) of Algorithm 1."""
    return float(problem.agreement[chosen].sum() / views)


def coverage(problem: FitnessProblem, chosen: Chosen, share: Array, views: int) -> float:
    """Return sum_s w_s g(n_s): coverage in which a sample wants several views, capped.

    n_s = sum_c q_cs with q_cs = min(1, d_cs / (``sharp_share`` x max_c d_cs)): a view counts fully
    when it is nearly as sharp as any candidate could be, a distant one in part. g is
    ``view_worth``. Counting one view only would be done with a handful of pictures of a box and
    leave the others anywhere; a field needs each point from several sides. With the areas as
    ``share`` this is the term visibility, with the concavities it is priority.
    """
    worth = view_worth(problem.config, views)
    return float(share @ np.interp(problem.quality[chosen].sum(axis=0), range(len(worth)), worth))


def view_worth(config: FitnessConfig, views: int) -> Array:
    """Return g(0), ..., g(K) with g(n) = (1 + q + ... + q^(n-1)) / (1 + ... + q^(m-1)), g <= 1.

    q is ``view_decay`` and m the number of views that a sample wants: ``views_wanted``, less when
    K is small, because a view shows at most half of an object and few views must be spent on
    seeing all of it once. g is concave; between whole numbers it is linear.
    """
    wanted = int(np.clip(round(views / config.pictures_per_view), 1, config.views_wanted))
    increments = config.view_decay ** np.arange(wanted)
    worth = np.concatenate([[0.0], np.cumsum(increments) / increments.sum()])
    return worth[np.minimum(np.arange(views + 1), wanted)]


def detail(problem: FitnessProblem, chosen: Chosen) -> float:
    """Return sum_s a_s log(1 + max_c d_cs / d0) / log(1 + max d / d0).

    d_cs = cos(incidence) (f / distance)^2, pixels per square metre; d0 ``detail_px_per_m2``.
    """
    if len(chosen) == 0:
        return 0.0
    return float(problem.area_share @ problem.detail[chosen].max(axis=0))


def spread(problem: FitnessProblem, chosen: Chosen) -> float:
    """Return the mean over viewing directions g of max_c max(0, 1 - angle(c, g) / theta).

    Even coverage of directions is what the literature on choosing views for radiance fields finds
    hard to beat; theta is ``spread_rad``.
    """
    if len(chosen) == 0:
        return 0.0
    return float(problem.spread[chosen].max(axis=0).mean())


def baseline(problem: FitnessProblem, chosen: Chosen, views: int) -> float:
    """Return (1/K) sum_c max over other views c' of b(angle(c, c')).

    b is ``baseline_worth``: a view needs a neighbour that sees the same, from elsewhere.
    """
    if len(chosen) < 2:
        return 0.0
    pairs = baseline_worth(problem.angles_rad[np.ix_(chosen, chosen)], problem.config, views)
    np.fill_diagonal(pairs, 0.0)
    return float(pairs.max(axis=1).sum() / views)


def baseline_worth(angles_rad: PairArray, config: FitnessConfig, views: int) -> Array:
    """Return b(angle): 1 from ``baseline_low_rad`` to the upper limit, 0 at 0 and 1.5 times that.

    The upper limit is ``baseline_high_rad``, or 2 pi / K where that is wider: K views all around
    cannot be closer neighbours, and asking for it would make them huddle in pairs.
    """
    low = config.baseline_low_rad
    high = max(config.baseline_high_rad, 2.0 * np.pi / views)
    return np.interp(angles_rad, [0.0, low, high, 1.5 * high], [0.0, 1.0, 1.0, 0.0])


def overlap(problem: FitnessProblem, chosen: Chosen, views: int) -> float:
    """Return (1/K) sum over pairs of max(0, 1 - angle / theta_o) x Jaccard(seen, seen').

    Views that see the same from different sides are what reconstruction lives on; overlap is
    needless only when the views also nearly coincide. theta_o is ``overlap_rad``.
    """
    pairs = problem.overlap_pairs[np.ix_(chosen, chosen)]
    return float(max(0.0, pairs.sum() - np.trace(pairs)) / (2.0 * views))


def _angles(a: Array, b: Array) -> Array:
    return np.arccos(np.clip(a @ b.T, -1.0, 1.0))


def _quality(table: VisibilityTable, free: slice, config: FitnessConfig) -> Array:
    sharpest = np.maximum(table.detail_px_per_m2[free].max(axis=0), 1e-9)
    return np.minimum(1.0, table.detail_px_per_m2 / (config.sharp_share * sharpest))


def _spread_gain(directions: Array, config: FitnessConfig) -> Array:
    wanted = even_directions(_SPREAD_DIRECTIONS)
    top = np.sin(_SPREAD_ELEVATION_MAX_RAD)
    wanted = wanted[(wanted[:, 2] >= 0.0) & (wanted[:, 2] <= top)]
    return np.maximum(0.0, 1.0 - _angles(directions, wanted) / config.spread_rad)


def _overlap_pairs(
    angles: PairArray, table: VisibilityTable, area_share: Array, config: FitnessConfig
) -> PairArray:
    seen = table.visible.astype(np.float32)
    both = (seen * area_share.astype(np.float32)) @ seen.T
    each = np.diag(both).copy()
    # In place: of ten thousand candidates one such table takes 400 megabytes.
    pairs = np.add.outer(each, each)
    pairs -= both
    np.divide(both, pairs, out=pairs, where=pairs > _NOTHING)
    nearness = angles * np.float32(-1.0 / config.overlap_rad)
    nearness += np.float32(1.0)
    np.maximum(nearness, 0.0, out=nearness)
    pairs *= nearness
    return pairs


def _nearest(positions: Array, count: int) -> NDArray[np.int64]:
    """Return the ``count`` nearest others of each candidate ``(D, N)``, nearest first."""
    count = max(1, min(count, len(positions) - 1))
    _, found = KDTree(positions).query(positions, k=min(count + 1, len(positions)))
    found = found.reshape(len(positions), -1)
    own = found == np.arange(len(positions))[:, None]
    # Where several stand at one place, a candidate need not be among the nearest of its own.
    own[~own.any(axis=1), -1] = True
    return found[~own].reshape(len(positions), -1).astype(np.int64)
