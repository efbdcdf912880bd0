"""Deleting runs together with what is nothing without them."""

from __future__ import annotations

from pathlib import Path

from server.store.row import UNFINISHED, read_row
from server.store.runs import delete_run
from server.store.trainings import trainings_on


def delete_training(folder: Path) -> None:
    """Delete the run folder of a training anew.

    Raises:
        OSError: If something in it cannot be deleted; what could be is gone.
        ValueError: If somebody still trains in it, or it holds no run.
    """
    _refuse_busy(folder)
    delete_run(folder)


def delete_with_trainings(run: Path) -> None:
    """Delete a run folder and before it those of the fields trained anew on its pictures.

    Raises:
        OSError: If something cannot be deleted; what could be is gone.
        ValueError: If somebody still trains on it, or the folder holds no run.
    """
    trainings = trainings_on(run)
    for folder in trainings:
        _refuse_busy(folder)
    for folder in trainings:
        delete_run(folder)
    delete_run(run)


def _refuse_busy(folder: Path) -> None:
    row = read_row(folder)
    if row is not None and row.state in UNFINISHED:
        raise ValueError(f"the training {row.id} is not over")
