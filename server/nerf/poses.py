"""Camera poses from the pictures themselves, after the capture.

The flight believes its poses to 10-25 cm and a few degrees; a radiance field needs a centimetre
and a fraction of a degree. Structure from motion over the stills and the video pictures between
them recovers the poses up to a similarity, which is then found from what the flight believed.
The paper leaves this to COLMAP; here the flight's beliefs choose the pairs, give the scale and
hold the world upright.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.nerf.pose_alignment import (
    Beliefs,
    ScaleUnknownError,
    align_to_beliefs,
    carry_corrections,
)
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_mapping import Mapper, Model, PosesStoppedError
from server.nerf.pose_pairs import choose_pairs

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
        mask_file: Mask of the object. The poses do not use it: the room holds still as well and
            its texture is welcome.
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
        refined: Which of them come from the pictures ``(n,)``; the others are flight poses, moved
            as their drone's refined pictures were.
        reprojection_rms_px: Root mean square over all observations used, NaN without any.
        points_world: Triangulated points ``(m, 3)`` seen in three pictures or more, world metres.
        message: One sentence for the operator.
    """

    T_world_cam: Array
    refined: NDArray[np.bool_]
    reprojection_rms_px: float
    points_world: Array
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


def _message(refined: NDArray[np.bool_], still: NDArray[np.bool_], stopped: bool) -> str:
    """Return one sentence about how many poses were refined."""
    done, stills = int((refined & still).sum()), int(still.sum())
    if stopped:
        return "Stopped before the poses were refined; the flight's poses are kept."
    if not refined.any():
        return "Too little texture to refine the poses; the flight's poses are kept."
    text = f"{done} of {stills} poses refined"
    if not still.all():
        text += f" with {int((refined & ~still).sum())} of {int((~still).sum())} video pictures"
    return text + ("." if done == stills else "; the others are corrected flight poses.")


def refine_poses(
    pictures: Sequence[PosedPicture],
    intrinsics: Intrinsics | Sequence[Intrinsics],
    work_folder: Path,
    config: PoseConfig,
    on_progress: Callable[[str, float], None],
    should_stop: Callable[[], bool],
) -> RefinedPoses:
    """Refine the believed poses of ``pictures``.

    Too little texture is no error: what could not be refined keeps its (corrected) flight pose.

    Args:
        pictures: Stills and video pictures, two or more.
        intrinsics: One camera for all, or one per picture.
        work_folder: Scratch folder of this call's own.
        config: Settings.
        on_progress: Called with the step (features, matches, mapping) and its share in 0..1.
        should_stop: Asked often; True keeps the flight poses and says so.

    Raises:
        ValueError: With fewer than two pictures, or one that cannot be read, is named twice, has
            another size than its camera or no valid belief.
    """
    cameras = (
        [intrinsics] * len(pictures) if isinstance(intrinsics, Intrinsics) else list(intrinsics)
    )
    _check(pictures, cameras)
    T_flight = np.stack([np.asarray(p.T_world_cam, float) for p in pictures])
    still = np.array([p.still for p in pictures], bool)
    at_s = np.array([p.at_s for p in pictures], float)
    drone_ids = [p.drone_id for p in pictures]
    _, drone = np.unique(np.array(drone_ids), return_inverse=True)
    beliefs = Beliefs(
        T_flight,
        drone,
        np.array([p.sigma_m for p in pictures], float),
        np.array([p.sigma_rad for p in pictures], float),
    )
    mapper = Mapper(
        [p.file for p in pictures], cameras, work_folder, config, on_progress, should_stop
    )
    try:
        mapper.extract()
        mapper.match(choose_pairs(T_flight, drone_ids, at_s, still, config))
        models = mapper.map()
    except PosesStoppedError:
        models, stopped = [], True
    else:
        stopped = False
    finally:
        mapper.clean()
    return _carry(models, beliefs, at_s, still, cameras, config, stopped)


def _carry(
    models: Sequence[Model],
    beliefs: Beliefs,
    at_s: Array,
    still: NDArray[np.bool_],
    cameras: Sequence[Intrinsics],
    config: PoseConfig,
    stopped: bool,
) -> RefinedPoses:
    """Carry ``models``, largest first, into the world and fill the gaps between their pictures."""
    T_best = beliefs.T_world_cam.copy()
    refined = np.zeros(len(at_s), bool)
    points, errors = [np.zeros((0, 3))], [np.zeros(0)]
    for model in models:
        new = ~refined[model.indices]
        # What a larger model has taught about a drone corrects what is believed for a smaller one.
        T_now = carry_corrections(beliefs.T_world_cam, T_best, refined, beliefs.drone, at_s)
        now = Beliefs(T_now, beliefs.drone, beliefs.sigma_m, beliefs.sigma_rad)
        if new.sum() < config.min_model_pictures:
            continue
        try:
            similarity = align_to_beliefs(model.T_model_cam, now.subset(model.indices), config)
        except ScaleUnknownError:
            # A model without extent (a hovering drone) tells nothing about scale or place.
            continue
        T_carried = T_best.copy()
        T_carried[model.indices] = similarity.poses(model.T_model_cam)
        carried = similarity.points(model.points_model)
        errors.append(_errors_px(model, T_carried, carried, cameras))
        seen = np.bincount(model.observations[:, 1].astype(int), minlength=len(carried))
        points.append(carried[seen >= 3])
        taken = model.indices[new]
        T_best[taken] = T_carried[taken]
        refined[taken] = True
    T_best = carry_corrections(beliefs.T_world_cam, T_best, refined, beliefs.drone, at_s)
    all_errors = np.concatenate(errors)
    return RefinedPoses(
        T_best,
        refined,
        float(np.sqrt((all_errors**2).mean())) if len(all_errors) else float("nan"),
        np.concatenate(points),
        _message(refined, still, stopped),
    )
