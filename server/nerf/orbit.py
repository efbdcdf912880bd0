"""A film of the field: once round the object, as an H.264 file that any browser plays."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

from server.drafts import draft_of
from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.nerf.object_part import ObjectPart
from server.nerf.orbit_view import orbit_pose
from server.nerf.rendering import Rendering
from server.nerf.training import Trainer

# Pictures of the whole circle: four seconds.
FRAMES = 60
# Fewer are no film.
_FEWEST_FRAMES = 12
# Pictures of a room take no harm from fewer samples than training has.
_ROOM_SAMPLES_PER_RAY = 12
# The object alone lies in a short stretch of each ray.
_OBJECT_SAMPLES_PER_RAY = 8
# The cells that keep floor and room out of the film of an object.
_PART_CELLS = 96
# The object fills so much of the picture.
_FILL = 0.9
# What lets more light through than this is haze that no picture needed; nothing of it is shown.
_HAZE, _SOLID = 0.2, 0.7
_WHITE = (1.0, 1.0, 1.0)
_QUALITY = "20"


def render_orbit(
    trainer: Trainer,
    file: Path,
    *,
    around: Box3 | None = None,
    frames: int = FRAMES,
    fps: int = 15,
    width: int = 400,
    height: int = 300,
    most_s: float | None = None,
    on_progress: Callable[[float], None] | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> bool:
    """Film the field once round its object; the file is complete or not there.

    Args:
        trainer: The field.
        file: The MP4 file to make.
        around: Box of the object, which alone is shown then, before white and as large as the
            picture allows; None for all that there is, through a lens as the pictures'.
        frames: Pictures of the whole circle.
        fps: Pictures per second of the film.
        width: Of a picture, pixels; even.
        height: Likewise.
        most_s: When the first picture says that the film would take longer, it has fewer pictures,
            at least twelve, and the same length; None: whatever it takes.
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
    part = None if around is None else trainer.object_part(_PART_CELLS, occupied=True)
    centre = trainer.space.centre if around is None else around.centre
    draft = draft_of(file)

    def picture(turn: float) -> av.VideoFrame:
        pose = orbit_pose(trainer.dataset.T_world_cam, centre, turn)
        focal = _focal(trainer, pose, around, width, height)
        camera = Intrinsics(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)
        rgb = np.clip(_picture(trainer, camera, pose, part), 0.0, 1.0)
        return av.VideoFrame.from_ndarray(np.round(rgb * 255.0).astype(np.uint8), "rgb24")

    try:
        if should_stop():
            return False
        begun_s = time.monotonic()
        first = picture(0.0)
        if most_s is not None:
            fewer = fitting_frames(frames, time.monotonic() - begun_s, most_s)
            frames, fps = fewer, max(1, round(fps * fewer / frames))
        with av.open(str(draft), "w", format="mp4") as film:
            stream = film.add_stream("libx264", rate=fps)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": _QUALITY, "movflags": "faststart"}
            for number in range(frames):
                if should_stop():
                    return False
                film.mux(stream.encode(first if number == 0 else picture(number / frames)))
                if on_progress is not None:
                    on_progress((number + 1) / frames)
            film.mux(stream.encode())
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return True


def fitting_frames(frames: int, each_s: float, most_s: float) -> int:
    """Return how many of ``frames`` pictures, each taking ``each_s``, to make in ``most_s``."""
    fitting = int(most_s / max(each_s, 1e-9))
    return min(frames, max(fitting, _FEWEST_FRAMES))


def _focal(
    trainer: Trainer, pose: NDArray[np.float64], around: Box3 | None, width: int, height: int
) -> float:
    """Return the focal length in pixels of the film's camera at ``pose`` ``(4, 4)``."""
    if around is None:
        model = trainer.dataset.intrinsics[0]
        return min(model.fx * width / model.width, model.fy * height / model.height)
    distance_m = float(np.linalg.norm(pose[:3, 3] - around.centre))
    radius_m = float(np.linalg.norm(around.size)) / 2.0
    half_angle = np.arcsin(min(radius_m / max(distance_m, 1e-6), 0.95))
    return float(_FILL * min(width, height) / 2.0 / np.tan(half_angle))


def _picture(
    trainer: Trainer, camera: Intrinsics, pose: NDArray[np.float64], part: ObjectPart | None
) -> NDArray[np.float32]:
    """Return one picture ``(height, width, 3)``, RGB in [0, 1]."""
    if part is None:
        return trainer.render(camera, pose, samples_per_ray=_ROOM_SAMPLES_PER_RAY).rgb
    shown = trainer.render(
        camera, pose, samples_per_ray=_OBJECT_SAMPLES_PER_RAY, only=part, background=_WHITE
    )
    return _without_haze(shown)


def _without_haze(shown: Rendering) -> NDArray[np.float32]:
    """Return ``shown`` before white ``(h, w, 3)`` with its opacity steepened."""
    opacity = shown.opacity[:, :, None]
    colour = 1.0 - (1.0 - shown.rgb) / np.maximum(opacity, 1e-3)
    steep = np.clip((opacity - _HAZE) / (_SOLID - _HAZE), 0.0, 1.0)
    return (np.clip(colour, 0.0, 1.0) * steep + 1.0 - steep).astype(np.float32)
