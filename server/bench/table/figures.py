"""Means, deviations, and paired differences with their confidence intervals.

A sample is one flight's mean over its test views. Modes are paired within a seed and a scene: both
see the same object in the same room from the same test views. With several pairs the interval is
Student's over pairs, each of them flights of its own; with one alone it is over test views, and
says nothing about other flights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from server.bench.table.fields import FIGURES

_CONFIDENCE = 0.95
_STANDARDS = ("standard_paper", "standard_refined")
# Reported means that are no measure of quality.
_PLAIN = ("images", "images_used", "surface_seen", "flight_s", "wall_s", "settled_deg")
# A mode's sample: its figures by test view, and its plain numbers.
Sample = Mapping[str, Any]
# Samples of one scene by seed, each by mode.
Runs = Sequence[Mapping[str, Sample]]


def mode_figures(samples: Sequence[Sample]) -> dict[str, Any]:
    """Return the means over ``samples``, a deviation beside each figure (None of one alone)."""
    result: dict[str, Any] = {}
    for name in FIGURES:
        means = [mean_of(sample["per_view"][name]) for sample in samples]
        result[name] = round(float(np.mean(means)), 4)
        result[f"{name}_sd"] = round(float(np.std(means, ddof=1)), 4) if len(means) > 1 else None
    for name in _PLAIN:
        result[name] = round(float(np.mean([sample[name] for sample in samples])), 4)
    return result


def paired(runs: Runs, better: str = "optimized") -> dict[str, Any]:
    """Return, by standard mode and figure, ``{diff, ci, pairs, over}`` of ``better`` minus it."""
    result: dict[str, Any] = {}
    for standard in _STANDARDS:
        both = [run for run in runs if better in run and standard in run]
        if both:
            result[standard] = {
                name: difference(
                    [run[better]["per_view"][name] for run in both],
                    [run[standard]["per_view"][name] for run in both],
                )
                for name in FIGURES
            }
    return result


def pooled(samples: Sequence[Sample]) -> Sample:
    """Return one sample of several scenes' samples of one seed: all their test views together."""
    return {
        "per_view": {
            name: [value for sample in samples for value in sample["per_view"][name]]
            for name in FIGURES
        }
    } | {name: float(np.mean([sample[name] for sample in samples])) for name in _PLAIN}


def difference(
    better: Sequence[Sequence[float | None]], worse: Sequence[Sequence[float | None]]
) -> dict[str, Any]:
    """Return the mean of ``better - worse`` and its 95 % interval.

    Args:
        better: One list of test views' figures per pair.
        worse: The same views of the other mode.

    Returns:
        ``diff``, ``ci`` (low and high, None when there is nothing to tell it from), ``pairs``, and
        what the interval is ``over``: ``flights``, or ``views`` of a single pair.
    """
    per_pair = [
        np.array(
            [a - b for a, b in zip(one, other, strict=True) if a is not None and b is not None]
        )
        for one, other in zip(better, worse, strict=True)
    ]
    over = "flights" if len(per_pair) > 1 else "views"
    values = np.array([views.mean() for views in per_pair]) if len(per_pair) > 1 else per_pair[0]
    mean = float(values.mean())
    interval = None
    if len(values) > 1:
        half = float(stats.t.ppf(0.5 + _CONFIDENCE / 2.0, len(values) - 1) * stats.sem(values))
        interval = [round(mean - half, 4), round(mean + half, 4)]
    return {"diff": round(mean, 4), "ci": interval, "pairs": len(per_pair), "over": over}


def mean_of(values: Sequence[float | None]) -> float:
    """Return the mean of the values there are."""
    return float(np.mean([value for value in values if value is not None]))
