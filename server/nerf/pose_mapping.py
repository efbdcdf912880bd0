"""Structure from motion with pycolmap: pictures and pairs in, models in frames of their own out.

COLMAP keeps world-to-camera poses and puts the centre of the top-left pixel at (0.5, 0.5); both
are translated here and nowhere else.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import inverse
from server.nerf.pose_config import PoseConfig

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

_EXTRACTION_BATCH = 12
_PAIR_BATCH = 120


class PosesStoppedError(Exception):
    """The caller asked to stop."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A connected reconstruction in a frame of its own (arbitrary origin, attitude and scale).

    Attributes:
        indices: Which pictures it holds ``(m,)``, ascending.
        T_model_cam: Their poses ``(m, 4, 4)``.
        points_model: Triangulated points ``(p, 3)``.
        observations: One row per observation ``(o, 4)``: position in ``indices``, row of
            ``points_model``, x and y in pixels (pixel centres).
    """

    indices: NDArray[np.int_]
    T_model_cam: Array
    points_model: Array
    observations: Array


def _camera_text(intrinsics: Intrinsics) -> tuple[str, str]:
    """Return COLMAP's camera model and parameter list of ``intrinsics``."""
    values = [intrinsics.fx, intrinsics.fy, intrinsics.cx + 0.5, intrinsics.cy + 0.5]
    model = "PINHOLE"
    if any(intrinsics.distortion):
        model = "FULL_OPENCV"
        values += [*intrinsics.distortion, 0.0, 0.0, 0.0]
    return model, ",".join(repr(float(v)) for v in values)


class Mapper:
    """One reconstruction job: features, matches and mapping in a database in ``work_folder``.

    Args:
        files: The pictures.
        intrinsics: Camera of each picture, as it was calibrated.
        drone: Number of the drone of each picture: its pictures with equal intrinsics share a
            camera.
        work_folder: A folder of this job's own; a database in it is replaced.
        config: Settings.
        on_progress: Called with what is being done and its share in 0..1.
        should_stop: Asked often; True ends the job with ``PosesStoppedError``.
    """

    def __init__(
        self,
        files: Sequence[Path],
        intrinsics: Sequence[Intrinsics],
        drone: Sequence[int],
        work_folder: Path,
        config: PoseConfig,
        on_progress: Progress,
        should_stop: Callable[[], bool],
    ) -> None:
        self._config = config
        self._on_progress = on_progress
        self._should_stop = should_stop
        self._cameras = list(zip(drone, intrinsics, strict=True))
        self._names = [f"{i:05d}{file.suffix.lower()}" for i, file in enumerate(files)]
        self._index_of = {name: i for i, name in enumerate(self._names)}
        self._root = work_folder / "pictures"
        self._database = work_folder / "features.db"
        self._pairs_file = work_folder / "pairs.txt"
        self._models = work_folder / "models"
        for leftover in work_folder.glob("features.db*"):
            leftover.unlink()
        for folder in (self._root, self._models):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        # COLMAP's pair lists are separated by blanks, so pictures get plain names of their own.
        for file, name in zip(files, self._names, strict=True):
            shutil.copyfile(file, self._root / name)
        # COLMAP reports every step on stderr; what matters comes back as values.
        pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
        pycolmap.set_random_seed(config.seed)

    def _check_stop(self) -> None:
        if self._should_stop():
            raise PosesStoppedError

    def extract(self) -> None:
        """Find SIFT features in every picture."""
        options = pycolmap.FeatureExtractionOptions()
        options.num_threads = self._config.threads
        options.use_gpu = False
        options.max_image_size = self._config.max_image_size_px
        options.sift.max_num_features = self._config.max_features
        options.sift.first_octave = self._config.first_octave
        options.sift.peak_threshold = self._config.peak_threshold
        done = 0
        for camera in dict.fromkeys(self._cameras):
            names = [
                name for name, own in zip(self._names, self._cameras, strict=True) if own == camera
            ]
            reader = pycolmap.ImageReaderOptions()
            reader.camera_model, reader.camera_params = _camera_text(camera[1])
            for first in range(0, len(names), _EXTRACTION_BATCH):
                self._check_stop()
                batch = names[first : first + _EXTRACTION_BATCH]
                pycolmap.extract_features(
                    self._database,
                    self._root,
                    batch,
                    pycolmap.CameraMode.SINGLE,
                    reader,
                    options,
                    pycolmap.Device.cpu,
                )
                if reader.existing_camera_id == -1:
                    with pycolmap.Database.open(self._database) as database:
                        image = database.read_image_with_name(batch[0])
                    # None where COLMAP cannot read what OpenCV can; the next batch then tells.
                    if image is not None:
                        reader.existing_camera_id = image.camera_id
                done += len(batch)
                self._on_progress("features", done / len(self._names))

    def match(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Match and geometrically verify ``pairs`` of picture indices."""
        matching = pycolmap.FeatureMatchingOptions()
        matching.num_threads = self._config.threads
        matching.use_gpu = False
        matching.sift.max_ratio = self._config.max_match_ratio
        verification = pycolmap.TwoViewGeometryOptions()
        verification.min_num_inliers = self._config.min_pair_matches
        verification.detect_watermark = False
        verification.ransac.max_error = self._config.max_epipolar_error_px
        verification.ransac.random_seed = self._config.seed
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = self._pairs_file
        for first in range(0, len(pairs), _PAIR_BATCH):
            self._check_stop()
            batch = pairs[first : first + _PAIR_BATCH]
            lines = [f"{self._names[i]} {self._names[j]}\n" for i, j in batch]
            self._pairs_file.write_text("".join(lines), encoding="utf-8")
            pycolmap.match_image_pairs(
                self._database, matching, pairing, verification, pycolmap.Device.cpu
            )
            self._on_progress("matches", (first + len(batch)) / len(pairs))

    def _mapping_options(self) -> pycolmap.IncrementalPipelineOptions:
        config = self._config
        angle_deg = math.degrees(config.min_triangulation_angle_rad)
        options = pycolmap.IncrementalPipelineOptions()
        options.num_threads = config.threads
        options.random_seed = config.seed
        options.extract_colors = False
        options.min_num_matches = config.min_pair_matches
        options.min_model_size = config.min_model_pictures
        options.ba_refine_focal_length = False
        options.ba_refine_extra_params = False
        options.ba_local_max_num_iterations = 15
        options.ba_global_max_num_iterations = 25
        options.ba_global_frames_ratio = 1.3
        options.ba_global_points_ratio = 1.3
        options.ba_global_max_refinements = 2
        mapper = options.mapper
        mapper.random_seed = config.seed
        mapper.num_threads = config.threads
        mapper.init_min_num_inliers = 3 * config.min_resection_matches
        mapper.init_min_tri_angle = 6.0
        mapper.abs_pose_min_num_inliers = config.min_resection_matches
        mapper.abs_pose_min_inlier_ratio = 0.15
        mapper.abs_pose_max_error = 3.0 * config.max_reprojection_error_px
        mapper.abs_pose_refine_focal_length = False
        mapper.abs_pose_refine_extra_params = False
        mapper.filter_max_reproj_error = config.mapping_error_px
        mapper.filter_min_tri_angle = angle_deg
        options.triangulation.min_angle = angle_deg
        options.triangulation.random_seed = config.seed
        options.triangulation.complete_max_reproj_error = config.mapping_error_px
        options.triangulation.merge_max_reproj_error = config.mapping_error_px
        return options

    def map(self) -> list[Model]:
        """Reconstruct; the models come largest first, each with ``min_model_pictures`` or more."""
        token = pycolmap.CancellationToken()
        registered = 0

        def on_picture() -> None:
            nonlocal registered
            registered += 1
            self._on_progress("mapping", min(1.0, registered / len(self._names)))
            if self._should_stop():
                token.cancel()

        models = pycolmap.incremental_mapping(
            self._database,
            self._root,
            self._models,
            self._mapping_options(),
            next_image_callback=on_picture,
            cancellation_token=token,
        )
        if token.is_cancelled:
            raise PosesStoppedError
        found = [self._read(model) for _, model in sorted(models.items())]
        found = [m for m in found if len(m.indices) >= self._config.min_model_pictures]
        return sorted(found, key=lambda m: -len(m.indices))

    def clean(self) -> None:
        """Remove the copied pictures; database and models stay for whoever wants to look."""
        shutil.rmtree(self._root, ignore_errors=True)

    def _read(self, reconstruction: pycolmap.Reconstruction) -> Model:
        images = {
            self._index_of[reconstruction.image(i).name]: reconstruction.image(i)
            for i in reconstruction.reg_image_ids()
        }
        indices = np.array(sorted(images), int)
        T_cam_model = np.tile(np.eye(4), (len(indices), 1, 1))
        point_ids = sorted(reconstruction.point3D_ids())
        row_of = {point_id: row for row, point_id in enumerate(point_ids)}
        observations: list[tuple[float, float, float, float]] = []
        for position, index in enumerate(indices):
            T_cam_model[position, :3] = images[index].cam_from_world().matrix()
            for point in images[index].get_observation_points2D():
                x, y = point.xy
                observations.append((position, row_of[point.point3D_id], x - 0.5, y - 0.5))
        return Model(
            indices,
            inverse(T_cam_model),
            np.array([reconstruction.point3D(i).xyz for i in point_ids]).reshape(-1, 3),
            np.array(observations).reshape(-1, 4),
        )
