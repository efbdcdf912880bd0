"""Which rule chooses the viewpoints: by name in the configuration, all with one signature.

``annealed`` is the paper's: a greedy start, then simulated annealing of the fitness.
``farthest`` spreads the views as far from one another as it can, seen from the object, and asks
nothing else: what the literature on choosing views for radiance fields finds hard to beat.
``uncertain`` anneals, too, but every patch counts as much more as the field knows it less; the
knowledge comes as a function of surface points, because the planner knows no field.

Symbols: D candidates, S samples, K views.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from server.planner.config import AnnealingConfig
from server.planner.fitness import FitnessProblem
from server.planner.placement import CancelCheck, ProgressReport, choose, refuse_impossible

Array = NDArray[np.float64]

# Uncertainty in [0, 1] of each of ``(s, 3)`` points on the surface, world metres, with the
# surface's outward normals there ``(s, 3)``.
SurfaceUncertainty = Callable[[Array, Array], Array]

_NEAREST = 8
# Places that face opposite ways count as one object's size apart.
_TURNED = 0.5
# What is known of a place says little of surfaces farther from it than this share of the object's
# size; a box's face is often a tenth of it away from what is inside.
_REACH = 0.2
_LEAST_SIZE_M = 0.1


class Policy(Protocol):
    """Chooses K of a problem's candidates; arguments and result are those of ``choose``."""

    def __call__(
        self,
        problem: FitnessProblem,
        k: int,
        config: AnnealingConfig,
        rng: np.random.Generator,
        on_progress: ProgressReport | None = None,
        cancelled: CancelCheck | None = None,
    ) -> tuple[NDArray[np.intp], bool]:
        """Return the indices ``(k,)`` of the choice, and whether it was cut short."""
        ...


def choose_farthest(
    problem: FitnessProblem,
    k: int,
    config: AnnealingConfig,  # noqa: ARG001 - the signature of all policies.
    rng: np.random.Generator,  # noqa: ARG001
    on_progress: ProgressReport | None = None,  # noqa: ARG001
    cancelled: CancelCheck | None = None,  # noqa: ARG001
) -> tuple[NDArray[np.intp], bool]:
    """Choose by farthest-point sampling of directions, from the candidate that sees most.

    Pictures taken already take that one's place. Of candidates in the same direction the one that
    sees most, by area, stands first.

    Raises:
        ValueError: If no viewpoint is left to place.
        PlanError: If there are too few candidates.
    """
    refuse_impossible(problem, k)
    count = len(problem.candidates)
    seen = problem.table.visible @ problem.area_share
    chosen = list(range(count - problem.taken, count)) or [int(seen.argmax())]
    nearest_rad = problem.angles_rad[chosen].min(axis=0)
    while len(chosen) < k:
        nearest_rad[chosen] = -1.0
        # A thousandth of the area breaks ties between equal angles and overrules nothing else.
        following = int((nearest_rad + 1e-3 * seen).argmax())
        chosen.append(following)
        nearest_rad = np.minimum(nearest_rad, problem.angles_rad[following])
    return np.array(chosen, np.intp), False


POLICIES: dict[str, Policy] = {
    "annealed": choose,
    "farthest": choose_farthest,
    "uncertain": choose,
}


def uncertain_weights(
    points: Array, normals: Array, uncertainty: SurfaceUncertainty, gain: float
) -> Array:
    """Return how many times each patch counts ``(s,)``: 1 + gain x its uncertainty.

    Raises:
        ValueError: If the field's answer has another shape or leaves [0, 1].
    """
    known = np.asarray(uncertainty(points, normals), float)
    if known.shape != (len(points),) or not ((known >= 0.0) & (known <= 1.0)).all():
        raise ValueError("uncertainty must be one number in [0, 1] per point")
    return 1.0 + gain * known


def uncertainty_near(points: Array, normals: Array, uncertainty: Array) -> SurfaceUncertainty:
    """Return the uncertainty of any surface from that of some places on it.

    It is the mean of the nearest places, where a normal that is turned away counts as distance:
    what is known of one side of a thin part says nothing about the other. The farther the nearest
    place, the nearer to wholly unknown, for a field has no place where it has no surface.

    Args:
        points: The places ``(n, 3)``, world metres; there may be none.
        normals: Towards where each was looked at from ``(n, 3)``, unit.
        uncertainty: 0 to 1 of each ``(n,)``.
    """
    if len(points) == 0:
        return lambda asked, _: np.ones(len(asked))
    count = min(_NEAREST, len(points))
    size_m = max(float(np.linalg.norm(np.ptp(points, axis=0))), _LEAST_SIZE_M)
    turned_m = _TURNED * size_m
    places = KDTree(points)
    tree = KDTree(np.hstack([points, turned_m * normals]))

    def of(asked: Array, asked_normals: Array) -> Array:
        _, nearest = tree.query(np.hstack([asked, turned_m * asked_normals]), k=count)
        told = uncertainty[nearest].reshape(len(asked), count).mean(axis=1)
        away_m, _ = places.query(asked)
        return 1.0 - (1.0 - told) * np.exp(-((away_m / (_REACH * size_m)) ** 2))

    return of
