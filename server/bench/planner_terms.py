"""``dronerf bench planner --ablations``: what each term of the fitness is worth.

The mission's plans as ``bench planner`` judges them, on the seed boxes that the mission's eyes make
of four simulated pictures, with one weight at a time set to zero.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from server.bench.planner_judge import Judge
from server.bench.planner_plans import MEASURES, mission_views, ring_score, rings_around, score
from server.bench.seed_figures import fitted_after, seen_by_mission
from server.geometry.boxes import Box3
from server.planner.config import FitnessConfig, PlannerConfig
from server.sim.scenes.catalogue import load_object
from server.vision.config import SeedConfig

_WEIGHT = "weight_"
TERMS = tuple(
    field.name.removeprefix(_WEIGHT)
    for field in fields(FitnessConfig)
    if field.name.startswith(_WEIGHT)
)


def without_terms(
    scene: str, seed: int, view_counts: tuple[int, ...], samples: int
) -> dict[str, Any]:
    """Return ``{kK: {without: {measure: share of the standard ring's}}}`` of one scene.

    Raises:
        RuntimeError: If the seed views give no seed geometry.
    """
    model = load_object(scene)
    config = PlannerConfig()
    judge = Judge(model, samples, 0)
    rings = rings_around(Box3(model.vertices.min(axis=0), model.vertices.max(axis=0)), config)
    ring_sights = judge.look(rings.views)
    fitted = fitted_after(seen_by_mission(model, seed, rounds=0), SeedConfig())
    if fitted is None:
        raise RuntimeError(f"{scene}: the seed views give no seed geometry")
    found: dict[str, Any] = {}
    for k in view_counts:
        rivals = {m: ring_score(rings, ring_sights, k, m) for m in MEASURES}
        found[f"k{k}"] = {}
        for term in ("nothing", *TERMS):
            left_out = {} if term == "nothing" else {f"{_WEIGHT}{term}": 0.0}
            fitness = replace(config.fitness, **left_out)
            sights = judge.look(mission_views(fitted, k, replace(config, fitness=fitness), seed))
            found[f"k{k}"][term] = {
                m: score(sights, np.arange(k), m) / max(rivals[m], 1e-9) for m in MEASURES
            }
    return found
