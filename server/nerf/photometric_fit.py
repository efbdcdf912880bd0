"""Fits one camera to a finished field: the pose from which the field looks most like a picture.

Test cameras are known in the true world, fields live in the frame that their poses made up. The
similarity between the two leaves small errors of its own, which are no fault of the field; the
usual protocol (Lin et al., "BARF", ICCV 2021, section 4) lets every test camera settle first.
Gauss-Newton needs few steps: the picture's change by each of the six motions is taken from
renderings, and bright errors count linearly (Huber's weights).
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.cameras import Intrinsics
from server.geometry.poses import transform_from

Array = NDArray[np.float64]
RenderRgb = Callable[[Intrinsics, Array], NDArray[np.float32]]

_DELTA = 0.1
_TURN_RAD = 2e-3
# The longest step believed at once, in units of the difference's own step.
_FARTHEST = 12.0


def fit_pose(
    render: RenderRgb,
    image_rgb: NDArray[np.uint8],
    intrinsics: Intrinsics,
    T_world_cam: Array,
    centre: Array,
    *,
    scale: float = 0.25,
    steps: int = 4,
    least_gain: float = 0.0,
) -> Array:
    """Return the pose near ``T_world_cam`` ``(4, 4)`` whose rendering is nearest to a picture.

    Args:
        render: Returns the field's picture ``(h, w, 3)`` in [0, 1] of a camera and a pose.
        image_rgb: The picture ``(h, w, 3)``.
        intrinsics: Its camera.
        T_world_cam: Where to start: a few pixels wrong at most.
        centre: Point ``(3,)`` about which the camera turns, world metres: the object's middle.
        scale: Pictures are compared at this share of their size.
        steps: Gauss-Newton steps at most.
        least_gain: A step that lowers the loss by a smaller share than this is the last.
    """
    camera = intrinsics.scaled(scale)
    small = cv2.resize(image_rgb, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    wanted = _softened(small.astype(np.float32) / np.float32(255.0))
    distance_m = float(np.linalg.norm(T_world_cam[:3, 3] - centre))
    units = np.array([_TURN_RAD] * 3 + [_TURN_RAD * distance_m] * 3)
    best = np.asarray(T_world_cam, float)
    shown = _softened(render(camera, best))
    loss = _loss(shown - wanted)
    for _ in range(steps):
        slopes = np.stack(
            [
                (_softened(render(camera, _moved(best, centre, unit))) - shown).ravel()
                for unit in np.diag(units).astype(np.float64)
            ],
            axis=1,
        ).astype(float)
        error = (shown - wanted).ravel().astype(float)
        weights = _DELTA / np.maximum(np.abs(error), _DELTA)
        normal = slopes.T @ (weights[:, None] * slopes)
        damping = np.diag(1e-3 * np.diag(normal) + 1e-12)
        move = -np.linalg.solve(normal + damping, slopes.T @ (weights * error))
        move *= min(1.0, _FARTHEST / max(float(np.abs(move).max()), 1e-12))
        tried = _moved(best, centre, np.asarray(move * units, np.float64))
        shown_there = _softened(render(camera, tried))
        loss_there = _loss(shown_there - wanted)
        if loss_there >= loss:
            break
        settled = loss_there > (1.0 - least_gain) * loss
        best, shown, loss = tried, shown_there, loss_there
        if settled:
            break
    return best


def _moved(T_world_cam: Array, centre: Array, twist: Array) -> Array:
    """Return the pose turned about ``centre`` by ``twist[:3]`` radians, moved by ``twist[3:]``."""
    R = Rotation.from_rotvec(twist[:3]).as_matrix()
    position = R @ (T_world_cam[:3, 3] - centre) + centre + twist[3:]
    return transform_from(R @ T_world_cam[:3, :3], position)


def _softened(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture blurred by a pixel: a rendering's points against a camera's areas."""
    return np.asarray(cv2.GaussianBlur(rgb, (0, 0), 1.0), np.float32)


def _loss(error: NDArray[np.float32]) -> float:
    small = np.minimum(np.abs(error), _DELTA)
    return float((small * (np.abs(error) - 0.5 * small)).mean())
