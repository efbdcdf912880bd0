"""Reconstructions that were cut off, by what they left in their run folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

# What was wanted, and the field with all that its training needs; both go when the run is finished.
WANTED, STATE = "training.json", "training.npz"


def unfinished(run: Path) -> tuple[dict[str, Any], int]:
    """Return parameters and seed of the reconstruction that was cut off in ``run``.

    Raises:
        ValueError: If nothing was, or the folder does not say; in one line.
    """
    if not run.is_dir():
        raise ValueError(f"{run} is no folder")
    try:
        if (run / WANTED).is_file():
            told = json.loads((run / WANTED).read_text())
            return told["parameters"] | {"resume": True}, int(told["seed"])
        if (run / "checkpoint.npz").is_file():
            raise ValueError("it is finished")
        # A capture that was cut off before any training began.
        request = json.loads((run / "capture.json").read_text())["request"]
        if not request["train_seconds"] > 0:
            raise ValueError("none was ordered")
        if not (run / "transforms.json").is_file():
            raise ValueError("no picture was taken")
        parameters = {
            "source": "flight",
            "dataset": str(run),
            "train_seconds": float(request["train_seconds"]),
            "mode": request["mode"],
            "resume": True,
        }
        return parameters, int(request["seed"])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{run} has no training to go on with: {error}") from error
