"""Deleting runs together with what is nothing without them."""

from __future__ import annotations

import shutil
from pathlib import Path

from server.store.row import UNFINISHED, read_row
from server.store.runs import doom_run
from server.store.trainings import trainings_on


class StillTrainedError(Exception):
    """Somebody trains in a folder that shall be deleted; nothing was. The text names the run."""


def doom_training(folder: Path) -> Path:
    """Take a training anew out of the library; returns the folder that is left to delete.

    Raises:
        OSError: If it cannot be renamed.
        StillTrainedError: If somebody trains in it.
        ValueError: If it holds no run.
    """
    _refuse_busy(folder)
    return doom_run(folder)


def delete_with_trainings(run: Path) -> None:
    """Delete a run folder and those of the fields trained anew on its pictures.

    All are out of the library before the first file is deleted, which may take seconds.

    Raises:
        OSError: If something cannot be deleted; what could be is gone.
        StillTrainedError: If somebody trains on it.
        ValueError: If the folder holds no run.
    """
    trainings = trainings_on(run)
    for folder in trainings:
        _refuse_busy(folder)
    for doomed in [doom_run(folder) for folder in (*trainings, run)]:
        shutil.rmtree(doomed)


def _refuse_busy(folder: Path) -> None:
    row = read_row(folder)
    if row is not None and row.state in UNFINISHED:
        raise StillTrainedError(f"the training {row.id} is not over; wait for its end or cancel it")
