"""Real photographs with published poses: disturbed, and refined back."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.bench.poses_figures import pose_errors
from server.nerf.dataset import load_dataset
from server.nerf.pose_config import PoseConfig
from server.nerf.poses import PosedPicture, refine_poses
from server.nerf.space import focus_point

Array = NDArray[np.float64]

_DATASET = Path("photos") / "banana_15"
_TURN_RAD, _MOVE_SHARE = np.deg2rad(8.0), 0.08


def photograph_figures(seed: int, threads: int) -> dict[str, Any] | None:
    """Return how well the photographs' poses come back, None without the test data.

    Every camera is turned by 8 degrees about, and moved by 8 % of its distance into, a random
    direction. Positions are judged as shares of the median camera distance.
    """
    folder = Path(os.environ.get("DRONERF_TEST_DATA", "")) / _DATASET
    if not (folder / "transforms.json").is_file():
        return None
    dataset = load_dataset(folder, max_side=1 << 14)
    T_true = dataset.T_world_cam
    centre = focus_point(T_true)
    distance = float(np.median(np.linalg.norm(T_true[:, :3, 3] - centre, axis=1)))
    believed = disturbed(T_true, distance, np.random.default_rng([seed, 15]))
    pictures = [
        PosedPicture(file, T, _MOVE_SHARE * distance, _TURN_RAD, True, "camera", float(i))
        for i, (file, T) in enumerate(zip(dataset.files, believed, strict=True))
    ]
    begun_s = time.process_time()
    with tempfile.TemporaryDirectory(prefix="dronerf-photographs-") as work:
        refined = refine_poses(
            pictures,
            list(dataset.intrinsics),
            Path(work),
            PoseConfig(threads=threads, seed=seed),
            lambda _step, _share: None,
            lambda: False,
        )
    before, after = pose_errors(believed, T_true), pose_errors(refined.T_world_cam, T_true)
    return {
        "pictures": len(pictures),
        "refined": int(refined.refined.sum()),
        "start_rotation_deg_p50": round(float(np.median(before.rotation_deg)), 3),
        "rotation_deg_p50": round(float(np.median(after.rotation_deg)), 4),
        "rotation_deg_max": round(float(after.rotation_deg.max()), 4),
        "translation_share_p50": round(float(np.median(after.translation_m)) / distance, 5),
        "translation_share_max": round(float(after.translation_m.max()) / distance, 5),
        "cpu_seconds": round(time.process_time() - begun_s, 1),
        "message": refined.message,
    }


def disturbed(T_world_cam: Array, distance: float, rng: np.random.Generator) -> Array:
    """Return poses ``(n, 4, 4)`` turned by 8 degrees and moved by 8 % of ``distance``."""
    turns, moves = rng.normal(size=(2, len(T_world_cam), 3))
    turns *= _TURN_RAD / np.linalg.norm(turns, axis=1, keepdims=True)
    moves *= _MOVE_SHARE * distance / np.linalg.norm(moves, axis=1, keepdims=True)
    out = T_world_cam.copy()
    out[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix() @ out[:, :3, :3]
    out[:, :3, 3] += moves
    return out
