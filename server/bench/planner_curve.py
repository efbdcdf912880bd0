"""How the planner grows with its task, and what seed geometry of the wrong size costs.

Symbols: D candidates, S surface samples, K pictures.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from server.bench.planner_judge import Judge
from server.bench.planner_plans import MEASURES, mission_views, score
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.candidates import generate_candidates
from server.planner.config import PlannerConfig
from server.planner.fitness import FitnessProblem, build_problem
from server.planner.placement import choose
from server.stages import SeedGeometry, Viewpoint

SIZES = ((300, 500), (600, 500), (600, 800), (600, 5000), (2500, 800), (10000, 800), (600, 50000))
QUICK_SIZES = SIZES[:3]
_VIEWS = 24
# So wrong the seed geometry is, about its foot's middle.
_WRONG = (0.8, 1.2)


def size_curve(box: Box3, seed: int, sizes: Sequence[tuple[int, int]]) -> list[dict[str, Any]]:
    """Return time and memory of a plan of 24 pictures around ``box`` for every (D, S).

    Seconds are CPU seconds of one thread; ``mbyte`` is what the finished problem holds.
    """
    config = PlannerConfig()
    dense = replace(config, candidates=replace(config.candidates, azimuths=360, heights=16))
    geometry = SeedGeometry(box, (box,), 4)
    pool = generate_candidates(geometry, TELLO_INTRINSICS, TELLO_TILT_RAD, dense)
    rng = np.random.default_rng((seed, 6))
    # The first problem of a process pays for the compiler.
    build_problem(geometry, pool[:64], TELLO_INTRINSICS, TELLO_TILT_RAD, config.fitness)
    curve: list[dict[str, Any]] = []
    for candidates, samples in sizes:
        count = min(candidates, len(pool))
        chosen = [pool[i] for i in rng.permutation(len(pool))[:count]]
        curve.append(_timed(geometry, chosen, samples, config, seed))
    return curve


def _timed(
    geometry: SeedGeometry,
    candidates: Sequence[Viewpoint],
    samples: int,
    config: PlannerConfig,
    seed: int,
) -> dict[str, Any]:
    begun_s = time.process_time()
    problem = build_problem(
        geometry,
        candidates,
        TELLO_INTRINSICS,
        TELLO_TILT_RAD,
        replace(config.fitness, samples=samples),
    )
    table_s = time.process_time() - begun_s
    begun_s = time.process_time()
    choose(problem, _VIEWS, config.annealing, np.random.default_rng(seed))
    return {
        "candidates": len(candidates),
        "samples": len(problem.samples),
        "table_s": round(table_s, 2),
        "search_s": round(time.process_time() - begun_s, 2),
        "mbyte": round(_bytes(problem) / 2**20, 1),
    }


def _bytes(problem: FitnessProblem) -> int:
    """Return what the arrays of a problem hold."""
    held = [getattr(problem, entry.name) for entry in fields(problem)]
    held += [getattr(problem.table, entry.name) for entry in fields(problem.table)]
    return sum(array.nbytes for array in held if isinstance(array, np.ndarray))


def wrong_seeds(
    judge: Judge, box: Box3, k: int, config: PlannerConfig, seed: int
) -> dict[str, Any]:
    """Return every measure of the mission's plan on a box a fifth too small or too large."""
    foot = np.append(box.centre[:2], box.lower[2])
    figures: dict[str, Any] = {}
    for factor in _WRONG:
        wrong = Box3(foot + factor * (box.lower - foot), foot + factor * (box.upper - foot))
        views = mission_views(SeedGeometry(wrong, (wrong,), 4), k, config, seed)
        sights = judge.look(views)
        figures[f"times_{factor}"] = {m: score(sights, np.arange(k), m) for m in MEASURES}
    return figures
