"""Which part of the object a box drawn in one picture means."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.stages import SeedGeometry

Array = NDArray[np.float64]

# Cells along the longest edge of the object.
_CELLS = 40


def drawn_part(
    seed: SeedGeometry, T_world_cam: Array, intrinsics: Intrinsics, xyxy_px: Array
) -> Box3 | None:
    """Return the box around what of ``seed`` appears in a box drawn in one picture.

    The part goes through the whole depth of the object there: a drawing cannot tell its front from
    its back.

    Args:
        seed: The object's crude geometry.
        T_world_cam: Camera pose ``(4, 4)`` of the picture.
        intrinsics: Its camera.
        xyxy_px: The drawn box ``(4,)``, full-picture pixels.

    Returns:
        The part, world metres, or None when nothing of the object appears there.
    """
    edge_m = max(float(seed.outer.size.max()) / _CELLS, 1e-6)
    lower, upper = [], []
    for box in seed.boxes or (seed.outer,):
        counts = np.maximum(np.ceil(box.size / edge_m).astype(int), 1)
        axes = [(np.arange(n) + 0.5) / n for n in counts]
        shares = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        centres = box.lower + shares * box.size
        pixels, depths = intrinsics.project(centres, T_world_cam)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= xyxy_px[:2]) & (pixels <= xyxy_px[2:])
        shown = inside.all(axis=1) & (depths > 0.0)
        if shown.any():
            half = box.size / counts / 2.0
            lower.append(centres[shown].min(axis=0) - half)
            upper.append(centres[shown].max(axis=0) + half)
    if not lower:
        return None
    return Box3(np.min(lower, axis=0), np.max(upper, axis=0))
