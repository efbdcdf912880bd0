"""Posed pictures on disk: ``transforms.json`` as instant-ngp and nerfstudio write and read it.

On disk a pose is an OpenGL camera-to-world matrix and pixel centres are at half-integers; in memory
a pose is OpenCV ``T_world_cam`` and pixel centres are integers (``server.geometry``). Lens
distortion is honoured ray by ray: pictures are never resampled for it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from server.drafts import whole_file
from server.geometry.axes import opencv_from_opengl, opengl_from_opencv
from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.nerf.sightings import KnownPixels, known_pixels, read_sightings

Array = NDArray[np.float64]

# Models that are OpenCV's five-parameter one with some or all numbers zero.
_MODELS = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"}
_SUFFIXES = ("", ".png", ".jpg", ".jpeg")
_TRANSFORMS = "transforms.json"
# Cameras closer together than this are at one point.
_SAME_PLACE_M = 1e-6


class DatasetError(ValueError):
    """A folder cannot be used as a dataset; the message says why in one line."""


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Posed pictures, in file order.

    Attributes:
        folder: Where they came from.
        files: Picture files, n of them.
        images: One ``(h, w, 3)`` uint8 RGB picture each, at training size.
        masks: One ``(h, w)`` bool mask each, True on the object, or None where there is none.
        alphas: One ``(h, w)`` uint8 opacity each, where the picture shows the object alone, laid on
            white; None where it shows a room.
        intrinsics: One camera each, of the picture at training size, with its distortion.
        T_world_cam: ``(n, 4, 4)`` OpenCV camera to world, metres.
        object_box: Box around the object, world metres, or None when unknown.
        floor_z: Height of the floor that the object stands on, world metres, None when unknown.
        known: Pixels of each picture at which the distance of a surface is known, often none.
    """

    folder: Path
    files: tuple[Path, ...]
    images: tuple[NDArray[np.uint8], ...]
    masks: tuple[NDArray[np.bool_] | None, ...]
    alphas: tuple[NDArray[np.uint8] | None, ...]
    intrinsics: tuple[Intrinsics, ...]
    T_world_cam: Array
    object_box: Box3 | None
    floor_z: float | None
    known: tuple[KnownPixels, ...]

    def __len__(self) -> int:
        return len(self.files)

    @property
    def cut_out(self) -> bool:
        """Whether every picture shows the object alone, so that there is no room to learn."""
        return all(alpha is not None for alpha in self.alphas)

    @property
    def distances_known(self) -> bool:
        """Whether most pictures have pixels at which the distance of a surface is known."""
        return 2 * sum(len(known.pixels) > 0 for known in self.known) > len(self)


@dataclass(frozen=True, slots=True, eq=False)
class PosedFile:
    """One picture to be written into ``transforms.json``.

    Attributes:
        file: Picture, relative to the dataset's folder.
        T_world_cam: ``(4, 4)`` OpenCV camera to world, metres.
        mask_file: Mask picture (white is object), relative to the folder, or None.
        intrinsics: Its own camera, None for the one of all.
    """

    file: str
    T_world_cam: Array
    mask_file: str | None = None
    intrinsics: Intrinsics | None = None


def load_dataset(
    folder: Path,
    *,
    downscale: int | None = None,
    max_side: int = 960,
    object_only: bool = False,
) -> Dataset:
    """Read ``folder/transforms.json`` and its pictures.

    Args:
        folder: Dataset folder.
        downscale: Divide picture sizes by this whole number; None makes the long side fit
            ``max_side``.
        max_side: Longest side wanted when ``downscale`` is None, pixels.
        object_only: Cut the object out of every picture by its mask. Pictures that are transparent
            around the object are cut out in any case.

    Raises:
        DatasetError: If anything needed is missing, unreadable or makes no sense.
    """
    if downscale is not None and downscale < 1:
        raise DatasetError(f"downscale must be at least 1, not {downscale}")
    description = _read_description(folder)
    frames = description.get("frames")
    if not isinstance(frames, list) or not frames:
        raise DatasetError(f"{folder / _TRANSFORMS} lists no frames")
    if len(frames) < 2:
        raise DatasetError(
            f"{folder / _TRANSFORMS} lists one picture only; at least two are needed"
        )
    files = _find_files(folder, frames)
    poses = np.stack([_read_pose(frame, file) for frame, file in zip(frames, files, strict=True)])
    if np.ptp(poses[:, :3, 3], axis=0).max() < _SAME_PLACE_M:
        raise DatasetError(
            f"all {len(poses)} pictures of {folder} were taken from one point, which shows no depth"
        )
    try:
        sightings = read_sightings(folder)
    except ValueError as error:
        raise DatasetError(str(error)) from error
    images, masks, alphas, cameras, known = [], [], [], [], []
    for number, (frame, file) in enumerate(zip(frames, files, strict=True)):
        image, mask, alpha = _read_picture(folder, frame, file)
        if object_only and alpha is None:
            if mask is None:
                raise DatasetError(f"{file.name} has no mask to cut the object out by")
            alpha = np.asarray(cv2.resize(mask, (image.shape[1], image.shape[0])), np.uint8)
            image = _on_white(image, alpha)
        width_px = image.shape[1]
        camera = _read_intrinsics({**description, **frame}, width_px, image.shape[0], file)
        factor = 1.0 / downscale if downscale else min(1.0, max_side / max(image.shape[:2]))
        camera = camera.scaled(factor) if factor < 1.0 else camera
        size = (camera.width, camera.height)
        if factor < 1.0:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        if mask is not None and mask.shape != image.shape[:2]:
            mask = cv2.resize(mask, size, interpolation=cv2.INTER_AREA)
        images.append(np.ascontiguousarray(image))
        if alpha is not None and alpha.shape != image.shape[:2]:
            alpha = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA)
        masks.append(None if mask is None else mask > 127)
        alphas.append(alpha)
        cameras.append(camera)
        told = known_pixels(sightings, number, width_px, camera, poses[number])
        known.append(told if alpha is None else told.where(alpha > 127))
    return Dataset(
        folder,
        tuple(files),
        tuple(images),
        tuple(masks),
        tuple(alphas),
        tuple(cameras),
        poses,
        _read_box(description),
        _read_floor(description),
        tuple(known),
    )


def write_transforms(
    folder: Path,
    pictures: Sequence[PosedFile],
    intrinsics: Intrinsics,
    object_box: Box3 | None,
    floor_z: float | None = None,
) -> Path:
    """Write ``folder/transforms.json`` so that it is complete or untouched, never half.

    Args:
        folder: Dataset folder, which exists.
        pictures: Pictures in the order they shall have.
        intrinsics: Camera of all that name none of their own.
        object_box: Box around the object, world metres, or None.
        floor_z: Height of the floor, world metres, or None.

    Returns:
        Path of the file.
    """
    frames: list[dict[str, Any]] = []
    for picture in pictures:
        frame: dict[str, Any] = {
            "file_path": picture.file,
            "transform_matrix": opengl_from_opencv(picture.T_world_cam).tolist(),
        }
        if picture.mask_file is not None:
            frame["mask_path"] = picture.mask_file
        if picture.intrinsics is not None:
            frame |= _lens_json(picture.intrinsics)
        frames.append(frame)
    description: dict[str, Any] = {
        "camera_model": "OPENCV",
        **_lens_json(intrinsics),
        "camera_angle_x": 2.0 * float(np.arctan(intrinsics.width / (2.0 * intrinsics.fx))),
        "camera_angle_y": intrinsics.vertical_fov_rad,
        "aabb_scale": 8,
        "frames": frames,
    }
    if object_box is not None:
        description["object_box"] = [object_box.lower.tolist(), object_box.upper.tolist()]
    if floor_z is not None:
        description["floor_z"] = floor_z
    target = folder / _TRANSFORMS
    with whole_file(target) as stream:
        stream.write(json.dumps(description, indent=1).encode())
    return target


def _lens_json(intrinsics: Intrinsics) -> dict[str, float]:
    """Return a camera as instant-ngp and nerfstudio name its numbers."""
    k1, k2, p1, p2, k3 = intrinsics.distortion
    return {
        "w": intrinsics.width,
        "h": intrinsics.height,
        "fl_x": intrinsics.fx,
        "fl_y": intrinsics.fy,
        "cx": intrinsics.cx + 0.5,
        "cy": intrinsics.cy + 0.5,
        "k1": k1,
        "k2": k2,
        "p1": p1,
        "p2": p2,
        "k3": k3,
    }


def _read_description(folder: Path) -> dict[str, Any]:
    path = folder / _TRANSFORMS
    if not path.is_file():
        raise DatasetError(f"{folder} has no {_TRANSFORMS}")
    try:
        description = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        raise DatasetError(f"{path} is not readable JSON: {error}") from error
    if not isinstance(description, dict):
        raise DatasetError(f"{path} is not a JSON object")
    return description


def _find_files(folder: Path, frames: Sequence[Any]) -> list[Path]:
    files: list[Path] = []
    missing: list[str] = []
    for number, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise DatasetError(f"frame {number} of {folder / _TRANSFORMS} has no file_path")
        name = frame["file_path"]
        found = [folder / (name + s) for s in _SUFFIXES if (folder / (name + s)).is_file()]
        files.extend(found[:1])
        missing.extend([] if found else [name])
    if missing:
        raise DatasetError(
            f"{len(missing)} of {len(frames)} pictures are missing, first {missing[0]}"
        )
    return files


def _read_pose(frame: Mapping[str, Any], file: Path) -> Array:
    try:
        T = np.array(frame["transform_matrix"], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise DatasetError(f"pose of {file.name} is missing or not a matrix") from error
    if T.shape == (3, 4):
        T = np.vstack([T, [0.0, 0.0, 0.0, 1.0]])
    if T.shape != (4, 4):
        raise DatasetError(f"pose of {file.name} is not 4x4 but {T.shape}")
    if not np.isfinite(T).all():
        raise DatasetError(f"pose of {file.name} has values that are not finite")
    U, singular, Vt = np.linalg.svd(T[:3, :3])
    if singular[2] < 1e-6 or singular[0] > 1.05 * singular[2] or np.linalg.det(T[:3, :3]) <= 0:
        raise DatasetError(f"pose of {file.name} is singular: its rotation is no rotation")
    T[:3, :3] = U @ Vt
    T[3] = [0.0, 0.0, 0.0, 1.0]
    return opencv_from_opengl(T)


def _read_picture(
    folder: Path, frame: Mapping[str, Any], file: Path
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None, NDArray[np.uint8] | None]:
    """Return RGB picture, mask and opacity; transparency is laid on white and, alone, the mask."""
    raw: Any = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise DatasetError(f"picture {file} cannot be read")
    if raw.dtype != np.uint8:
        raw = (raw / (np.iinfo(raw.dtype).max / 255.0)).astype(np.uint8)
    mask = alpha = None
    if raw.ndim == 2:
        image = np.repeat(raw[:, :, None], 3, axis=2)
    elif raw.shape[2] == 4:
        mask = np.ascontiguousarray(raw[:, :, 3])
        alpha = mask if mask.min() < 255 else None
        image = _on_white(raw[:, :, 2::-1], mask)
    else:
        image = raw[:, :, 2::-1]
    if frame.get("mask_path"):
        mask = cv2.imread(str(folder / str(frame["mask_path"])), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            raise DatasetError(f"mask {frame['mask_path']} of {file.name} cannot be read")
    return image, None if mask is None else np.asarray(mask, np.uint8), alpha


def _on_white(image: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> NDArray[np.uint8]:
    share = alpha[:, :, None] / 255.0
    return np.round(image * share + 255.0 * (1.0 - share)).astype(np.uint8)


def _read_intrinsics(values: Mapping[str, Any], width: int, height: int, file: Path) -> Intrinsics:
    """Return the camera of a ``width`` x ``height`` picture from a frame's merged description."""
    model = values.get("camera_model", "OPENCV")
    if model not in _MODELS or values.get("is_fisheye") or values.get("k4"):
        name = "a fisheye or higher-order model" if model in _MODELS else model
        raise DatasetError(f"camera model of {file.name} is unknown: {name}")
    try:
        w, h = float(values.get("w", width)), float(values.get("h", height))
        if "fl_x" in values:
            fx = float(values["fl_x"])
        elif "camera_angle_x" in values:
            fx = 0.5 * w / float(np.tan(0.5 * float(values["camera_angle_x"])))
        else:
            raise DatasetError(f"{file.name} has neither fl_x nor camera_angle_x")
        fy = float(values.get("fl_y", fx))
        cx, cy = float(values.get("cx", w / 2.0)), float(values.get("cy", h / 2.0))
        names = () if model.endswith("PINHOLE") else ("k1", "k2", "p1", "p2", "k3")
        k1, k2, p1, p2, k3 = (
            float(values.get(name, 0.0)) if name in names else 0.0
            for name in ("k1", "k2", "p1", "p2", "k3")
        )
    except (TypeError, ValueError) as error:
        if isinstance(error, DatasetError):
            raise
        raise DatasetError(f"intrinsics of {file.name} are not numbers: {error}") from error
    numbers = np.array([w, h, fx, fy, cx, cy, k1, k2, p1, p2, k3])
    if not np.isfinite(numbers).all() or min(w, h, fx, fy) <= 0.0:
        raise DatasetError(f"intrinsics of {file.name} are not positive and finite")
    # The file may describe the picture before somebody resized it.
    sx, sy = width / w, height / h
    return Intrinsics(
        width, height, fx * sx, fy * sy, cx * sx - 0.5, cy * sy - 0.5, (k1, k2, p1, p2, k3)
    )


def _read_box(description: Mapping[str, Any]) -> Box3 | None:
    if description.get("object_box") is None:
        return None
    try:
        lower, upper = np.array(description["object_box"], dtype=float).reshape(2, 3)
        return Box3(lower, upper)
    except (TypeError, ValueError) as error:
        raise DatasetError(f"object_box is not two corners: {error}") from error


def _read_floor(description: Mapping[str, Any]) -> float | None:
    told = description.get("floor_z")
    if told is None:
        return None
    if not isinstance(told, int | float) or not np.isfinite(told):
        raise DatasetError(f"floor_z is not a height: {told}")
    return float(told)
