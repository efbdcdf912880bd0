"""Points that pictures were found to share: where surfaces surely are.

Structure from motion triangulates thousands of them while it refines the poses. Few pictures leave
the field free to explain their colours by fog in front of the cameras; a pixel whose distance is
known does not (Deng et al., "Depth-supervised NeRF", 2022). They lie beside ``transforms.json`` in
``sightings.npz``; a dataset that has none is trained without.
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from server.drafts import whole_file
from server.geometry.cameras import Intrinsics, whole_pixels

Array = NDArray[np.float64]

FILE = "sightings.npz"
# A point that the picture's pose puts farther from where it was seen is not believed, as a share
# of the picture's width: somebody has changed the poses, or it was a wrong match.
_FARTHEST_SHARE = 0.004


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Points and the pixels they were seen at.

    Attributes:
        points_world: ``(m, 3)`` metres.
        pictures: Picture of each sighting ``(n,)``, ascending.
        points: Its row of ``points_world`` ``(n,)``.
        pixels: Where ``(n, 2)``, x and y in pixels of the picture on disk.
    """

    points_world: Array
    pictures: NDArray[np.int64]
    points: NDArray[np.int64]
    pixels: Array

    def of(self, pictures: NDArray[np.int64]) -> Sightings:
        """Return the sightings of ``pictures`` ``(k,)``, numbered by their places there."""
        place = np.full(
            max(int(self.pictures.max(initial=0)), int(pictures.max(initial=0))) + 1, -1
        )
        place[pictures] = np.arange(len(pictures))
        numbers = place[self.pictures]
        order = np.argsort(numbers, kind="stable")
        order = order[numbers[order] >= 0]
        used, points = np.unique(self.points[order], return_inverse=True)
        return Sightings(self.points_world[used], numbers[order], points, self.pixels[order])


@dataclass(frozen=True, slots=True, eq=False)
class KnownPixels:
    """Pixels of a picture at which the distance of a surface is known.

    Attributes:
        pixels: Flat places ``(n,)`` int64 in the picture at training size.
        distances_m: From the camera along the ray ``(n,)`` float32.
    """

    pixels: NDArray[np.int64]
    distances_m: NDArray[np.float32]

    def where(self, mask: NDArray[np.bool_]) -> KnownPixels:
        """Return those inside ``mask`` ``(h, w)``."""
        inside = mask.ravel()[self.pixels]
        return KnownPixels(self.pixels[inside], self.distances_m[inside])


def nothing_known() -> KnownPixels:
    """Return that no distance is known."""
    return KnownPixels(np.zeros(0, np.int64), np.zeros(0, np.float32))


def no_sightings() -> Sightings:
    """Return none at all."""
    none = np.zeros(0, np.int64)
    return Sightings(np.zeros((0, 3)), none, none, np.zeros((0, 2)))


def write_sightings(folder: Path, sightings: Sightings) -> None:
    """Write ``folder/sightings.npz`` so that it is complete or untouched, never half."""
    with whole_file(folder / FILE) as stream:
        draft_sightings(sightings, stream)


def draft_sightings(sightings: Sightings, stream: BinaryIO) -> None:
    """Write the content of such a file."""
    np.savez_compressed(
        stream,
        points_world=sightings.points_world.astype(np.float32),
        pictures=sightings.pictures.astype(np.int32),
        points=sightings.points.astype(np.int32),
        pixels=sightings.pixels.astype(np.float32),
    )


def read_sightings(folder: Path) -> Sightings:
    """Return those of a dataset, none when it has no file of them.

    Raises:
        ValueError: If there is one that cannot be read or makes no sense.
    """
    path = folder / FILE
    if not path.is_file():
        return no_sightings()
    try:
        with path.open("rb") as stream, np.load(stream) as stored:
            found = Sightings(
                stored["points_world"].astype(np.float64),
                stored["pictures"].astype(np.int64),
                stored["points"].astype(np.int64),
                stored["pixels"].astype(np.float64),
            )
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path} is not readable: {error}") from error
    count = len(found.pictures)
    whole = (
        found.points_world.ndim == 2
        and found.points_world.shape[1] == 3
        and found.points.shape == (count,)
        and found.pixels.shape == (count, 2)
        and np.all(np.diff(found.pictures) >= 0)
        and np.all((found.points >= 0) & (found.points < len(found.points_world)))
    )
    if not whole:
        raise ValueError(f"{path} is no list of sightings")
    return found


def known_pixels(
    sightings: Sightings,
    picture: int,
    width_px: int,
    camera: Intrinsics,
    T_world_cam: Array,
) -> KnownPixels:
    """Return where the distance of a surface is known in one picture.

    Args:
        sightings: Of all pictures.
        picture: Number of the picture.
        width_px: Its width on disk, pixels.
        camera: Its camera at training size.
        T_world_cam: Its pose ``(4, 4)``.
    """
    rows = slice(*np.searchsorted(sightings.pictures, [picture, picture + 1]))
    points = sightings.points_world[sightings.points[rows]]
    scale = camera.width / width_px
    seen = (sightings.pixels[rows] + 0.5) * scale - 0.5
    pixels, depths = camera.project(points, T_world_cam)
    away = np.linalg.norm(pixels - seen, axis=1)
    x, y = whole_pixels(seen).T
    good = (away <= max(_FARTHEST_SHARE * camera.width, 1.0)) & (depths > 0.0)
    good &= (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    distances = np.linalg.norm(points - T_world_cam[:3, 3], axis=1)
    return KnownPixels(y[good] * camera.width + x[good], distances[good].astype(np.float32))
