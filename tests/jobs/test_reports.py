"""What a training leaves behind for people to look at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from server.jobs.reports import keep_renderings


def test_a_rendering_is_kept_as_it_was(tmp_path: Path) -> None:
    image_rgb = np.zeros((24, 32, 3), np.float32)
    image_rgb[..., 0] = 1.2  # Redder than red, as a rendering may be.
    image_rgb[..., 2] = 0.25
    keep_renderings(tmp_path)(8, image_rgb)
    kept_bgr = cv2.imread(str(tmp_path / "held_out/0008.jpg"))
    assert kept_bgr is not None
    assert kept_bgr.shape == (24, 32, 3)
    assert np.abs(kept_bgr.mean((0, 1)) - (63.75, 0.0, 255.0)).max() < 4.0
