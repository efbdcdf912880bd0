"""Trainings anew: run folders without a flight of their own, on the pictures of another run.

What was asked for stands in ``jobs/reconstruct/spec.json`` where a console was asked, and in
``training.json`` until all results are there; what came of it in ``metrics.json``. Nothing here is
remembered: a library that was copied, or a console that was started anew, finds the same.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from server.store.runs import STATE, is_trained

_JOB = Path("jobs") / "reconstruct"
_WANTED, _KEPT = "training.json", "training.npz"
# A worker that was asked to end, or has failed, keeps nothing so long after.
_LAST_WORDS_S = 20.0


@dataclass(frozen=True, slots=True)
class Training:
    """A training as its run folder tells of it.

    Attributes:
        dataset: Folder of the pictures that it trains on; empty where the run does not tell.
        seconds: Training time that was asked for; None where it was steps, or is not told.
        seed: Seed of everything random in it; None where it is not told.
        object_only: Whether the object was cut out of the pictures.
        metrics: What the judgement found, None before it.
        finished: All its results are there.
        stopped: Somebody asked it to end.
        error: Why it failed, None where it did not or could not tell.
    """

    dataset: str
    seconds: float | None
    seed: int | None
    object_only: bool
    metrics: dict[str, Any] | None = None
    finished: bool = False
    stopped: bool = False
    error: str | None = None


def read_training(folder: Path) -> Training | None:
    """Return the training that a run folder tells of, None when it tells of none."""
    metrics = _object(folder / "metrics.json")
    unfinished = _object(folder / _WANTED)
    asked = unfinished or _object(folder / _JOB / "spec.json") or {}
    parameters = asked.get("parameters")
    if not isinstance(parameters, dict) or parameters.get("source") != "dataset":
        parameters = {}
    if metrics is None and not parameters:
        return None
    finished = metrics is not None and unfinished is None
    stopped, error = (False, None) if finished else _last_words(folder)
    told = {"seed": asked.get("seed")} | parameters | (metrics or {})
    training = training_asked_for(told, told["seed"])
    return replace(training, metrics=metrics, finished=finished, stopped=stopped, error=error)


def training_asked_for(parameters: Mapping[str, Any], seed: object) -> Training:
    """Return a training that has not begun, by the parameters of its job."""
    seconds = parameters.get("train_seconds")
    return Training(
        dataset=str(parameters.get("dataset") or parameters.get("scene") or ""),
        seconds=float(seconds) if isinstance(seconds, int | float) else None,
        seed=seed if isinstance(seed, int) else None,
        object_only=parameters.get("object_only") is True,
    )


def trainings_on(run: Path) -> list[Path]:
    """Return the run folders beside ``run`` that were trained on its pictures, the newest first."""
    run = run.resolve()
    found: list[Path] = []
    if not run.parent.is_dir():
        return found
    for folder in run.parent.iterdir():
        if not is_trained(folder) or (folder / STATE).is_file() or folder == run:
            continue
        training = read_training(folder)
        if training is not None and _is_at(training.dataset, run):
            found.append(folder)
    return sorted(found, key=lambda folder: folder.name, reverse=True)


def _is_at(dataset: str, run: Path) -> bool:
    """Return whether a training's pictures are those of ``run``."""
    there = Path(dataset)
    if there.name != run.name:
        return False
    # In a library that was moved, trainings remember where its captures were.
    return there.resolve() == run or not there.exists()


def _last_words(folder: Path) -> tuple[bool, str | None]:
    """Return whether a training that is not finished was stopped, and why it failed."""
    job = folder / _JOB
    kept_s, told_s, asked_s = (
        _changed_s(file) for file in (folder / _KEPT, job / "events.jsonl", job / "stop")
    )
    if kept_s > max(told_s, asked_s) + _LAST_WORDS_S:
        return False, None  # Somebody goes on with it since.
    try:
        last = json.loads((job / "events.jsonl").read_text().splitlines()[-1])
        failed = last["event"] == "failed" and not last.get("stopped", False)
        error = str(last["error"]) if failed else None
    except (OSError, ValueError, KeyError, IndexError, TypeError, AttributeError):
        error = None
    return (True, None) if asked_s > 0.0 else (False, error)


def _changed_s(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def _object(file: Path) -> dict[str, Any] | None:
    """Return the JSON object in a file, None when there is none to read."""
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None
