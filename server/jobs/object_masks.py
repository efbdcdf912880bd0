"""The masks of a run cut anew with its refined poses (``server.vision.recut``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from server.nerf.dataset import Dataset
from server.nerf.flight import FlightPicture
from server.stages import CameraPose
from server.vision.config import RegionConfig, SeedConfig
from server.vision.recut import MaskedPicture, recut_masks

Array = NDArray[np.float64]


def cut_anew(
    folder: Path,
    posed: Dataset,
    stills: Sequence[FlightPicture],
    sigma_m: Array,
    sigma_rad: Array,
    on_progress: Callable[[float], None],
) -> tuple[Dataset, list[str | None]]:
    """Cut the object's masks anew and write them over those of the flight.

    Args:
        folder: The run folder.
        posed: Its pictures at full size, with refined poses.
        stills: The same pictures as the flight listed them.
        sigma_m: How well each position is known ``(n,)``.
        sigma_rad: How well each rotation is known ``(n,)``.
        on_progress: Told the share that is done.

    Returns:
        The dataset with the new masks, and their files relative to the folder, None for none.
    """
    pictures = [
        MaskedPicture(
            np.ascontiguousarray(image[:, :, ::-1]),
            mask,
            CameraPose(still.drone_id, still.at_s, T, np.diag([m**2] * 3 + [rad**2])),
            camera,
        )
        for still, image, mask, T, camera, m, rad in zip(
            stills,
            posed.images,
            posed.masks,
            posed.T_world_cam,
            posed.intrinsics,
            sigma_m,
            sigma_rad,
            strict=True,
        )
    ]
    masks = recut_masks(pictures, RegionConfig(), SeedConfig(), on_progress)
    files: list[str | None] = []
    for still, mask in zip(stills, masks, strict=True):
        file = None if mask is None else f"masks/{Path(still.file).stem}.png"
        files.append(file)
        if mask is not None and file is not None:
            _write_mask(folder / file, mask)
    return replace(posed, masks=tuple(masks)), files


def _write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    """Write it so that it is complete or untouched."""
    path.parent.mkdir(exist_ok=True)
    _, png = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    draft = path.with_name(path.name + ".part")
    draft.write_bytes(png.tobytes())
    draft.replace(path)
