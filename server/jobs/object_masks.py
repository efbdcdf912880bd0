"""The masks of a run cut anew with its refined poses (``server.vision.recut``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from server.drafts import whole_file
from server.nerf.dataset import Dataset
from server.nerf.flight import FlightPicture
from server.stages import CameraPose
from server.vision.config import RegionConfig, SeedConfig
from server.vision.recut import MaskedPicture, recut_masks

Array = NDArray[np.float64]

# Fewer pictures of known poses say too little about each other's masks.
_LEAST_PICTURES = 4


def cut_anew(
    folder: Path,
    posed: Dataset,
    stills: Sequence[FlightPicture],
    refined: NDArray[np.bool_],
    sigma_m: Array,
    sigma_rad: Array,
    on_progress: Callable[[float], None],
) -> tuple[Dataset, list[str | None]]:
    """Cut the object's masks anew and write them over those of the flight.

    Args:
        folder: The run folder.
        posed: Its pictures at full size, with refined poses.
        stills: The same pictures as the flight listed them.
        refined: Which poses are known that well ``(n,)``; the masks of the others stay.
        sigma_m: How well each position is known ``(n,)``.
        sigma_rad: How well each rotation is known ``(n,)``.
        on_progress: Told the share that is done.

    Returns:
        The dataset with the new masks, and their files relative to the folder, None for none.
    """
    masks, files = list(posed.masks), [still.mask for still in stills]
    known = np.flatnonzero(refined).tolist()
    if len(known) < _LEAST_PICTURES:
        return posed, files
    pictures = [
        MaskedPicture(
            np.ascontiguousarray(posed.images[k][:, :, ::-1]),
            posed.masks[k],
            CameraPose(
                stills[k].drone_id,
                stills[k].at_s,
                posed.T_world_cam[k],
                np.diag([sigma_m[k] ** 2] * 3 + [sigma_rad[k] ** 2]),
            ),
            posed.intrinsics[k],
        )
        for k in known
    ]
    anew = recut_masks(pictures, RegionConfig(), SeedConfig(), on_progress)
    for k, mask in zip(known, anew, strict=True):
        if mask is not None:
            file = f"masks/{Path(stills[k].file).stem}.png"
            _write_mask(folder / file, mask)
            masks[k], files[k] = mask, file
    return replace(posed, masks=tuple(masks)), files


def _write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    """Write it so that it is complete or untouched."""
    path.parent.mkdir(exist_ok=True)
    made, png = cv2.imencode(".png", mask.astype(np.uint8) * 255)
    if not made:
        raise OSError(f"{path} could not be encoded")
    with whole_file(path) as stream:
        stream.write(png.tobytes())
