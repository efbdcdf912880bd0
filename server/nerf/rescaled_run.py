"""Finished runs made larger or smaller: everything in them that is measured in metres.

Poses, the object's box, the points that were seen, the field's own cube and the mesh. The recording
and what the flight believed stay as they were, and so do files that were exported before.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh

from server.drafts import draft_of
from server.nerf.sightings import FILE as SIGHTINGS
from server.nerf.sightings import draft_sightings, read_sightings

SCALE = "scale.json"
_TRANSFORMS, _POSES, _CHECKPOINT, _MESH = (
    "transforms.json",
    "poses.json",
    "checkpoint.npz",
    "mesh.glb",
)

_Make = Callable[[BinaryIO], None]


def rescale_runs(runs: Sequence[Path], factor: float, about: dict[str, Any]) -> None:
    """Multiply all lengths of some run folders by ``factor`` and note it in their ``scale.json``.

    Drafts of all files of all runs are written before the first takes its place: a full disk or a
    damaged file changes nothing. Files that a run lacks are left out.

    Args:
        runs: The run folders.
        factor: Old metres times this are new ones.
        about: What else to note.

    Raises:
        OSError: If a file cannot be read or written.
        ValueError: If one makes no sense; the message names it.
    """
    if not (np.isfinite(factor) and factor > 0.0):
        raise ValueError(f"a scale must be positive, not {factor}")
    drafts: dict[Path, Path] = {}  # By the file whose place each takes.
    try:
        for run in runs:
            for file, make in _makers(run, factor, about):
                drafts[file] = draft_of(file)
                with drafts[file].open("wb") as stream:
                    _made(file, make, stream)
                    stream.flush()
                    os.fsync(stream.fileno())
        for file, draft in drafts.items():
            draft.replace(file)
    finally:
        for draft in drafts.values():
            draft.unlink(missing_ok=True)


def _made(file: Path, make: _Make, stream: BinaryIO) -> None:
    try:
        make(stream)
    except (EOFError, KeyError, TypeError, AttributeError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(f"{file} makes no sense: {error}") from error


def _makers(run: Path, factor: float, about: dict[str, Any]) -> Iterator[tuple[Path, _Make]]:
    """Yield each file of a run that has metres in it, with what writes it anew."""
    scaled: dict[str, Callable[[Path, float, BinaryIO], None]] = {
        _MESH: _scaled_mesh,
        _CHECKPOINT: _scaled_field,
        SIGHTINGS: _scaled_sightings,
        _POSES: _scaled_sigmas,
        _TRANSFORMS: _scaled_poses,
    }
    for name, write in scaled.items():
        file = run / name
        if file.is_file():
            yield file, lambda stream, file=file, write=write: write(file, factor, stream)
    yield run / SCALE, lambda stream: _noted(run / SCALE, factor, about, stream)


def _noted(path: Path, factor: float, about: dict[str, Any], stream: BinaryIO) -> None:
    before = float(_read(path)["factor"]) if path.is_file() else 1.0
    _write_json({"factor": before * factor, **about}, stream)


def _scaled_poses(path: Path, factor: float, stream: BinaryIO) -> None:
    description = _read(path)
    for frame in description["frames"]:
        T = np.array(frame["transform_matrix"], float)
        T[:3, 3] *= factor
        frame["transform_matrix"] = T.tolist()
    if description.get("object_box") is not None:
        description["object_box"] = (factor * np.array(description["object_box"], float)).tolist()
    if description.get("floor_z") is not None:
        description["floor_z"] = factor * float(description["floor_z"])
    _write_json(description, stream)


def _scaled_sigmas(path: Path, factor: float, stream: BinaryIO) -> None:
    about = _read(path)
    for picture in about["pictures"]:
        picture["sigma_m"] = round(factor * float(picture["sigma_m"]), 5)
    _write_json(about, stream)


def _scaled_sightings(path: Path, factor: float, stream: BinaryIO) -> None:
    seen = read_sightings(path.parent)
    draft_sightings(replace(seen, points_world=factor * seen.points_world), stream)


def _scaled_field(path: Path, factor: float, stream: BinaryIO) -> None:
    """Write the checkpoint with its cube scaled: the field itself is in units of that cube."""
    with path.open("rb") as source, np.load(source) as stored:
        arrays = {name: stored[name] for name in stored.files}
    about = json.loads(str(arrays["about"]))
    about["centre"] = (factor * np.array(about["centre"], float)).tolist()
    about["half_size"] = factor * float(about["half_size"])
    arrays["about"] = np.array(json.dumps(about))
    np.savez(stream, allow_pickle=False, **arrays)


def _scaled_mesh(path: Path, factor: float, stream: BinaryIO) -> None:
    mesh = trimesh.load(path, force="mesh")
    if not isinstance(mesh, trimesh.Trimesh):
        raise ValueError("it holds no triangles")
    mesh.apply_scale(factor)
    data = mesh.export(file_type="glb")
    assert isinstance(data, bytes)
    stream.write(data)


def _read(path: Path) -> dict[str, Any]:
    about = json.loads(path.read_text())
    if not isinstance(about, dict):
        raise ValueError("it is not a JSON object")
    return about


def _write_json(about: dict[str, Any], stream: BinaryIO) -> None:
    stream.write(json.dumps(about, indent=1).encode())
