"""Which rule chooses the viewpoints: by name in the configuration, all with one signature.

``annealed`` is the paper's: greedy start, then simulated annealing of the fitness.
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

from server.planner.config import AnnealingConfig
from server.planner.fitness import FitnessProblem
from server.planner.placement import CancelCheck, ProgressReport, choose, refuse_impossible

Array = NDArray[np.float64]

# Uncertainty in [0, 1] of each of ``(s, 3)`` points on the surface, world metres.
SurfaceUncertainty = Callable[[Array], Array]


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


def uncertain_weights(points: Array, uncertainty: SurfaceUncertainty, gain: float) -> Array:
    """Return how many times each patch counts ``(s,)``: 1 + gain x its uncertainty.

    Raises:
        ValueError: If the field's answer has another shape or leaves [0, 1].
    """
    known = np.asarray(uncertainty(points), float)
    if known.shape != (len(points),) or not ((known >= 0.0) & (known <= 1.0)).all():
        raise ValueError("uncertainty must be one number in [0, 1] per point")
    return 1.0 + gain * known
