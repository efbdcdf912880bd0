"""The job behind ``dronerf render``: pictures of a finished field, as a film or beside its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from pydantic import BaseModel

from server.jobs.reports import tell_share
from server.jobs.results import FILM, bounds
from server.jobs.spec import JobSpec
from server.jobs.worker import Reporter
from server.nerf.dataset import Dataset
from server.nerf.orbit import render_orbit
from server.nerf.saved_run import open_dataset, open_field
from server.nerf.surface import extract_surface
from server.nerf.training import Trainer

# Coarse is enough to know how large the object is.
_BOUNDS_CELLS = 64


class RenderInput(BaseModel):
    """What is to be rendered.

    Attributes:
        run: The run folder.
        film: The MP4 file to make, None for pictures instead.
        pictures: Folder for the photographs beside renderings, None for a film.
        room: Film all that there is, not the object alone.
        seconds: Length of the film.
        fps: Its pictures per second.
        width: Of its pictures, pixels.
        height: Likewise.
    """

    run: Path
    film: Path | None = None
    pictures: Path | None = None
    room: bool = False
    seconds: float = 4.0
    fps: int = 15
    width: int = 400
    height: int = 300


def run(spec: JobSpec, reporter: Reporter) -> dict[str, Any]:
    """Render and return what was made; raises ValueError on bad input."""
    wanted = RenderInput.model_validate(spec.parameters)
    dataset = open_dataset(wanted.run)
    field = open_field(wanted.run, dataset, spec.threads)
    if wanted.pictures is not None:
        return {"file": str(wanted.pictures), **_compare(dataset, field, wanted.pictures, reporter)}
    film = wanted.film or wanted.run / FILM
    around = None
    if not wanted.room:
        tell = tell_share(reporter, "mesh", len(dataset))
        around = bounds(extract_surface(field, _BOUNDS_CELLS, tell))
    whole = render_orbit(
        field,
        film,
        around=around,
        frames=round(wanted.seconds * wanted.fps),
        fps=wanted.fps,
        width=wanted.width,
        height=wanted.height,
        on_progress=tell_share(reporter, "film", len(dataset)),
        should_stop=reporter.should_stop,
    )
    if not whole:
        raise ValueError("stopped before the film was whole")
    return {"file": str(film), "bytes": film.stat().st_size}


def _compare(dataset: Dataset, field: Trainer, folder: Path, reporter: Reporter) -> dict[str, Any]:
    """Write each picture of the dataset beside what the field shows from its camera."""
    folder.mkdir(parents=True, exist_ok=True)
    tell = tell_share(reporter, "pictures", len(dataset))
    for index, file in enumerate(dataset.files):
        if reporter.should_stop():
            raise ValueError("stopped before all pictures were rendered")
        shown = field.render(dataset.intrinsics[index], dataset.T_world_cam[index]).rgb
        rendered = np.round(np.clip(shown, 0.0, 1.0) * 255.0).astype(np.uint8)
        both = np.hstack([dataset.images[index], rendered])[:, :, ::-1]
        _, jpeg = cv2.imencode(".jpg", both)
        (folder / f"{file.stem}.jpg").write_bytes(jpeg.tobytes())
        tell((index + 1) / len(dataset))
    return {"pictures": len(dataset)}
