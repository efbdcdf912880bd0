"""A finished run made larger or smaller: everything in it that is measured in metres.

Poses, the object's box, the points that were seen, the field's own cube and the mesh; not the
recording and not what the flight believed, which stay as they were.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import trimesh

from server.nerf.sightings import FILE as SIGHTINGS
from server.nerf.sightings import read_sightings, write_sightings

SCALE = "scale.json"
_TRANSFORMS, _POSES, _CHECKPOINT, _MESH = (
    "transforms.json",
    "poses.json",
    "checkpoint.npz",
    "mesh.glb",
)


def rescale_run(run: Path, factor: float, about: dict[str, Any]) -> None:
    """Multiply all lengths of a run folder by ``factor`` and note it in ``scale.json``.

    Drafts of all files are written before the first takes its place, so a full disk changes
    nothing. Files that a run lacks are left out.

    Args:
        run: The run folder.
        factor: Old metres times this are new ones.
        about: What else to note.

    Raises:
        OSError: If a file cannot be read or written.
        ValueError: If one makes no sense; nothing is changed then.
    """
    if not (np.isfinite(factor) and factor > 0.0):
        raise ValueError(f"a scale must be positive, not {factor}")
    makers: list[tuple[str, Callable[[BinaryIO], None]]] = []
    # The poses come last: whatever takes its place before them fits either.
    if (run / _MESH).is_file():
        makers.append((_MESH, lambda stream: _scaled_mesh(run / _MESH, factor, stream)))
    if (run / _CHECKPOINT).is_file():
        makers.append(
            (_CHECKPOINT, lambda stream: _scaled_field(run / _CHECKPOINT, factor, stream))
        )
    if (run / _POSES).is_file():
        makers.append((_POSES, _as_json(_scaled_sigmas(_read(run / _POSES), factor))))
    makers.append((SCALE, _as_json({"factor": _factor_so_far(run) * factor, **about})))
    if (run / _TRANSFORMS).is_file():
        makers.append((_TRANSFORMS, _as_json(_scaled_poses(_read(run / _TRANSFORMS), factor))))
    drafts: list[Path] = []
    try:
        for name, make in makers:
            draft = run / f"{name}.part"
            drafts.append(draft)
            with draft.open("wb") as stream:
                make(stream)
                stream.flush()
                os.fsync(stream.fileno())
        if (run / SIGHTINGS).is_file():
            seen = read_sightings(run)
            write_sightings(run, replace(seen, points_world=factor * seen.points_world))
        for (name, _), draft in zip(makers, drafts, strict=True):
            draft.replace(run / name)
    finally:
        for draft in drafts:
            draft.unlink(missing_ok=True)


def runs_trained_on(run: Path) -> list[Path]:
    """Return the runs beside ``run`` whose fields were trained on its pictures."""
    found: list[Path] = []
    for metrics in sorted(run.parent.glob("*/metrics.json")):
        try:
            dataset = Path(_read(metrics)["dataset"])
        except (OSError, ValueError, KeyError, TypeError):
            continue
        if metrics.parent.resolve() != run.resolve() and dataset.resolve() == run.resolve():
            found.append(metrics.parent)
    return found


def _factor_so_far(run: Path) -> float:
    return float(_read(run / SCALE)["factor"]) if (run / SCALE).is_file() else 1.0


def _scaled_poses(description: dict[str, Any], factor: float) -> dict[str, Any]:
    for frame in description["frames"]:
        T = np.array(frame["transform_matrix"], float)
        T[:3, 3] *= factor
        frame["transform_matrix"] = T.tolist()
    if description.get("object_box") is not None:
        description["object_box"] = (factor * np.array(description["object_box"], float)).tolist()
    if description.get("floor_z") is not None:
        description["floor_z"] = factor * float(description["floor_z"])
    return description


def _scaled_sigmas(about: dict[str, Any], factor: float) -> dict[str, Any]:
    for picture in about.get("pictures", []):
        picture["sigma_m"] = round(factor * float(picture["sigma_m"]), 5)
    return about


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
    assert isinstance(mesh, trimesh.Trimesh)
    mesh.apply_scale(factor)
    stream.write(mesh.export(file_type="glb"))


def _read(path: Path) -> dict[str, Any]:
    try:
        about = json.loads(path.read_text())
    except ValueError as error:
        raise ValueError(f"{path} is not readable JSON: {error}") from error
    if not isinstance(about, dict):
        raise ValueError(f"{path} is not a JSON object")
    return about


def _as_json(about: dict[str, Any]) -> Callable[[BinaryIO], None]:
    data = json.dumps(about, indent=1).encode()

    def write(stream: BinaryIO) -> None:
        stream.write(data)

    return write
