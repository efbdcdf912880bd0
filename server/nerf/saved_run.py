"""Opens the field of a finished run folder again."""

from __future__ import annotations

import json
from pathlib import Path

from server.nerf.dataset import Dataset, load_dataset
from server.nerf.training import Trainer

CHECKPOINT = "checkpoint.npz"


class SavedRunError(ValueError):
    """A folder holds no field that could be opened; the message says why in one line."""


def open_dataset(run: Path) -> Dataset:
    """Return the pictures that the field of a run folder was trained on.

    They lie in the folder itself after a flight, and where ``metrics.json`` says after a training.

    Raises:
        SavedRunError: If the folder is no run, or tells of no pictures.
        DatasetError: If the pictures are gone or broken.
    """
    try:
        about = json.loads((run / "metrics.json").read_text())
        folder = run if (run / "transforms.json").is_file() else Path(about["dataset"])
        downscale, object_only = about.get("downscale"), bool(about.get("object_only", False))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SavedRunError(f"{run} is no run with a finished field: {error}") from error
    return load_dataset(folder, downscale=downscale, object_only=object_only)


def open_field(run: Path, dataset: Dataset, threads: int) -> Trainer:
    """Return the field of a run folder, trained on ``dataset``; it renders.

    Raises:
        SavedRunError: If there is no checkpoint, or not one of these pictures.
    """
    try:
        return Trainer.load(run / CHECKPOINT, dataset, threads=threads)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SavedRunError(f"{run / CHECKPOINT} cannot be opened: {error}") from error
