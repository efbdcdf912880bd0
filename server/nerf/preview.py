"""Small pictures of the field while it is being trained, from a camera that circles the object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.training import Trainer

Array = NDArray[np.float64]

# A preview is looked at for a moment, and training waits for it.
_SAMPLES_PER_RAY = 12


@dataclass(frozen=True, slots=True, eq=False)
class OrbitPreview:
    """One picture of the orbit.

    Attributes:
        jpeg: The picture.
        T_world_cam: ``(4, 4)`` camera it was rendered from.
        intrinsics: Its camera.
    """

    jpeg: bytes
    T_world_cam: Array
    intrinsics: Intrinsics


def orbit_pose(T_world_cam: Array, centre: Array, turn: float) -> Array:
    """Return the pose ``turn`` (0 to 1) of the way round ``centre``.

    Args:
        T_world_cam: Training cameras ``(n, 4, 4)``; the orbit has their median distance and height.
        centre: Middle of the object ``(3,)``, world metres.
        turn: Share of the circle; 0 is at the first camera's azimuth.
    """
    offsets = T_world_cam[:, :3, 3] - centre
    across = np.linalg.norm(offsets[:, :2], axis=1)
    radius = max(float(np.median(across)), 1e-3)
    azimuth = float(np.arctan2(offsets[0, 1], offsets[0, 0])) + 2.0 * np.pi * turn
    height = float(np.median(offsets[:, 2]))
    position = centre + np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
    return look_at(position, centre)


def render_preview(
    trainer: Trainer, turn: float, *, width: int = 320, height: int = 240, quality: int = 80
) -> OrbitPreview:
    """Render the orbit's picture at ``turn`` (0 to 1) as JPEG of ``width`` x ``height``."""
    model = trainer.dataset.intrinsics[0]
    focal = min(model.fx * width / model.width, model.fy * height / model.height)
    camera = Intrinsics(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)
    pose = orbit_pose(trainer.dataset.T_world_cam, trainer.space.centre, turn)
    rgb = trainer.render(camera, pose, samples_per_ray=_SAMPLES_PER_RAY).rgb
    image_bgr = np.round(np.clip(rgb[:, :, ::-1], 0.0, 1.0) * 255.0).astype(np.uint8)
    done, data = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise RuntimeError("the preview could not be encoded as JPEG")
    return OrbitPreview(data.tobytes(), pose, camera)
