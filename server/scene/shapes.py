"""Small geometry and picture conversions for the scene's nodes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.poses import wxyz_from_rotation

Rgb = tuple[int, int, int]

_FALLBACK: Rgb = (150, 150, 150)
# Pairs of corners of ``Box3.corners`` that differ in one coordinate only.
_EDGES = [(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit]
EDGES_PER_BOX = len(_EDGES)


def rgb_from_hex(colour: str) -> Rgb:
    """Return the 8-bit colour of ``#rrggbb``; grey when it is not one."""
    try:
        value = int(colour.removeprefix("#"), 16)
    except ValueError:
        return _FALLBACK
    if len(colour) != 7 or not colour.startswith("#"):
        return _FALLBACK
    return (value >> 16, (value >> 8) & 255, value & 255)


def dimmed(colour: Rgb) -> Rgb:
    """Return ``colour`` three quarters of the way to light grey."""
    red, green, blue = ((channel + 3 * 215) // 4 for channel in colour)
    return (red, green, blue)


def placed(T_world_cam: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the unit quaternion ``(4,)`` wxyz and the position ``(3,)`` of a ``(4, 4)`` pose."""
    return wxyz_from_rotation(T_world_cam[:3, :3]), T_world_cam[:3, 3]


def box_edges(boxes: tuple[Box3, ...]) -> NDArray[np.float32]:
    """Return the edges of ``boxes`` as line segments ``(12 n, 2, 3)``, world metres."""
    corners = [box.corners[np.array(_EDGES)] for box in boxes]
    return np.concatenate(corners).astype(np.float32)


def circle(radius_m: float, height_m: float, pieces: int = 72) -> NDArray[np.float32]:
    """Return a level circle about the world's z axis as segments ``(pieces, 2, 3)``."""
    angles = np.linspace(0.0, 2.0 * np.pi, pieces + 1)
    heights = np.full_like(angles, height_m)
    return path_segments(
        np.stack([radius_m * np.cos(angles), radius_m * np.sin(angles), heights], 1)
    )


def path_segments(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the path through ``points`` ``(n, 3)``, n >= 2, as segments ``(n - 1, 2, 3)``."""
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


def picture_from_jpeg(jpeg: bytes, small: bool = False) -> NDArray[np.uint8]:
    """Return the RGB picture ``(h, w, 3)`` of ``jpeg``, a quarter of its size when ``small``.

    Raises:
        ValueError: If it cannot be decoded.
    """
    flags = cv2.IMREAD_REDUCED_COLOR_4 if small else cv2.IMREAD_COLOR
    data = np.frombuffer(jpeg, np.uint8)
    image_bgr = cv2.imdecode(data, flags) if data.size else None
    if image_bgr is None:
        raise ValueError(f"{len(jpeg)} bytes that are no JPEG")
    return np.ascontiguousarray(image_bgr[:, :, ::-1], np.uint8)


def node_name(text: str) -> str:
    """Return ``text`` as one part of a node's path."""
    return text.replace("/", "_")
