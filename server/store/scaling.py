"""Setting a run's scale by one length that somebody knows."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from server.nerf.dataset import load_dataset
from server.nerf.pose_scale import KnownScale, Mark, scale_from_length
from server.nerf.rescaled_run import rescale_runs
from server.store.trainings import read_training, trainings_on

# Number of the picture, and x and y in its pixels.
PlacedMark = tuple[int, float, float]


class ScaleUnknownError(ValueError):
    """The marks tell no scale; the message says why in one line."""


def scale_by_length(
    run: Path,
    ends: tuple[Sequence[PlacedMark], Sequence[PlacedMark]],
    length_m: float,
    length_sigma_m: float,
) -> KnownScale:
    """Make a run, and the fields trained anew on it, as large as a known length says.

    Args:
        run: The run folder; nobody else works on it.
        ends: Marks of either end of the length, in two pictures or more each.
        length_m: How far apart they really are.
        length_sigma_m: How well that is known, standard deviation.

    Raises:
        ScaleUnknownError: If the marks tell no scale; nothing is changed.
        DatasetError: If the run has no pictures with poses.
        OSError: If a file cannot be changed; nothing is changed then.
        ValueError: If one is damaged; nothing is changed then.
    """
    seen = load_dataset(run, downscale=1)
    for picture, _, _ in (*ends[0], *ends[1]):
        if picture >= len(seen):
            raise ScaleUnknownError(f"there is no picture {picture}")
    first, second = ([Mark(k, np.array([x, y])) for k, x, y in end] for end in ends)
    try:
        found = scale_from_length(
            (first, second),
            length_m,
            seen.T_world_cam,
            seen.intrinsics,
            length_sigma_m=length_sigma_m,
        )
    except ValueError as error:
        raise ScaleUnknownError(str(error)) from error
    about = {
        "sigma": found.sigma,
        "measured_m": found.measured_m,
        "length_m": length_m,
        "at": datetime.now(UTC).isoformat(),
    }
    anew = [folder for folder in trainings_on(run) if _is_judged(folder)]
    rescale_runs((*anew, run), found.factor, about)
    return found


def _is_judged(folder: Path) -> bool:
    training = read_training(folder)
    return training is not None and training.metrics is not None
