"""A film of the field: once round the object, as an H.264 file that any browser plays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np

from server.geometry.cameras import Intrinsics
from server.nerf.preview import orbit_pose
from server.nerf.training import Trainer

# Rendered a little finer than a preview: films are looked at twice.
_SAMPLES_PER_RAY = 24
_QUALITY = "20"


def render_orbit(
    trainer: Trainer,
    file: Path,
    *,
    frames: int = 96,
    fps: int = 24,
    width: int = 480,
    height: int = 360,
    on_progress: Callable[[float], None] | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> bool:
    """Film the field once round its object; the file is complete or not there.

    Args:
        trainer: The field.
        file: The MP4 file to make.
        frames: Pictures of the whole circle.
        fps: Pictures per second of the film.
        width: Of a picture, pixels; even.
        height: Likewise.
        on_progress: Told the share that is done.
        should_stop: Asked before each picture.

    Returns:
        False when it was stopped; then there is no file.

    Raises:
        ValueError: If a number makes no film.
        OSError: If the file cannot be written.
    """
    if frames < 2 or fps < 1:
        raise ValueError("a film needs at least 2 pictures and 1 per second")
    if width % 2 or height % 2 or min(width, height) < 16:
        raise ValueError(f"pictures of {width}x{height} cannot be filmed: even sizes from 16 on")
    model = trainer.dataset.intrinsics[0]
    focal = min(model.fx * width / model.width, model.fy * height / model.height)
    camera = Intrinsics(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)
    draft = file.with_name(file.name + ".part")
    try:
        with av.open(str(draft), "w", format="mp4") as film:
            stream = film.add_stream("libx264", rate=fps)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": _QUALITY, "movflags": "faststart"}
            for number in range(frames):
                if should_stop():
                    return False
                pose = orbit_pose(
                    trainer.dataset.T_world_cam, trainer.space.centre, number / frames
                )
                rgb = trainer.render(camera, pose, samples_per_ray=_SAMPLES_PER_RAY).rgb
                picture = np.round(np.clip(rgb, 0.0, 1.0) * 255.0).astype(np.uint8)
                film.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
                if on_progress is not None:
                    on_progress((number + 1) / frames)
            film.mux(stream.encode())
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return True
