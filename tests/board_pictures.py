"""Pictures of calibration boards taken by known cameras, distortion included."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.vision.calibration_board import Board, BoardFinder, BoardView, draw_board

TEXTURE_PX_PER_MM = 4.0
SUPERSAMPLE = 2
WALL = 150


class BoardCamera:
    """Renders a board: every ray of a supersampled picture is met with the board's plane."""

    def __init__(self, intrinsics: Intrinsics, board: Board) -> None:
        self.intrinsics = intrinsics
        self.board = board
        fine = intrinsics.scaled(SUPERSAMPLE)
        x, y = np.meshgrid(np.arange(fine.width), np.arange(fine.height))
        rays = fine.directions(np.stack([x.ravel(), y.ravel()], axis=1).astype(float))
        self._rays = (rays / rays[:, 2:]).reshape(fine.height, fine.width, 3)
        pattern = draw_board(board, TEXTURE_PX_PER_MM)
        border = round(10 * TEXTURE_PX_PER_MM)
        self._px_per_m = 1000.0 * pattern.shape[1] / (board.squares[0] * board.square_mm)
        self._border = border
        self._texture = cv2.copyMakeBorder(
            pattern, border, border, border, border, cv2.BORDER_CONSTANT, value=255
        )

    def picture(self, R_cam_board: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray:
        """Return the BGR picture of the board at a pose."""
        # Points of a ray: depth * ray = R (u, v, 0) + t; dotted with the normal gives the depth.
        normal = R_cam_board[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (normal @ t) / (self._rays @ normal)
        on_board = (self._rays * depth[..., None] - t) @ R_cam_board
        at = on_board[..., :2] * self._px_per_m + self._border - 0.5
        at[~(depth > 0)] = -1e4
        at = np.nan_to_num(at, nan=-1e4).astype(np.float32)
        grey = cv2.remap(
            self._texture,
            np.ascontiguousarray(at[..., 0]),
            np.ascontiguousarray(at[..., 1]),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=WALL,
        )
        size = (self.intrinsics.width, self.intrinsics.height)
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)

    def aimed(
        self,
        middle: tuple[float, float],
        distance_m: float,
        turned_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the pose that shows the board's middle at shares ``middle`` of the picture."""
        R_cam_board = np.asarray(cv2.Rodrigues(np.radians(turned_deg))[0], np.float64)
        pixel = np.array([middle]) * (self.intrinsics.width, self.intrinsics.height)
        ray = self.intrinsics.directions(pixel)[0]
        centre = np.array([*self.board.squares, 0]) * self.board.square_mm / 2000.0
        return R_cam_board, ray / ray[2] * distance_m - R_cam_board @ centre


def various_poses(
    camera: BoardCamera, count: int, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield poses as somebody careful would hold a board: all over the picture, well tilted."""
    width_m = camera.board.squares[0] * camera.board.square_mm / 1000.0
    for index in range(count):
        middle = (0.25 + 0.5 * ((index % 3) / 2), 0.3 + 0.4 * ((index // 3 % 3) / 2))
        tilt = rng.uniform(15, 35, 2) * rng.choice((-1, 1), 2)
        fill = rng.uniform(0.45, 0.65)
        distance = camera.intrinsics.fx * width_m / (fill * camera.intrinsics.width)
        yield camera.aimed(middle, distance, (*tilt, rng.uniform(-20, 20)))


def found_views(camera: BoardCamera, count: int, seed: int, noise: float = 2.0) -> list[BoardView]:
    """Return what the finder sees in ``count`` pictures with some sensor noise."""
    rng = np.random.default_rng(seed)
    finder = BoardFinder(camera.board)
    views = []
    for index, pose in enumerate(various_poses(camera, count, rng)):
        picture = camera.picture(*pose)
        picture = np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
        view = finder.find(picture, f"{index:02d}.png")
        if view is not None:
            views.append(view)
    return views
