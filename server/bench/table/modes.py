"""The four modes: which flight, and with which cameras its pictures are used.

``standard_paper``: the ring, and every picture taken to be where it was to be taken (the paper's
standard placement). ``standard_refined``: the same pictures with our poses. ``optimized``: the
mission as it is. ``optimized_true_poses``: the same pictures, masks and shared points with true
poses and lenses: what is left to gain by knowing the cameras better.

Every mode trains on all of its flight's pictures whose cameras it knows, with all that the mission
knows besides: masks, and the object's box in the frame of its poses.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from server.bench.poses_flight import FlownCapture
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_TILT_RAD
from server.geometry.poses import Similarity, fit_similarity
from server.jobs.reconstruct import refine_run
from server.jobs.spec import JobSpec
from server.mission.commands import Mode
from server.nerf.dataset import Dataset, load_dataset
from server.nerf.flight import read_pictures
from server.nerf.sightings import known_pixels, read_sightings

Array = NDArray[np.float64]

# By flight, in the order of the table. Also the order to take them in: a refinement changes the
# run's folder, so what was to be comes before it, and what it found goes with the truth after it.
MODES: dict[Mode, tuple[str, str]] = {
    "standard": ("standard_paper", "standard_refined"),
    "optimized": ("optimized", "optimized_true_poses"),
}
EVERY_MODE = tuple(mode for modes in MODES.values() for mode in modes)
# A field of fewer pictures than this is trained on all of them, refined or not.
_FEWEST = 4


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A flight's pictures as one mode uses them.

    Attributes:
        dataset: Pictures and cameras, in the frame of the mode's poses.
        used: Which of them the field is trained on.
        T_true: True poses ``(n, 4, 4)`` of all.
    """

    dataset: Dataset
    used: list[int]
    T_true: Array


def posed_as(mode: str, flown: FlownCapture, seed: int, threads: int, without: str = "") -> Posed:
    """Return a flight's pictures as ``mode`` uses them; modes are taken in the order of ``MODES``.

    Args:
        mode: One of ``EVERY_MODE``.
        flown: The flight.
        seed: Of the refinement.
        threads: Cores to use.
        without: ``refinement``: the poses believed in flight; ``masks``: training does not know
            where the object is in the pictures; anything else leaves out nothing here.
    """
    if mode == "standard_paper":
        return standard_paper(flown)
    if mode == "optimized_true_poses":
        return optimized_true_poses(flown)
    if without == "refinement":
        dataset = load_dataset(flown.run)
        return Posed(dataset, list(range(len(dataset))), true_poses(flown))
    posed = refined(flown, seed, threads)
    if without == "masks":
        unmasked = replace(posed.dataset, masks=(None,) * len(posed.dataset))
        return replace(posed, dataset=unmasked)
    return posed


def standard_paper(flown: FlownCapture) -> Posed:
    """Return the pictures at the viewpoints they were to be taken from; before any refinement."""
    nominal = [v.T_world_cam(TELLO_TILT_RAD) for v in flown.sent_to if v is not None]
    dataset = replace(load_dataset(flown.run), T_world_cam=np.stack(nominal))
    return Posed(dataset, list(range(len(dataset))), true_poses(flown))


def refined(flown: FlownCapture, seed: int, threads: int) -> Posed:
    """Refine the poses as after every flight, in the run's folder, and return the pictures."""
    spec = JobSpec("reconstruct", {}, seed=seed, threads=threads)
    poses = refine_run(flown.run, spec, _Silent())
    used = [int(index) for index in np.flatnonzero(poses.refined)]
    dataset = load_dataset(flown.run)
    if len(used) < _FEWEST:
        used = list(range(len(dataset)))
    return Posed(dataset, used, true_poses(flown))


def optimized_true_poses(flown: FlownCapture) -> Posed:
    """Return the pictures with their true poses and lenses, and what else the refinement found."""
    dataset = load_dataset(flown.run)
    T_true = true_poses(flown)
    still = np.flatnonzero([view is not None for view in flown.sent_to])
    cameras = tuple(
        flown.truth[i].lens.scaled(camera.width / flown.truth[i].lens.width)
        for i, camera in zip(still, dataset.intrinsics, strict=True)
    )
    told = json.loads((flown.run / "poses.json").read_text())["pictures"]
    sure = [index for index, picture in enumerate(told) if picture["refined"]]
    sure = sure if len(sure) >= _FEWEST else list(range(len(dataset)))
    to_truth = fit_similarity(dataset.T_world_cam[sure, :3, 3], T_true[sure, :3, 3])
    found = read_sightings(flown.run)
    shared = replace(found, points_world=to_truth.points(found.points_world))
    known = tuple(
        known_pixels(shared, k, flown.truth[i].lens.width, camera, T)
        for k, (i, camera, T) in enumerate(zip(still, cameras, T_true, strict=True))
    )
    box, floor_z = dataset.object_box, dataset.floor_z
    posed = replace(
        dataset,
        T_world_cam=T_true,
        intrinsics=cameras,
        known=known,
        object_box=None if box is None else carried_box(box, to_truth),
        # The room's own floor.
        floor_z=None if floor_z is None else 0.0,
    )
    return Posed(posed, list(range(len(posed))), T_true)


def carried_box(box: Box3, similarity: Similarity) -> Box3:
    """Return ``box`` in another frame: its middle carried, its size scaled, upright as before."""
    centre = similarity.points(box.centre[None])[0]
    half = similarity.scale * box.size / 2.0
    return Box3(centre - half, centre + half)


def true_poses(flown: FlownCapture) -> Array:
    """Return the true poses ``(n, 4, 4)`` of the stills."""
    listed = zip(read_pictures(flown.run), flown.truth, strict=True)
    return np.stack([view.T_world_cam for picture, view in listed if picture.still])


class _Silent:
    """Hears a job and says nothing; a ``Reporting``."""

    def emit(self, event: str, **fields: Any) -> None:
        """Keep nothing."""

    def should_stop(self) -> bool:
        """Return False: nobody asks for the end."""
        return False
