"""Pinhole camera with OpenCV's five-parameter distortion.

Pixel coordinates are pixel centres: the centre of the top-left pixel is ``(0, 0)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.poses import inverse, transform_points

Array = NDArray[np.float64]

_NOWHERE_PX = 1e9


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Intrinsics of one camera, in pixels of a ``width`` x ``height`` picture.

    Attributes:
        width: Picture width in pixels.
        height: Picture height in pixels.
        fx: Focal length along x, pixels.
        fy: Focal length along y, pixels.
        cx: Principal point x, pixels (pixel-centre convention).
        cy: Principal point y, pixels (pixel-centre convention).
        distortion: OpenCV ``(k1, k2, p1, p2, k3)``; all zero means a pure pinhole.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def K(self) -> Array:
        """The ``(3, 3)`` camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def vertical_fov_rad(self) -> float:
        """Full vertical field of view in radians."""
        return float(2.0 * np.arctan(self.height / (2.0 * self.fy)))

    def scaled(self, factor: float) -> Intrinsics:
        """Return the intrinsics of the same picture resized by ``factor``."""
        width, height = round(self.width * factor), round(self.height * factor)
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )

    def project(self, points_world: Array, T_world_cam: Array) -> tuple[Array, Array]:
        """Project ``points_world`` ``(n, 3)``.

        Returns:
            Pixels ``(n, 2)`` and depths ``(n,)`` along the optical axis in metres; pixels of points
            with depth <= 0 are NaN.
        """
        points_cam = transform_points(inverse(T_world_cam), np.asarray(points_world, float))
        return self.pixels_of(points_cam), points_cam[:, 2]

    def pixels_of(self, points_cam: Array) -> Array:
        """Return the pixels ``(n, 2)`` of points in the camera's frame; NaN at depths <= 0."""
        depths = points_cam[:, 2]
        in_front = np.where(depths > 1e-9, depths, np.nan)
        pixels = self._distorted(points_cam[:, :2] / in_front[:, None])
        pixels *= (self.fx, self.fy)
        pixels += (self.cx, self.cy)
        return pixels

    def _distorted(self, xy: Array) -> Array:
        """Return where the lens shows the tangents ``(n, 2)`` of a pinhole: OpenCV's polynomial.

        ``cv2.projectPoints`` works out Jacobians as well, which takes five times as long.
        """
        if not any(self.distortion):
            return xy
        k1, k2, p1, p2, k3 = self.distortion
        x, y = xy.T
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=1,
        )

    def directions(self, pixels: Array) -> Array:
        """Return unit directions ``(n, 3)`` in the camera frame of ``pixels`` ``(n, 2)``."""
        pixels = np.ascontiguousarray(pixels, float).reshape(-1, 1, 2)
        normalised = cv2.undistortPoints(pixels, self.K, np.array(self.distortion)).reshape(-1, 2)
        rays = np.concatenate([normalised, np.ones((len(normalised), 1))], axis=1)
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def contains(self, pixels: Array, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Return which ``pixels`` ``(n, 2)`` lie in the picture, at least ``margin_px`` inside."""
        with np.errstate(invalid="ignore"):
            return (
                (pixels[:, 0] >= margin_px)
                & (pixels[:, 0] <= self.width - 1 - margin_px)
                & (pixels[:, 1] >= margin_px)
                & (pixels[:, 1] <= self.height - 1 - margin_px)
            )


def whole_pixels(pixels: Array) -> NDArray[np.int64]:
    """Return the nearest whole pixels ``(n, 2)``; -1 for what is nowhere near a picture."""
    return np.where(np.abs(pixels) < _NOWHERE_PX, np.round(pixels), -1.0).astype(np.int64)


# The calibration of a Tello's video that most public code shares, rounded and centred.
TELLO_INTRINSICS = Intrinsics(960, 720, 921.0, 921.0, 479.5, 359.5)
TELLO_TILT_RAD = float(np.deg2rad(12.0))
