"""A calibration for people, for programs and as a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.vision.calibration import Calibration
from server.vision.calibration_board import BoardView
from server.vision.coverage_picture import coverage_png

# From no corner in a cell of the picture to many.
_SHADES = " .:+#"
_FULL_CELL = 8


def coverage_map(coverage: NDArray[np.int64]) -> str:
    """Return the picture's cells as a text map, darker where more corners were seen."""
    across = coverage.shape[1]
    frame = "+" + "--" * across + "+"
    rows = [frame]
    for line in coverage:
        steps = np.ceil(np.minimum(line / _FULL_CELL, 1.0) * (len(_SHADES) - 1)).astype(int)
        rows.append("|" + "".join(2 * _SHADES[step] for step in steps) + "|")
    return "\n".join([*rows, frame])


def write_pictures(folder: Path, calibration: Calibration, views: Sequence[BoardView]) -> None:
    """Write ``coverage.png`` into a folder, which is made if need be; raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "coverage.png").write_bytes(coverage_png(calibration, views))


def calibration_text(calibration: Calibration, details: bool = True) -> str:
    """Return the result as lines for people."""
    camera, sd = calibration.intrinsics, calibration.deviations
    tilts = np.abs(calibration.tilts_deg).max(axis=0)
    share = float((calibration.coverage > 0).mean())
    k1, k2, p1, p2, k3 = camera.distortion
    lines = [
        f"{camera.width} x {camera.height}, {len(calibration.views)} views"
        f", {len(calibration.dropped)} dropped",
        f"  fx  {camera.fx:9.2f} +- {sd[0]:.2f} px    fy  {camera.fy:9.2f} +- {sd[1]:.2f} px",
        f"  cx  {camera.cx:9.2f} +- {sd[2]:.2f} px    cy  {camera.cy:9.2f} +- {sd[3]:.2f} px",
        f"  k1 {k1:+.4f}  k2 {k2:+.4f}  p1 {p1:+.5f}  p2 {p2:+.5f}  k3 {k3:+.4f}"
        + (f"   ({', '.join(calibration.fixed)} not told from 0)" if calibration.fixed else ""),
        f"  reprojection error  {calibration.mean_px:.3f} px mean, {calibration.rms_px:.3f} px rms",
        f"  tilts up to {tilts[0]:.0f} degrees left or right, {tilts[1]:.0f} up or down",
        f"  coverage {share:.0%} of the picture",
    ]
    if details:
        lines += ["    " + line for line in coverage_map(calibration.coverage).splitlines()]
        for name, error in calibration.views:
            lines.append(f"    {name:<28}{error:.3f} px")
        for name, error in calibration.dropped:
            lines.append(f"    {name:<28}{error:.3f} px  dropped")
    return "\n".join(lines)


def calibration_json(calibration: Calibration, board: str, written: str | None) -> str:
    """Return the result as one JSON object; ``written`` is the fleet file it went into."""
    camera, sd = calibration.intrinsics, calibration.deviations
    keys = ("fx", "fy", "cx", "cy")
    return json.dumps(
        {
            "board": board,
            "width": camera.width,
            "height": camera.height,
            **{key: getattr(camera, key) for key in keys},
            "distortion": list(camera.distortion),
            "sd": dict(zip(keys, map(float, sd), strict=True)),
            "reprojection_px_mean": calibration.mean_px,
            "reprojection_px_rms": calibration.rms_px,
            "coverage": float((calibration.coverage > 0).mean()),
            "coverage_cells": calibration.coverage.tolist(),
            "tilts_deg": calibration.tilts_deg.tolist(),
            "terms_fixed": list(calibration.fixed),
            "views": dict(calibration.views),
            "dropped": dict(calibration.dropped),
            "written": written,
        }
    )
