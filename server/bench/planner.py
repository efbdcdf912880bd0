"""``dronerf bench planner``: how much of an object the plans see, against the rings.

Every plan is judged on the true mesh by ray casting. Candidates of the exact plans stand around the
true box, with the standard ring's and the best ring's own poses among them; plans from boxes know
the seed geometry alone that the mission's eyes make of four simulated pictures; ``wrong_seed`` is
the mission's plan on a box a fifth too small or too large, and ``size_curve`` what larger tasks
take. Times are CPU seconds of one thread.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.bench.options import Figures, Options, each_scene
from server.bench.planner_curve import QUICK_SIZES, SIZES, size_curve, wrong_seeds
from server.bench.planner_judge import Judge, Sights
from server.bench.planner_picture import save_picture
from server.bench.planner_plans import (
    MEASURES,
    best_ring,
    exact_problem,
    farthest_views,
    mission_views,
    objective,
    ring_score,
    rings_around,
    score,
)
from server.bench.planner_terms import without_terms
from server.bench.scenes import named_and_shared_scenes
from server.bench.seed_figures import fitted_after, seen_by_mission
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.annealing import greedy, search_arrays
from server.planner.bound import linear_value, proven_optimum, upper_bound
from server.planner.candidates import generate_candidates
from server.planner.config import PlannerConfig
from server.planner.errors import PlanError
from server.planner.fitness import build_problem
from server.planner.placement import choose
from server.sim.scenes.catalogue import SCENES as NAMED_SCENES
from server.sim.scenes.catalogue import load_object
from server.stages import SeedGeometry, Viewpoint
from server.vision.config import SeedConfig

Indices = NDArray[np.intp]


SCENES = named_and_shared_scenes()
QUICK_SCENES = tuple(NAMED_SCENES)

VIEW_COUNTS = (4, 24)
_SAMPLES, _QUICK_SAMPLES = 3000, 1500
_SEEDS = 5
_RANDOM_DRAWS = 20
_PROOF_S, _QUICK_PROOF_S = 60.0, 15.0


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """One scene, ready to be planned for.

    Attributes:
        judge: The true surface.
        box: The true box.
        candidates: Poses of the exact plans; the rings' poses follow at the end.
        sights: What the candidates truly see.
        own: Number of candidates that are no ring's.
        table_seconds: CPU time of ``sights`` per candidate, times their number.
    """

    judge: Judge
    box: Box3
    candidates: tuple[Viewpoint, ...]
    sights: Sights
    own: int
    table_seconds: float


def run(options: Options) -> Figures:
    """Measure every scene, or with ``--ablations`` what each term of the fitness is worth."""
    if options.ablations:
        return _terms(options)
    scenes = each_scene("planner", options, lambda scene: _measure(scene, options))
    overall: dict[str, Any] = {
        key: _mean([part[key] for part in scenes.values()]) for key in _keys()
    }
    for key, k in zip(_keys(), VIEW_COUNTS, strict=True):
        overall[key]["against_ring"] = _against_ring([part[key] for part in scenes.values()], k)
    model = load_object(options.scenes[0])
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    sizes = QUICK_SIZES if options.quick else SIZES
    overall["size_curve"] = size_curve(box, options.seed, sizes)
    return Figures(scenes, overall)


def _terms(options: Options) -> Figures:
    samples = _QUICK_SAMPLES if options.quick else _SAMPLES
    scenes = each_scene(
        "planner-terms",
        options,
        lambda scene: without_terms(scene, options.seed, VIEW_COUNTS, samples),
    )
    return Figures(scenes, _mean(list(scenes.values())))


def _keys() -> list[str]:
    return [f"k{k}" for k in VIEW_COUNTS]


def _measure(scene: str, options: Options) -> dict[str, Any]:
    model = load_object(scene)
    config = PlannerConfig()
    judge = Judge(model, _QUICK_SAMPLES if options.quick else _SAMPLES, 0)
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    rings = rings_around(box, config)
    ring_sights = judge.look(rings.views)
    course = _prepare(judge, box, config)
    seeds = range(options.seed, options.seed + (1 if options.quick else _SEEDS))
    fitted = {seed: _seen_boxes(scene, seed) for seed in seeds}
    figures: dict[str, Any] = {}
    for k in VIEW_COUNTS:
        best = {m: best_ring(rings, ring_sights, k, m) for m in MEASURES}
        with_rings = _with_views(course, [rings.views[: len(rings.views) // rings.circles]])
        with_rings = _with_views(with_rings, [[rings.views[i] for i in best[m]] for m in MEASURES])
        part = _mean([_plans(with_rings, fitted[s], k, config, s) for s in seeds])
        for measure in MEASURES:
            part[measure]["ring"] = ring_score(rings, ring_sights, k, measure)
            part[measure]["best_ring"] = score(ring_sights, best[measure], measure)
            part[measure]["everything"] = score(
                with_rings.sights, np.arange(len(with_rings.candidates)), measure
            )
        proof_s = _QUICK_PROOF_S if options.quick else _PROOF_S
        part |= _proof(with_rings, k, config, options.seed, proof_s)
        part["wrong_seed"] = wrong_seeds(judge, box, k, config, options.seed)
        part["seeds"] = len(seeds)
        part["without_seed_geometry"] = sum(boxes is None for boxes in fitted.values())
        figures[f"k{k}"] = part
    if options.out is not None:
        save_picture(options.out / f"planner-{Path(scene).name}.png", scene, figures)
    return figures


def _prepare(judge: Judge, box: Box3, config: PlannerConfig) -> _Course:
    seed = SeedGeometry(box, (box,), 4)
    candidates = generate_candidates(seed, TELLO_INTRINSICS, TELLO_TILT_RAD, config)
    began_s = time.process_time()
    sights = judge.look(candidates)
    return _Course(judge, box, candidates, sights, len(candidates), time.process_time() - began_s)


def _with_views(course: _Course, more: Sequence[Sequence[Viewpoint]]) -> _Course:
    """Return the course with further candidates at the end."""
    views = [view for part in more for view in part]
    seen = course.judge.look(views)
    sights = Sights(
        np.concatenate([course.sights.visible, seen.visible]),
        np.concatenate([course.sights.detail_px_per_m2, seen.detail_px_per_m2]),
    )
    return replace(course, candidates=(*course.candidates, *views), sights=sights)


def _seen_boxes(scene: str, seed: int) -> SeedGeometry | None:
    """Return what the mission's eyes make of the seed views, None when they make nothing."""
    seen = seen_by_mission(load_object(scene), seed, rounds=0)
    return fitted_after(seen, SeedConfig())


def _plans(
    course: _Course, fitted: SeedGeometry | None, k: int, config: PlannerConfig, seed: int
) -> dict[str, Any]:
    """Return every measure of every plan that depends on the seed."""
    rng = np.random.default_rng((seed, k))
    own = course.candidates[: course.own]
    mission: Sequence[Viewpoint] | None = None
    if fitted is not None:
        mission = mission_views(fitted, k, config, seed)
    flown = None if mission is None else course.judge.look(mission)
    figures: dict[str, Any] = {"seconds": 0.0}
    for measure in MEASURES:
        problem = exact_problem(course.judge, course.candidates, course.sights, measure)
        began_s = time.process_time()
        arrays = search_arrays(problem, k)
        first = greedy(arrays, k).astype(np.intp)
        chosen, _ = choose(problem, k, config.annealing, rng)
        if measure == "visibility":
            figures["seconds"] = time.process_time() - began_s
        draws = [rng.choice(course.own, k, replace=False) for _ in range(_RANDOM_DRAWS)]
        spread = [farthest_views(own, k, rng) for _ in range(_RANDOM_DRAWS // 4)]
        values: dict[str, float | None] = {
            "random": float(np.mean([score(course.sights, d, measure) for d in draws])),
            "farthest": float(np.mean([score(course.sights, d, measure) for d in spread])),
            "greedy": score(course.sights, first, measure),
            "annealed": score(course.sights, chosen, measure),
            "annealed_from_boxes": None,
            "mission_plan": None,
        }
        if fitted is not None and flown is not None:
            values["annealed_from_boxes"] = _from_boxes(course, fitted, k, config, measure, seed)
            values["mission_plan"] = score(flown, np.arange(k), measure)
        figures[measure] = values
    figures["overlap"] = None if flown is None else flown.overlap(np.arange(k))
    return figures


def _from_boxes(
    course: _Course,
    fitted: SeedGeometry,
    k: int,
    config: PlannerConfig,
    measure: str,
    seed: int,
) -> float:
    candidates = generate_candidates(fitted, TELLO_INTRINSICS, TELLO_TILT_RAD, config)
    problem = build_problem(
        fitted, candidates, TELLO_INTRINSICS, TELLO_TILT_RAD, objective(measure)
    )
    chosen, _ = choose(problem, k, config.annealing, np.random.default_rng(seed))
    sights = course.judge.look([candidates[i] for i in chosen])
    return score(sights, np.arange(k), measure)


def _proof(
    course: _Course, k: int, config: PlannerConfig, seed: int, seconds: float
) -> dict[str, Any]:
    """Return how near the plan for visibility is to what can be proven, and what that took."""
    problem = exact_problem(course.judge, course.candidates, course.sights, "visibility")
    chosen, _ = choose(problem, k, config.annealing, np.random.default_rng(seed))
    value = linear_value(problem, chosen, k)
    began_s = time.process_time()
    bound = upper_bound(problem, k).linear
    proof_s = time.process_time() - began_s
    began_s = time.process_time()
    try:
        optimum = proven_optimum(problem, k, seconds).linear
    except PlanError:
        optimum = bound
    return {
        "bound_gap": (bound - value) / bound,
        "optimum_gap": max(0.0, optimum - value) / optimum,
        "table_seconds": course.table_seconds,
        "proof_seconds": proof_s,
        "optimum_seconds": time.process_time() - began_s,
        "candidates": len(course.candidates),
    }


def _mean(parts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the mean of every figure over ``parts``; figures that a part lacks are left out."""
    means: dict[str, Any] = {}
    for key, example in parts[0].items():
        values = [part[key] for part in parts if part.get(key) is not None]
        if not values:
            means[key] = None
        elif isinstance(example, dict):
            means[key] = _mean(values)
        else:
            means[key] = float(np.mean(values))
    return means


def _against_ring(parts: Sequence[dict[str, Any]], k: int) -> dict[str, Any]:
    """Return plans over the ring, per measure: mean and least over the scenes."""
    found: dict[str, Any] = {"views": k}
    for measure in MEASURES:
        for plan, rival in (
            ("mission_plan", "ring"),
            ("annealed", "ring"),
            ("annealed", "best_ring"),
        ):
            pairs = [(part[measure][plan], part[measure][rival]) for part in parts]
            ratios = [mine / max(its, 1e-9) for mine, its in pairs if mine is not None]
            name = f"{measure}_{plan}_over_{rival}"
            found[f"{name}_mean"] = float(np.mean(ratios)) if ratios else None
            found[f"{name}_min"] = min(ratios) if ratios else None
    return found
