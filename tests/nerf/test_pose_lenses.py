"""Lenses found with the poses come back from disk, picture by picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from server.nerf.dataset import PosedFile, load_dataset, write_transforms
from tests.nerf.pose_room import CAMERA, ring


def test_each_picture_keeps_its_own_lens(tmp_path: Path) -> None:
    poses, _ = ring(1, 3, 0.3)
    longer = replace(CAMERA, fx=1.01 * CAMERA.fx, fy=1.01 * CAMERA.fy, cx=CAMERA.cx + 2.0)
    bent = replace(CAMERA, distortion=(-0.03, 0.1, 0.001, -0.006, 0.0))
    lenses = [None, longer, bent]
    files = []
    for k, (pose, lens) in enumerate(zip(poses, lenses, strict=True)):
        name = f"{k}.png"
        cv2.imwrite(str(tmp_path / name), np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8))
        files.append(PosedFile(name, pose, None, lens))
    write_transforms(tmp_path, files, CAMERA, None)
    read = load_dataset(tmp_path).intrinsics
    for lens, back in zip(lenses, read, strict=True):
        wanted = lens or CAMERA
        assert (back.fx, back.fy, back.cx, back.cy) == pytest.approx(
            (wanted.fx, wanted.fy, wanted.cx, wanted.cy)
        )
        assert back.distortion == pytest.approx(wanted.distortion)
