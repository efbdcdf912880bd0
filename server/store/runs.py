"""Run folders: one folder per capture, the truth about it, readable without this program.

``capture.json`` (what was asked, how far it came), ``images/`` and ``masks/`` (the dataset),
``keyframes/`` (pictures between them), ``pictures.jsonl`` (their believed poses),
``transforms.json`` (what instant-ngp and nerfstudio open), ``sightings.npz`` (points that its
pictures share), ``poses.json``, ``scale.json`` (where a known length set it), ``metrics.json``,
``log.jsonl``, ``checkpoint.npz``, ``preview.jpg``.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Container, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.nerf.dataset import PosedFile, write_transforms
from server.nerf.flight import FlightPicture, append_picture, read_pictures
from server.stages import Capture, Region
from server.store.atomic import write_atomic
from server.vision.region import full_mask

STATE = "capture.json"
# An empty file: somebody wants the run kept.
STAR = "starred"
# A training anew has the first of these from its beginning, or from its end alone.
_TRAINED = ("jobs/reconstruct/spec.json", "training.json", "metrics.json")
_DOOMED = ".deleting-"
_STAMP = "%Y%m%d-%H%M%S"


def run_id(name: str) -> str:
    """Return a run's id: the time now and the words of ``name``, safe as a folder's name."""
    stamp = datetime.now(UTC).strftime(_STAMP)
    words = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40]
    return f"{stamp}-{words}" if words else stamp


def free_run(root: Path, name: str, taken: Container[str] = frozenset()) -> Path:
    """Return where under ``root`` a run of this name may be made; ids in ``taken`` are promised."""
    base = run_id(name)
    for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
        if f"{base}{suffix}" not in taken and not (root / f"{base}{suffix}").exists():
            return root / f"{base}{suffix}"
    raise FileExistsError(f"{root / base} exists a thousand times")


def begun_at(name: str) -> datetime | None:
    """Return when the run of this id was begun, aware UTC; None where the id does not tell."""
    try:
        return datetime.strptime("-".join(name.split("-")[:2]), _STAMP).replace(tzinfo=UTC)
    except ValueError:
        return None


class RunFolder:
    """One run's folder.

    Attributes:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, root: Path, name: str) -> RunFolder:
        """Make a new folder under ``root``, named by time and the words of ``name``."""
        base = run_id(name)
        for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
            path = root / f"{base}{suffix}"
            try:
                path.mkdir(parents=True)
            except FileExistsError:
                continue
            for folder in ("images", "masks", "keyframes"):
                (path / folder).mkdir()
            return cls(path)
        raise FileExistsError(f"{root / base} exists a thousand times")

    @property
    def id(self) -> str:
        """The capture's id: the folder's name."""
        return self.path.name

    def write_state(self, state: dict[str, Any]) -> None:
        """Replace ``capture.json``."""
        write_atomic(self.path / STATE, json.dumps(state, indent=1).encode())

    def state(self) -> dict[str, Any] | None:
        """Return ``capture.json``, None when there is none or it is unreadable."""
        return _read_json(self.path / STATE)

    def metrics(self) -> dict[str, Any] | None:
        """Return ``metrics.json``, None while there is none."""
        return _read_json(self.path / "metrics.json")

    def add_still(
        self, capture: Capture, jpeg: bytes, region: Region | None, object_box: Box3 | None
    ) -> None:
        """Put a picture of the dataset, its mask and its pose on disk.

        Args:
            capture: The picture; its ``file`` says where it goes.
            jpeg: Its bytes.
            region: The object's region in it, for the mask.
            object_box: The object's outer box, world, once known.
        """
        write_atomic(self.path / capture.file, jpeg)
        mask = None
        if region is not None:
            mask = f"masks/{Path(capture.file).stem}.png"
            write_atomic(self.path / mask, _mask_png(region, capture.intrinsics))
        append_picture(
            self.path,
            FlightPicture(
                file=capture.file,
                mask=mask,
                still=True,
                drone_id=capture.pose.drone_id,
                at_s=capture.pose.at_s,
                round_index=capture.round_index,
                T_world_cam=capture.pose.T_world_cam,
                sigma_m=capture.pose.position_sigma_m,
                sigma_rad=float(np.sqrt(capture.pose.covariance[3, 3])),
                sharpness=capture.sharpness,
            ),
        )
        self.write_transforms(capture.intrinsics, object_box)

    def add_keyframe(self, picture: FlightPicture, jpeg: bytes) -> None:
        """Put a key frame and its pose on disk."""
        write_atomic(self.path / picture.file, jpeg)
        append_picture(self.path, picture)

    def write_transforms(self, intrinsics: Intrinsics, object_box: Box3 | None) -> None:
        """Write ``transforms.json`` with the poses believed in flight."""
        stills = [p for p in read_pictures(self.path) if p.still]
        write_transforms(
            self.path,
            [PosedFile(p.file, p.T_world_cam, p.mask) for p in stills],
            intrinsics,
            object_box,
        )

    def log(self, lines: Iterable[dict[str, Any]]) -> None:
        """Append ``lines`` to ``log.jsonl``."""
        with (self.path / "log.jsonl").open("a") as stream:
            stream.writelines(json.dumps(line) + "\n" for line in lines)


def is_run(root: Path, name: str) -> bool:
    """Return whether ``name`` is that of a folder under ``root`` in which a field is trained."""
    return Path(name).name == name and is_trained(root / name)


def is_trained(folder: Path) -> bool:
    """Return whether ``folder`` is one in which a field is or was trained, and can be seen."""
    if folder.name.startswith(".") or folder.is_symlink():
        return False
    return any((folder / name).is_file() for name in _TRAINED)


def list_runs(root: Path) -> list[RunFolder]:
    """Return the run folders under ``root`` that hold a ``capture.json``, newest first."""
    if not root.is_dir():
        return []
    told = (path.parent for path in root.glob(f"*/{STATE}"))
    found = [RunFolder(folder) for folder in told if not folder.name.startswith(".")]
    return sorted(found, key=lambda run: run.id, reverse=True)


def is_starred(folder: Path) -> bool:
    """Return whether somebody wants a run kept."""
    return (folder / STAR).exists()


def star_run(folder: Path, starred: bool) -> None:
    """Mark a run to be kept, or no longer: retention never takes one that is marked.

    Raises:
        FileNotFoundError: If the folder is gone.
    """
    if starred:
        write_atomic(folder / STAR, b"")
    else:
        (folder / STAR).unlink(missing_ok=True)


def delete_run(folder: Path) -> None:
    """Delete a run folder for good.

    It is renamed first, which happens at once or not at all: a deletion that is broken off leaves
    no half run, only a hidden folder that ``clear_deleted`` takes away.

    Raises:
        OSError: If something in it cannot be deleted; what could be is gone.
        ValueError: If the folder holds no run.
    """
    shutil.rmtree(doom_run(folder))


def doom_run(folder: Path) -> Path:
    """Take a run out of the library at once; returns the hidden folder that is left to delete.

    Raises:
        OSError: If it cannot be renamed.
        ValueError: If the folder holds no run.
    """
    told = any((folder / name).is_file() for name in (STATE, *_TRAINED))
    if folder.is_symlink() or not told:
        raise ValueError(f"{folder} holds no run")
    doomed = folder.with_name(f"{_DOOMED}{folder.name}")
    folder.rename(doomed)
    return doomed


def clear_deleted(root: Path) -> None:
    """End the deletions under ``root`` that were broken off."""
    for doomed in root.glob(f"{_DOOMED}*"):
        if doomed.is_dir() and not doomed.is_symlink():
            shutil.rmtree(doomed, ignore_errors=True)


def _mask_png(region: Region, intrinsics: Intrinsics) -> bytes:
    mask = full_mask(region, intrinsics.width, intrinsics.height)
    _, png = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    return png.tobytes()


def _read_json(path: Path) -> dict[str, Any] | None:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):  # Also what is no UTF-8.
        return None
