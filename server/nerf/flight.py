"""The pictures of a flight as they lie in a run folder, one JSON line each in ``pictures.jsonl``.

The mission appends a line the moment a picture is on disk; the reconstruction reads them, also
while the flight goes on. *Stills* are the pictures of the dataset; *key frames* were saved on the
way between them and only help to find the poses.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

_FILE = "pictures.jsonl"


@dataclass(frozen=True, slots=True, eq=False)
class FlightPicture:
    """One picture and where its camera was believed to be when it was taken.

    Attributes:
        file: Path relative to the run folder.
        mask: Path of the object's mask (white is object), None when there is none.
        still: True for a picture of the dataset, False for a key frame.
        drone_id: Which drone took it.
        at_s: Monotonic time of the picture in the process that took it.
        round_index: Round of the mission.
        T_world_cam: Believed pose ``(4, 4)``.
        sigma_m: Believed position uncertainty per axis.
        sigma_rad: Believed heading uncertainty.
        sharpness: See ``vision.sharpness``; None for key frames and pictures of earlier versions.
    """

    file: str
    mask: str | None
    still: bool
    drone_id: str
    at_s: float
    round_index: int
    T_world_cam: NDArray[np.float64]
    sigma_m: float
    sigma_rad: float
    sharpness: float | None = None


def append_picture(folder: Path, picture: FlightPicture) -> None:
    """Append ``picture`` to the folder's list; it is on disk when this returns."""
    line = json.dumps(
        {
            "file": picture.file,
            "mask": picture.mask,
            "still": picture.still,
            "drone_id": picture.drone_id,
            "at_s": picture.at_s,
            "round_index": picture.round_index,
            "T_world_cam": picture.T_world_cam.tolist(),
            "sigma_m": picture.sigma_m,
            "sigma_rad": picture.sigma_rad,
            "sharpness": picture.sharpness,
        }
    )
    with (folder / _FILE).open("a") as stream:
        stream.write(line + "\n")
        stream.flush()
        os.fsync(stream.fileno())


def read_pictures(folder: Path) -> list[FlightPicture]:
    """Return all pictures listed so far, in order of taking; a torn last line is left out."""
    path = folder / _FILE
    if not path.exists():
        return []
    pictures: list[FlightPicture] = []
    for line in path.read_text().split("\n")[:-1]:
        try:
            fields = json.loads(line)
        except json.JSONDecodeError:
            continue
        fields["T_world_cam"] = np.array(fields["T_world_cam"], float)
        pictures.append(FlightPicture(**fields))
    return pictures
