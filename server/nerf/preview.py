"""Small pictures of the field while it is being trained, from anywhere about the object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.nerf.orbit_view import OrbitView, orbit_view, view_pose
from server.nerf.training import Trainer

Array = NDArray[np.float64]

# A preview is looked at for a moment, and training waits for it.
_SAMPLES_PER_RAY = 12


@dataclass(frozen=True, slots=True, eq=False)
class Preview:
    """One rendering of the field.

    Attributes:
        jpeg: The picture.
        view: Where it was seen from.
        T_world_cam: ``(4, 4)`` camera it was rendered from.
        intrinsics: Its camera.
    """

    jpeg: bytes
    view: OrbitView
    T_world_cam: Array
    intrinsics: Intrinsics


def render_preview(
    trainer: Trainer,
    view: OrbitView | float,
    *,
    width: int = 320,
    height: int = 240,
    quality: int = 80,
) -> Preview:
    """Render a view, or the orbit's at a turn (0 to 1), as JPEG of ``width`` x ``height``."""
    model = trainer.dataset.intrinsics[0]
    focal = min(model.fx * width / model.width, model.fy * height / model.height)
    camera = Intrinsics(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)
    cameras, centre = trainer.dataset.T_world_cam, trainer.space.centre
    if not isinstance(view, OrbitView):
        view = orbit_view(cameras, centre, view)
    pose = view_pose(cameras, centre, view)
    rgb = trainer.render(camera, pose, samples_per_ray=_SAMPLES_PER_RAY).rgb
    image_bgr = np.round(np.clip(rgb[:, :, ::-1], 0.0, 1.0) * 255.0).astype(np.uint8)
    done, data = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise RuntimeError("the preview could not be encoded as JPEG")
    return Preview(data.tobytes(), view, pose, camera)
