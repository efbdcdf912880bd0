"""What a training leaves behind while it runs, so that it goes on after a kill or a power cut.

``training.json`` says what was wanted, ``training.npz`` is the field with all that training needs;
both are gone once the run is finished.
"""

from __future__ import annotations

import json
import logging
import time
from pathlib import Path
from typing import Any

from server.drafts import drafted
from server.jobs.unfinished import STATE, WANTED
from server.nerf.dataset import Dataset
from server.nerf.training import Trainer

# So much training is lost at most. Writing takes some 0.1 s.
_EVERY_S = 10.0


class KeptTraining:
    """The kept state of the training in one run folder.

    Args:
        out: The run folder; it exists.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._kept_s = time.monotonic()

    def begin(self, wanted: dict[str, Any], seed: int) -> None:
        """Note what is wanted, before there is any state."""
        self._write(WANTED, {"seed": seed, "parameters": wanted})
        self._kept_s = time.monotonic()

    def keep(self, trainer: Trainer, *, now: bool = False) -> None:
        """Keep the state when it is time, or ``now``; on a full disk the one before is kept."""
        if not now and time.monotonic() - self._kept_s < _EVERY_S:
            return
        try:
            trainer.save(self._out / STATE, resumable=True)
        except OSError as error:
            # Training needs no disk until its end, and by then there may be room.
            logging.getLogger(__name__).warning("%s is not kept: %s", STATE, error)
        self._kept_s = time.monotonic()

    def load(self, dataset: Dataset, threads: int) -> Trainer | None:
        """Return the training where it was, None when none was kept or not of these pictures."""
        try:
            return Trainer.load(self._out / STATE, dataset, threads=threads)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def end(self) -> None:
        """Forget it: the run is finished."""
        for name in (STATE, WANTED):
            (self._out / name).unlink(missing_ok=True)

    def _write(self, name: str, about: dict[str, Any]) -> None:
        with drafted(self._out / name) as draft:
            draft.write_text(json.dumps(about, indent=1))
