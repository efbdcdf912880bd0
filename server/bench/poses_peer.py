"""The peer of ``dronerf bench poses``: pycolmap as it comes, on the stills alone."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import inverse

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PeerPoses:
    """What plain structure from motion finds.

    Attributes:
        indices: Pictures of its largest model ``(m,)``.
        T_model_cam: Their poses ``(m, 4, 4)`` in a frame of its own.
    """

    indices: NDArray[np.int_]
    T_model_cam: Array


def plain_poses(files: list[Path], camera: Intrinsics, threads: int) -> PeerPoses:
    """Return pycolmap's poses of ``files``: its own settings, every pair, the known calibration."""
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    pycolmap.set_random_seed(0)
    with tempfile.TemporaryDirectory(prefix="dronerf-peer-") as name:
        folder = Path(name)
        (folder / "pictures").mkdir()
        for number, file in enumerate(files):
            shutil.copyfile(file, folder / "pictures" / f"{number:05d}{file.suffix}")
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = "FULL_OPENCV"
        values = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, *camera.distortion]
        reader.camera_params = ",".join(repr(float(v)) for v in [*values, 0.0, 0.0, 0.0])
        extraction = pycolmap.FeatureExtractionOptions()
        extraction.num_threads = threads
        extraction.use_gpu = False
        database = folder / "features.db"
        pycolmap.extract_features(
            database,
            folder / "pictures",
            camera_mode=pycolmap.CameraMode.SINGLE,
            reader_options=reader,
            extraction_options=extraction,
            device=pycolmap.Device.cpu,
        )
        matching = pycolmap.FeatureMatchingOptions()
        matching.num_threads = threads
        matching.use_gpu = False
        pycolmap.match_exhaustive(database, matching_options=matching, device=pycolmap.Device.cpu)
        options = pycolmap.IncrementalPipelineOptions()
        options.num_threads = threads
        models = pycolmap.incremental_mapping(database, folder / "pictures", folder, options)
        return _largest(list(models.values()))


def _largest(models: list[pycolmap.Reconstruction]) -> PeerPoses:
    if not models:
        return PeerPoses(np.zeros(0, int), np.zeros((0, 4, 4)))
    model = max(models, key=lambda m: len(m.reg_image_ids()))
    images = sorted((model.image(i) for i in model.reg_image_ids()), key=lambda image: image.name)
    T_cam_model = np.tile(np.eye(4), (len(images), 1, 1))
    for row, image in enumerate(images):
        T_cam_model[row, :3] = image.cam_from_world().matrix()
    return PeerPoses(np.array([int(image.name[:5]) for image in images]), inverse(T_cam_model))
