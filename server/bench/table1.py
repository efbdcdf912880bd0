"""``dronerf bench table1``: the paper's table, standard placement against optimised.

Per scene and seed two whole missions are flown in virtual time by what flies real drones, one in
each mode of the product, its eyes looking at the drawn room; the kept pictures go through the
drone's video coding. Four modes are made of the two flights (``server.bench.table.modes``); each
trains a field for the same number of steps on its own pictures and is judged on the same test views
(``table.views``), which none has seen. ``paired`` has the differences of ``optimized`` minus each
standard, flight by flight (``table.figures``).

``flight_s`` is simulated time from take-off to landing, ``wall_s`` what flight, drawing, refinement
and training took here; judging does not count. ``surface_seen`` is the share of the true surface
that a flight's pictures show. Every flight with its modes is a part of its own in ``--out``, and
the report is written anew after every seed. ``--pictures`` and ``--drones`` add curves over other
counts, ``--ablations`` the mission without each of its parts; one seed of two scenes each.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2

from server.bench.conditions import conditions
from server.bench.options import Figures, Options
from server.bench.table.ablations import ablations
from server.bench.table.curves import curves
from server.bench.table.figures import Runs, mode_figures, paired, pooled
from server.bench.table.modes import EVERY_MODE, MODES
from server.bench.table.parts import Parts, Wanted
from server.bench.table.report import Report
from server.sim.scenes.catalogue import SCENES as NAMED_SCENES

SCENES = tuple(NAMED_SCENES)
QUICK_SCENES = ("robot_dog",)
PICTURES, DRONES = 24, 4
_SEEDS, _QUICK_SEEDS = 3, 1
_VIEWS, _QUICK_VIEWS = 40, 8
# What a minute of training takes on two free cores, and a sixth of it.
_STEPS, _QUICK_STEPS = 1500, 250


def run(options: Options) -> Figures:
    """Measure all parts, add up, and write the report when there is a folder for it."""
    cv2.setNumThreads(1)
    found = conditions(options.seed, quick=options.quick, threads=options.threads)
    parts = Parts(
        options.out, resume=options.resume, threads=options.threads, commit=found["commit"]
    )
    first = [wanted for scene in options.scenes for wanted in _wanted(options, scene, options.seed)]

    def report(figures: Figures) -> None:
        if options.out is not None:
            Report(figures, found | {"measured_at": parts.commits()}, options, first).write()

    # Seed after seed, so that a bench that is cut off has told something of every scene.
    figures = Figures({}, {})
    for seeds in range(1, (_QUICK_SEEDS if options.quick else _SEEDS) + 1):
        figures = _figures(options, parts, seeds)
        report(figures)
    two = [_wanted(options, scene, options.seed) for scene in options.scenes[:2]]
    if options.pictures or options.drones:
        figures.overall["curves"] = curves(parts, two, options.pictures, options.drones)
        report(figures)
    if options.ablations:
        figures.overall["ablations"] = ablations(parts, two)
        report(figures)
    return figures


def _figures(options: Options, parts: Parts, seeds: int) -> Figures:
    """Return the table of the first ``seeds`` seeds."""
    runs, failed = _all_runs(options, parts, seeds)
    figures = Figures(
        {scene: _scene_figures(of_scene) for scene, of_scene in runs.items()}, _overall(runs)
    )
    if failed:
        figures.overall["failed_flights"] = failed
    return figures


def _all_runs(options: Options, parts: Parts, seeds: int) -> tuple[dict[str, Runs], dict[str, str]]:
    """Return the samples of every scene, one entry per seed, and which flights failed."""
    runs: dict[str, list[dict[str, Any]]] = {scene: [] for scene in options.scenes}
    failed: dict[str, str] = {}
    for seed in range(options.seed, options.seed + seeds):
        for scene in options.scenes:
            samples: dict[str, Any] = {}
            for wanted in _wanted(options, scene, seed):
                part = parts.measured(wanted, shown=seed == options.seed)
                samples |= part["samples"]
                if "failed" in part:
                    failed[part["name"]] = part["failed"]
            runs[scene].append(samples)
    return dict(runs), failed


def _wanted(options: Options, scene: str, seed: int) -> list[Wanted]:
    """Return the two flights of a scene and a seed."""
    return [
        Wanted(
            scene=scene,
            seed=seed,
            flight=flight,
            pictures=PICTURES,
            drones=DRONES,
            steps=_QUICK_STEPS if options.quick else _STEPS,
            views=_QUICK_VIEWS if options.quick else _VIEWS,
            modes=modes,
        )
        for flight, modes in MODES.items()
    ]


def _scene_figures(runs: Runs) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for mode in EVERY_MODE:
        samples = [run[mode] for run in runs if mode in run]
        if samples:
            figures[mode] = mode_figures(samples)
    return figures | {"paired": paired(runs)}


def _overall(runs: Mapping[str, Runs]) -> dict[str, Any]:
    """Return means over scenes with their deviation over seeds, and pairs over all flights."""
    figures: dict[str, Any] = {}
    for mode in EVERY_MODE:
        by_seed = [
            [run[mode] for run in of_seed if mode in run]
            for of_seed in zip(*runs.values(), strict=True)
        ]
        samples = [pooled(of_seed) for of_seed in by_seed if of_seed]
        if samples:
            figures[mode] = mode_figures(samples)
    return figures | {"paired": paired([run for of_scene in runs.values() for run in of_scene])}
