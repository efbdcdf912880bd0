"""The job behind ``dronerf export``: a finished run as other programs open it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel

from server.jobs.reports import tell_share
from server.jobs.results import MESH
from server.jobs.spec import JobSpec
from server.jobs.worker import Reporter
from server.nerf.dataset import Dataset
from server.nerf.exports import write_colmap, write_mesh, write_points
from server.nerf.saved_run import open_dataset, open_field
from server.nerf.sightings import FILE as SIGHTINGS
from server.nerf.surface import CELLS, extract_surface

ExportFormat = Literal["glb", "ply", "points", "colmap", "transforms"]

# What each is called in the run folder.
NAMES: dict[str, str] = {
    "glb": MESH,
    "ply": "mesh.ply",
    "points": "points.ply",
    "colmap": "colmap",
    "transforms": "dataset",
}


class ExportInput(BaseModel):
    """What is to be exported.

    Attributes:
        run: The run folder.
        format: How.
        out: File or folder to make; in the run folder, named by its kind, when None.
        cells: Cells of the mesh along the longest side of the object's box.
    """

    run: Path
    format: ExportFormat = "glb"
    out: Path | None = None
    cells: int = CELLS


def run(spec: JobSpec, reporter: Reporter) -> dict[str, Any]:
    """Export and return what was made; raises ValueError on bad input."""
    wanted = ExportInput.model_validate(spec.parameters)
    made = wanted.out or wanted.run / NAMES[wanted.format]
    if wanted.format in ("glb", "ply") and made.suffix != f".{wanted.format}":
        raise ValueError(f"the file's name must end in .{wanted.format}, not {made.name}")
    dataset = open_dataset(wanted.run)
    about: dict[str, Any] = {"file": str(made), "format": wanted.format}
    if wanted.format == "transforms":
        return about | {"pictures": _copy(dataset, made)}
    field = open_field(wanted.run, dataset, spec.threads)
    surface = extract_surface(field, wanted.cells, tell_share(reporter, "surface", len(dataset)))
    match wanted.format:
        case "points":
            write_points(surface.vertices, surface.colours, made)
        case "colmap":
            write_colmap(dataset, surface.vertices, surface.colours, made)
        case _:
            write_mesh(surface, made)
    return about | {"vertices": len(surface.vertices), "faces": len(surface.faces)}


def _copy(dataset: Dataset, folder: Path) -> int:
    """Copy a dataset, its description, pictures and masks; return how many pictures it has."""
    if folder.resolve() == dataset.folder.resolve():
        raise ValueError(f"{folder} is the dataset itself")
    description = (dataset.folder / "transforms.json").read_text()
    masks = [frame.get("mask_path") for frame in json.loads(description)["frames"]]
    for source in (*dataset.files, *(dataset.folder / mask for mask in masks if mask)):
        if not source.is_relative_to(dataset.folder):
            raise ValueError(f"{source} lies outside {dataset.folder}")
        target = folder / source.relative_to(dataset.folder)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    if (dataset.folder / SIGHTINGS).is_file():
        shutil.copyfile(dataset.folder / SIGHTINGS, folder / SIGHTINGS)
    (folder / "transforms.json").write_text(description)
    return len(dataset)
