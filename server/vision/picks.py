"""Where the object stands by what an operator picked in pictures.

Symbols, per pick: the camera stands at p with rotation R_world_cam, the object's centre is t and
the log of its height h. With (x, y, z) = R_world_cam^T (t - p) a pick measures, as a box does in
``server.vision.localization``,

    m = (x / z, y / z, h - log z),

the two tangents of the box's centre and the log of its apparent height. What is unsure about a pose
adds to what is unsure about m. All picks and the prior together give one least-squares problem for
(t, h), solved by Gauss-Newton: one pick moves the estimate onto its ray, two or more triangulate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose, SeedGeometry
from server.vision.target import TargetEstimate

Array = NDArray[np.float64]

# A hand draws an edge to about this share of the box, and it may enclose a part or a bit too much.
_CENTRE_SHARE = 0.15
_HEIGHT_LOG_SIGMA = 0.35
# Cut off by the picture's edge, an object may be this many times as high as what is seen of it.
_CUT_LOG_SIGMA = 1.0
# The poses that made the rays later learn from boxes of the same object; that counts them twice.
_COUNTED_TWICE = 2.0
_ROUNDS = 15
_NEAREST_M = 0.2
_UP = np.array([0.0, 0.0, 1.0])
# A click says nothing about the size: without any other knowledge it is this share of the picture's
# smaller side, and never outside these shares of each side.
_UNKNOWN_SHARE = 0.35
_SMALLEST_SHARE, _LARGEST_SHARE = 0.06, 0.9


@dataclass(frozen=True, slots=True, eq=False)
class Pick:
    """What the operator picked in one picture.

    Attributes:
        xyxy_px: Box ``(4,)`` around the object, full-picture pixels.
        pose: Camera pose of that picture.
        intrinsics: Its camera.
        sized: False where only the box's centre was pointed at: its size is a guess.
    """

    xyxy_px: Array
    pose: CameraPose
    intrinsics: Intrinsics
    sized: bool = True


def box_around(point_px: Array, size_px: Array | None, intrinsics: Intrinsics) -> Array:
    """Return the box ``(4,)``, left, top, right, bottom, meant by a click on an object.

    Args:
        point_px: The point ``(2,)`` that was clicked, full-picture pixels.
        size_px: The object's expected width and height ``(2,)``, None when nothing is known.
        intrinsics: The camera: the box stays inside its picture.
    """
    picture = np.array([intrinsics.width, intrinsics.height], float)
    if size_px is None or not np.isfinite(size_px).all():
        size_px = np.full(2, _UNKNOWN_SHARE * picture.min())
    half = np.clip(size_px, _SMALLEST_SHARE * picture, _LARGEST_SHARE * picture) / 2.0
    lower = np.maximum(point_px - half, 0.0)
    upper = np.minimum(point_px + half, picture - 1.0)
    return np.concatenate([lower, upper])


def expected_size(
    pose: CameraPose,
    target: TargetEstimate,
    intrinsics: Intrinsics,
    seed: SeedGeometry | None,
) -> Array | None:
    """Return the object's expected width and height ``(2,)`` in pixels, None when behind."""
    if seed is not None:
        corners = np.concatenate([box.corners for box in seed.boxes or (seed.outer,)])
        pixels, depths = intrinsics.project(corners, pose.T_world_cam)
        if (depths < _NEAREST_M).any():
            return None
        return np.ptp(pixels, axis=0)
    depth_m = float(intrinsics.project(target.centre[None], pose.T_world_cam)[1][0])
    if depth_m < _NEAREST_M:
        return None
    # Nothing is known about its width yet: as wide as high.
    return np.full(2, intrinsics.fy * target.height_m / depth_m)


def shows(pick: Pick, target: TargetEstimate) -> bool:
    """Return whether the object, where ``target`` has it, lies in what was picked.

    What is unsure about the pose widens the box; what is unsure about the target does not: a pick
    that says more than was known shall move it.
    """
    pixels, depths = pick.intrinsics.project(target.centre[None], pick.pose.T_world_cam)
    if depths[0] < _NEAREST_M:
        return False
    aside = pick.pose.position_sigma_m / float(depths[0])
    unsure_px = pick.intrinsics.fx * float(np.hypot(aside, np.sqrt(pick.pose.covariance[3, 3])))
    lower, upper = pick.xyxy_px[:2] - unsure_px, pick.xyxy_px[2:] + unsure_px
    return bool(((pixels[0] >= lower) & (pixels[0] <= upper)).all())


def picked_target(picks: Sequence[Pick], prior: TargetEstimate) -> TargetEstimate:
    """Return the object's place and height by ``prior`` and ``picks``, at least one.

    The covariance is widened, because the poses in it go on learning from the same object.
    """
    information0 = np.linalg.inv(prior.covariance)
    state = _first_guess(picks[-1], prior)
    information = information0
    for _ in range(_ROUNDS):
        information = information0.copy()
        pull = information0 @ (prior.vector - state)
        for pick in picks:
            predicted, by_target, by_pose = _predict(pick, state)
            measured, variances = _measure(pick)
            noise = np.diag(variances) + by_pose @ pick.pose.covariance @ by_pose.T
            weighted = np.linalg.solve(noise, by_target).T
            information += weighted @ by_target
            pull += weighted @ (measured - predicted)
        step = np.linalg.solve(information, pull)
        length = float(np.linalg.norm(step))
        # Half a metre at a time: the projection is far from linear near the camera.
        state = state + step * min(1.0, 0.5 / max(length, 1e-12))
        if length < 1e-6:
            break
    covariance: Array = np.linalg.inv(information) * np.float64(_COUNTED_TWICE)
    return TargetEstimate(state[:3].copy(), float(np.exp(state[3])), covariance)


def _first_guess(pick: Pick, prior: TargetEstimate) -> Array:
    """Return a first guess ``(4,)`` on the pick's ray, in front of the camera."""
    centre = (pick.xyxy_px[:2] + pick.xyxy_px[2:]) / 2.0
    ray = pick.pose.T_world_cam[:3, :3] @ pick.intrinsics.directions(centre[None])[0]
    along_m = max(float((prior.centre - pick.pose.position_world) @ ray), 2.0 * _NEAREST_M)
    return np.append(pick.pose.position_world + along_m * ray, np.log(prior.height_m))


def _predict(pick: Pick, state: Array) -> tuple[Array, Array, Array]:
    """Return m ``(3,)`` and its derivatives by (t, h) ``(3, 4)`` and by (p, yaw) ``(3, 4)``."""
    R_cam_world = pick.pose.T_world_cam[:3, :3].T
    offset = state[:3] - pick.pose.position_world
    x, y, z = R_cam_world @ offset
    z = max(float(z), _NEAREST_M)
    by_point = np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z], [0.0, 0.0, -1.0]]) / z
    by_place = by_point @ R_cam_world
    by_target = np.column_stack([by_place, [0.0, 0.0, 1.0]])
    by_pose = np.column_stack([-by_place, -by_place @ np.cross(_UP, offset)])
    return np.array([x / z, y / z, state[3] - np.log(z)]), by_target, by_pose


def _measure(pick: Pick) -> tuple[Array, Array]:
    """Return m ``(3,)`` as the box shows it, and its variances."""
    camera = pick.intrinsics
    corners = np.stack([pick.xyxy_px[:2], pick.xyxy_px[2:]])
    directions = camera.directions(np.vstack([corners, corners.mean(axis=0)]))
    tangents = directions[:, :2] / directions[:, 2:]
    width, height = np.maximum(tangents[1] - tangents[0], 1e-4)
    top, bottom = pick.xyxy_px[1], pick.xyxy_px[3]
    cut = top <= 1.0 or bottom >= camera.height - 2.0
    height_sigma = _CUT_LOG_SIGMA if cut or not pick.sized else _HEIGHT_LOG_SIGMA
    # Cut off, the box's centre is not the object's: it may lie half a box farther out.
    down_share = 0.5 if cut else _CENTRE_SHARE
    variances = np.array([_CENTRE_SHARE * width, down_share * height, height_sigma]) ** 2
    return np.array([tangents[2, 0], tangents[2, 1], np.log(height)]), variances
