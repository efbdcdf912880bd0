"""Camera poses from the pictures themselves, after the capture.

The flight believes its poses to 10-25 cm and a few degrees; a radiance field needs a centimetre
and a fraction of a degree. Structure from motion over the stills and the video pictures between
them recovers the poses up to a similarity, which is then found from what the flight believed. Where
there is too little texture, the object's outlines make the stills agree on one shape instead.
The paper leaves this to COLMAP; here the flight's beliefs choose the pairs, give the scale and
hold the world upright.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import Similarity
from server.nerf.pose_alignment import (
    Beliefs,
    ScaleUnknownError,
    align_to_beliefs,
    carry_corrections,
)
from server.nerf.pose_bundle import Adjusted, adjust
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_floor import on_the_floor
from server.nerf.pose_mapping import Mapper, Model, PosesStoppedError
from server.nerf.pose_outlines import fit_to_outlines
from server.nerf.pose_pairs import choose_pairs
from server.nerf.sightings import Sightings, no_sightings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PosedPicture:
    """A picture on disk and where the flight believed its camera to be.

    Attributes:
        file: The picture.
        T_world_cam: Believed pose ``(4, 4)``.
        sigma_m: Standard deviation of the believed position, metres per axis.
        sigma_rad: Standard deviation of the believed heading, radians.
        still: True for a picture of the dataset, False for a video picture between two of them.
        drone_id: Which drone.
        at_s: When it was taken, seconds of any clock that all pictures share.
        mask_file: Mask of the object, white on black. Texture is used wherever it is, the room
            holds still as well; the outline only where there is too little.
    """

    file: Path
    T_world_cam: Array
    sigma_m: float
    sigma_rad: float
    still: bool
    drone_id: str
    at_s: float
    mask_file: Path | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RefinedPoses:
    """What is known about the poses after refinement.

    Attributes:
        T_world_cam: Best poses ``(n, 4, 4)`` in the order of the pictures.
        refined: Which of them come from the pictures and are known well ``(n,)``; the others are
            flight poses, moved as their drone's refined pictures were and then, where the object's
            outline could be used, to where it agrees with the others; or they belong to a smaller
            reconstruction that only the flight's beliefs tie to the largest.
        sigma_m: How well each position is known ``(n,)``, metres per axis, standard deviation:
            relative to one another for refined ones, in the world for the others.
        sigma_rad: How well each rotation is known ``(n,)``, radians per axis.
        intrinsics: Camera of each picture, with the focal length found for its drone.
        reprojection_rms_px: Root mean square over all observations used, NaN without any.
        sightings: Triangulated points seen in three pictures or more, in the pictures' order.
        floor_z: Height of the floor, on which the world was then set, None when none was found.
        message: One sentence for the operator.
    """

    T_world_cam: Array
    refined: NDArray[np.bool_]
    sigma_m: Array
    sigma_rad: Array
    intrinsics: tuple[Intrinsics, ...]
    reprojection_rms_px: float
    sightings: Sightings
    floor_z: float | None
    message: str


def _check(pictures: Sequence[PosedPicture], intrinsics: Sequence[Intrinsics]) -> None:
    """Raise ``ValueError`` unless the pictures can be read and fit their cameras."""
    if len(pictures) < 2:
        raise ValueError(f"refining poses needs at least two pictures, got {len(pictures)}")
    if len(intrinsics) != len(pictures):
        raise ValueError(f"{len(intrinsics)} intrinsics for {len(pictures)} pictures")
    if len({p.file.resolve() for p in pictures}) != len(pictures):
        raise ValueError("a picture file is named twice")
    for picture, camera in zip(pictures, intrinsics, strict=True):
        if picture.T_world_cam.shape != (4, 4) or not np.isfinite(picture.T_world_cam).all():
            raise ValueError(f"the believed pose of {picture.file.name} is not a finite 4x4 matrix")
        if not (picture.sigma_m > 0.0 and picture.sigma_rad > 0.0):
            raise ValueError(f"the sigmas of {picture.file.name} must be positive")
        image = (
            cv2.imread(str(picture.file), cv2.IMREAD_GRAYSCALE) if picture.file.is_file() else None
        )
        if image is None:
            raise ValueError(f"cannot read the picture {picture.file}")
        if image.shape != (camera.height, camera.width):
            raise ValueError(
                f"{picture.file.name} is {image.shape[1]}x{image.shape[0]}, "
                f"its camera {camera.width}x{camera.height}"
            )


def _errors_px(
    model: Model, T_world_cam: Array, points: Array, intrinsics: Sequence[Intrinsics]
) -> Array:
    """Return the reprojection error ``(o,)`` in pixels of every observation of a carried model."""
    errors = []
    for position, index in enumerate(model.indices):
        rows = model.observations[model.observations[:, 0] == position]
        camera = intrinsics[int(index)]
        pixels, _ = camera.project(points[rows[:, 1].astype(int)], T_world_cam[index])
        errors.append(np.linalg.norm(pixels - rows[:, 2:], axis=1))
    return np.concatenate(errors) if errors else np.zeros(0)


def _sure_points(model: Model) -> Array:
    """Return the points ``(m, 3)`` of a model that three pictures or more saw, in its frame."""
    seen = np.bincount(model.observations[:, 1].astype(int), minlength=len(model.points_model))
    return model.points_model[seen >= 3]


def _sightings(model: Model, points_world: Array) -> Sightings:
    """Return where the points of a carried model were seen, those of two pictures left out."""
    points = model.observations[:, 1].astype(np.int64)
    sure = np.bincount(points, minlength=len(points_world)) >= 3
    rows = model.observations[sure[points]]
    pictures = model.indices[rows[:, 0].astype(np.int64)].astype(np.int64)
    order = np.argsort(pictures, kind="stable")
    number = np.cumsum(sure) - 1
    return Sightings(
        points_world[sure],
        pictures[order],
        number[rows[order, 1].astype(np.int64)],
        rows[order, 2:],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What is known before anything is looked at; arrays in the order of the pictures."""

    beliefs: Beliefs
    drone_ids: list[str]
    at_s: Array
    still: NDArray[np.bool_]
    cameras: list[Intrinsics]


class _Carried:
    """Reconstructions carried into the world."""

    def __init__(self, beliefs: Beliefs, cameras: Sequence[Intrinsics]) -> None:
        self.T_world_cam = beliefs.T_world_cam.copy()
        self.refined = np.zeros(len(cameras), bool)
        self.stopped = False
        self._sigma_m, self._sigma_rad = beliefs.sigma_m.copy(), beliefs.sigma_rad.copy()
        self._cameras = list(cameras)
        self._sightings = no_sightings()
        self._on_floor = False
        self._rms_px = float("nan")
        self._outlined = 0
        self._placed = np.zeros(len(cameras), bool)

    def complete(self, still: NDArray[np.bool_]) -> bool:
        """Return whether all stills are refined."""
        return bool(self.refined[still].all())

    def take(self, models: Sequence[Model], task: _Task, config: PoseConfig) -> None:
        """Carry ``models``, largest first, and fill the gaps between their pictures."""
        placed = np.zeros(len(self.refined), bool)
        beliefs = task.beliefs
        for model in models:
            new = ~placed[model.indices]
            # What a larger model has taught about a drone corrects what is believed of a smaller.
            T_now = carry_corrections(
                beliefs.T_world_cam, self.T_world_cam, placed, beliefs.drone, task.at_s
            )
            now = Beliefs(T_now, beliefs.drone, beliefs.sigma_m, beliefs.sigma_rad)
            if new.sum() < config.min_model_pictures:
                continue
            adjusted = adjust(
                model,
                [task.cameras[i] for i in model.indices],
                beliefs.drone[model.indices],
                config,
            )
            T_model_cam = adjusted.model.T_model_cam
            try:
                similarity = align_to_beliefs(T_model_cam, now.subset(model.indices), config)
            except ScaleUnknownError:
                # A model without extent (a hovering drone) tells nothing about scale or place.
                continue
            if not placed.any():
                corrected = on_the_floor(similarity, _sure_points(adjusted.model))
                self._on_floor = corrected is not None
                similarity = similarity if corrected is None else corrected
            taken = model.indices[new]
            self.T_world_cam[taken] = similarity.poses(T_model_cam)[new]
            if not placed.any():
                self._take_largest(adjusted, similarity, beliefs.drone, config)
            placed[taken] = True
        self._placed = placed
        self.T_world_cam = carry_corrections(
            beliefs.T_world_cam, self.T_world_cam, placed, beliefs.drone, task.at_s
        )

    def _take_largest(
        self,
        adjusted: Adjusted,
        similarity: Similarity,
        drone: NDArray[np.int_],
        config: PoseConfig,
    ) -> None:
        """Take how well the largest model's pictures are known, its cameras and its points."""
        model = adjusted.model
        keys = list(zip(drone.tolist(), self._cameras, strict=True))
        found = {keys[i]: lens for i, lens in zip(model.indices, adjusted.intrinsics, strict=True)}
        self._cameras = [found.get(key, key[1]) for key in keys]
        sigma_m = config.sigma_factor * similarity.scale * adjusted.sigma_shift
        # The principal point's height cannot be found; it tilts all pictures of a drone alike.
        tilt_rad = config.principal_sigma_px / adjusted.intrinsics[0].fy
        sigma_rad = np.hypot(config.sigma_factor * adjusted.sigma_turn, tilt_rad / np.sqrt(3.0))
        known = (sigma_m <= config.max_sigma_m) & (sigma_rad <= config.max_sigma_rad)
        self._sigma_m[model.indices], self._sigma_rad[model.indices] = sigma_m, sigma_rad
        self.refined[model.indices] = known
        carried = similarity.points(model.points_model)
        errors = _errors_px(model, self.T_world_cam, carried, self._cameras)
        self._rms_px = float(np.sqrt((errors**2).mean())) if len(errors) else float("nan")
        self._sightings = _sightings(model, carried)

    def agree_on_outlines(
        self,
        pictures: Sequence[PosedPicture],
        still: NDArray[np.bool_],
        config: PoseConfig,
        on_progress: Callable[[float], None],
    ) -> None:
        """Bring the stills that texture left unknown to agree with all on the object's shape.

        Those of smaller reconstructions fit one another better than outlines could tell; where all
        of them stand is not known well enough to hold the shape.
        """
        chosen = np.flatnonzero(still & (self.refined | ~self._placed))
        found = fit_to_outlines(
            self.T_world_cam[chosen],
            [self._cameras[int(i)] for i in chosen],
            [_mask(pictures[int(i)]) for i in chosen],
            self._sigma_m[chosen],
            self._sigma_rad[chosen],
            self.refined[chosen],
            config,
            on_progress,
        )
        self.T_world_cam[chosen] = found.T_world_cam
        self._sigma_m[chosen], self._sigma_rad[chosen] = found.sigma_m, found.sigma_rad
        self._outlined = int(found.fitted.sum())

    def result(self, task: _Task) -> RefinedPoses:
        """Return what was found, with a sentence about it."""
        return RefinedPoses(
            self.T_world_cam,
            self.refined,
            self._sigma_m,
            self._sigma_rad,
            tuple(self._cameras),
            self._rms_px,
            self._sightings,
            0.0 if self._on_floor else None,
            self._message(task.still),
        )

    def _message(self, still: NDArray[np.bool_]) -> str:
        """Return one sentence about how many poses were refined, and how well all are known."""
        if self.stopped:
            return "Stopped before the poses were refined; the flight's poses are kept."
        if not self.refined.any():
            about = _about(self._sigma_m[still], self._sigma_rad[still])
            text = "Too little texture to refine the poses; "
            if self._outlined:
                text += (
                    f"{self._outlined} of {int(still.sum())} were fitted to the object's outline"
                )
            else:
                text += "the flight's poses are kept"
            return f"{text}, known to {about}."
        fine, stills = self.refined & still, int(still.sum())
        text = f"{int(fine.sum())} of {stills} poses refined"
        if fine.any():
            text += f" to {_about(self._sigma_m[fine], self._sigma_rad[fine])}"
        if not still.all():
            text += f" with {int((self.refined & ~still).sum())} of {int((~still).sum())}"
            text += " video pictures"
        if fine.sum() == stills:
            return text + "."
        left = still & ~self.refined
        about = _about(self._sigma_m[left], self._sigma_rad[left])
        outlined = f", {self._outlined} fitted to the object's outline" if self._outlined else ""
        return f"{text}; the others are corrected flight poses{outlined}, known to {about}."


def _mask(picture: PosedPicture) -> NDArray[np.bool_] | None:
    """Return a picture's mask ``(h, w)``, None where it has none that can be read."""
    if picture.mask_file is None:
        return None
    mask = cv2.imread(str(picture.mask_file), cv2.IMREAD_GRAYSCALE)
    return None if mask is None else mask > 127


def _about(sigma_m: Array, sigma_rad: Array) -> str:
    """Return the median of some standard deviations in words."""
    sigma_cm = 100.0 * float(np.median(sigma_m))
    return f"about {sigma_cm:.2g} cm and {math.degrees(float(np.median(sigma_rad))):.2g} degrees"


def refine_poses(
    pictures: Sequence[PosedPicture],
    intrinsics: Intrinsics | Sequence[Intrinsics],
    work_folder: Path,
    config: PoseConfig,
    on_progress: Callable[[str, float], None],
    should_stop: Callable[[], bool],
) -> RefinedPoses:
    """Refine the believed poses of ``pictures``.

    Too little texture is no error: what could not be refined keeps its (corrected) flight pose, or
    is moved to where its outline agrees with the others'.

    Args:
        pictures: Stills and video pictures, two or more.
        intrinsics: One camera for all, or one per picture.
        work_folder: Scratch folder of this call's own.
        config: Settings.
        on_progress: Called with the step (features, matches, mapping, outlines) and its share in
            0..1.
        should_stop: Asked often; True keeps the flight poses and says so.

    Raises:
        ValueError: With fewer than two pictures, or one that cannot be read, is named twice, has
            another size than its camera or no valid belief.
    """
    cameras = (
        [intrinsics] * len(pictures) if isinstance(intrinsics, Intrinsics) else list(intrinsics)
    )
    _check(pictures, cameras)
    task = _task(pictures, cameras)
    best = _attempt(pictures, task, work_folder, config, on_progress, should_stop)
    if not best.stopped and not best.complete(task.still) and config.thorough_features > 0:
        # The quick search found too little: look again at full size, for more and fainter features.
        again = _attempt(pictures, task, work_folder, config.thorough(), on_progress, should_stop)
        if (again.refined & task.still).sum() > (best.refined & task.still).sum():
            best = again
    if not best.stopped and not best.complete(task.still):

        def on_round(share: float) -> None:
            if should_stop():
                raise PosesStoppedError
            on_progress("outlines", share)

        # Stopped here, what texture told stays.
        with suppress(PosesStoppedError):
            best.agree_on_outlines(pictures, task.still, config, on_round)
    return best.result(task)


def _task(pictures: Sequence[PosedPicture], cameras: list[Intrinsics]) -> _Task:
    """Return what is known before anything is looked at."""
    drone_ids = [p.drone_id for p in pictures]
    _, drone = np.unique(np.array(drone_ids), return_inverse=True)
    beliefs = Beliefs(
        np.stack([np.asarray(p.T_world_cam, float) for p in pictures]),
        drone,
        np.array([p.sigma_m for p in pictures], float),
        np.array([p.sigma_rad for p in pictures], float),
    )
    return _Task(
        beliefs,
        drone_ids,
        np.array([p.at_s for p in pictures], float),
        np.array([p.still for p in pictures], bool),
        cameras,
    )


def _attempt(
    pictures: Sequence[PosedPicture],
    task: _Task,
    work_folder: Path,
    config: PoseConfig,
    on_progress: Callable[[str, float], None],
    should_stop: Callable[[], bool],
) -> _Carried:
    """Reconstruct once and carry what came of it into the world."""
    beliefs = task.beliefs
    mapper = Mapper(
        [p.file for p in pictures],
        task.cameras,
        beliefs.drone.tolist(),
        work_folder,
        config,
        on_progress,
        should_stop,
    )
    pairs = choose_pairs(beliefs.T_world_cam, task.drone_ids, task.at_s, task.still, config)
    carried = _Carried(beliefs, task.cameras)
    try:
        mapper.extract()
        mapper.match(pairs)
        carried.take(mapper.map(), task, config)
    except PosesStoppedError:
        carried.stopped = True
    finally:
        mapper.clean()
    return carried
