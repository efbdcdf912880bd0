"""A run as the catalogue lists it, read from its folder.

The folder is the truth: everything here can be read again from it, so a lost catalogue loses
nothing. That holds for the star too, which is an empty file ``starred`` in the folder.
"""

from __future__ import annotations

import math
import os
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from server.store.runs import STAR, RunFolder, begun_at, is_starred
from server.store.trained_now import SILENCE_S, is_trained_now
from server.store.trainings import Training, read_training

UNFINISHED = ("queued", "running", "paused")

_FIGURES = ("psnr_db", "psnr_db_object", "ssim", "flip", "samples_per_s", "images_held_out")
_PICTURES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True, slots=True)
class RunRow:
    """One run as the catalogue lists it.

    Attributes:
        id: The folder's name.
        kind: ``capture`` or ``training``.
        subject: What was captured or trained on: the capture's name or the dataset.
        mode: The capture's mode, empty for a training.
        state: queued, running, paused, succeeded, failed, aborted or interrupted; a training that
            somebody ended is cancelled.
        begun_unix_s: When it began, seconds since 1970 (UTC).
        ended_unix_s: When it ended, None while it goes on.
        pictures: Pictures in ``images/``, or those that were trained on.
        metrics: The headline figures of ``metrics.json``.
        thumbnail: A picture of it, relative to the folder; None when there is none.
        size_bytes: All files together, bytes.
        starred: Somebody wants it kept.
    """

    id: str
    kind: str
    subject: str
    mode: str
    state: str
    begun_unix_s: float
    ended_unix_s: float | None
    pictures: int
    metrics: dict[str, Any]
    thumbnail: str | None
    size_bytes: int
    starred: bool


def read_row(folder: Path) -> RunRow | None:
    """Return the row of a run folder, None when the folder holds no readable run."""
    run = RunFolder(folder)
    state, metrics = run.state(), run.metrics()
    training = read_training(folder) if state is None else None
    if state is None and training is None:
        return None
    size_bytes, newest_unix_s = _measure(folder)
    images = sorted(p.name for p in _entries(folder / "images") if p.suffix.lower() in _PICTURES)
    figures = {k: v for k, v in (metrics or {}).items() if k in _FIGURES and _is_number(v)}
    shown = ["preview.jpg"] if (folder / "preview.jpg").is_file() else []
    shown += [f"images/{name}" for name in images[:1]]
    try:
        if training is not None:
            told = _training(folder, training, newest_unix_s)
        else:
            told = _capture(state or {}, newest_unix_s)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
        return None  # JSON, but no run.
    kind, subject, mode, word, begun_unix_s, ended_unix_s = told
    trained_on = (metrics or {}).get("images")
    return RunRow(
        id=folder.name,
        kind=kind,
        subject=_text(subject, 200),
        mode=_text(mode, 32),
        state=_text(word, 16),
        begun_unix_s=begun_unix_s,
        ended_unix_s=ended_unix_s,
        pictures=len(images) if images or not isinstance(trained_on, int) else trained_on,
        metrics=figures,
        thumbnail=shown[0] if shown else None,
        size_bytes=size_bytes,
        starred=is_starred(folder),
    )


def changed_unix_s(folder: Path) -> float:
    """Return when a file in a run folder was last changed, seconds since 1970 (UTC)."""
    return _measure(folder)[1]


_Told = tuple[str, str, str, str, float, float | None]


def _capture(state: dict[str, Any], newest_unix_s: float) -> _Told:
    status, request = state["status"], state["request"]
    word = str(status["state"])
    if word in UNFINISHED and time.time() - newest_unix_s > SILENCE_S:
        word = "interrupted"
    begun = datetime.fromisoformat(state["started_at"]).timestamp()
    ended = None if word in UNFINISHED else datetime.fromisoformat(status["at"]).timestamp()
    return "capture", str(request["name"]), str(request["mode"]), word, begun, ended


def _training(folder: Path, training: Training, newest_unix_s: float) -> _Told:
    stamp = begun_at(folder.name)
    wall_s = (training.metrics or {}).get("wall_s", 0.0)
    begun = newest_unix_s - (float(wall_s) if _is_number(wall_s) else 0.0)
    if stamp is not None:
        begun = min(stamp.timestamp(), newest_unix_s)
    word = _training_state(folder, training, newest_unix_s)
    ended = None if word in UNFINISHED else newest_unix_s
    return "training", Path(training.dataset).name, "", word, begun, ended


def _training_state(folder: Path, training: Training, newest_unix_s: float) -> str:
    if training.finished:
        return "succeeded"
    if training.stopped:
        return "cancelled"
    if training.error is not None:
        return "failed"
    return "running" if is_trained_now(folder, newest_unix_s) else "interrupted"


def _measure(folder: Path) -> tuple[int, float]:
    """Return the size of all files and the time of the newest change."""
    size_bytes, newest_unix_s = 0, 0.0
    for inside, _, names in os.walk(folder):
        for name in names:
            try:
                found = os.lstat(os.path.join(inside, name))
            except OSError:
                continue  # It went away meanwhile, as temporary files do.
            size_bytes += found.st_size
            if name != STAR:
                newest_unix_s = max(newest_unix_s, found.st_mtime)
    return size_bytes, newest_unix_s


def _entries(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def _is_number(value: Any) -> bool:
    """Return whether every database can hold ``value``: some know no NaN in JSON."""
    return type(value) in (int, float) and math.isfinite(value)


def _text(text: str, longest: int) -> str:
    """Return ``text`` as every database can hold it: no NUL, no half of a surrogate pair."""
    return text.replace("\0", "").encode("utf-8", "ignore").decode()[:longest]
