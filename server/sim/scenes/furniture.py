"""Furniture along the walls: upright boxes with painted sides.

World axes; every piece is given by its footprint and height in metres.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from server.sim.meshes import Mesh
from server.sim.scenes.shapes import grid_faces, sheet
from server.sim.scenes.surfaces import Grid, Noise, Picture, cloth, toned

Array = NDArray[np.float64]
Light = Callable[[Array, Array], Array]

# x0, y0, x1, y1, bottom, top of every piece, and what its sides show.
_PIECES: tuple[tuple[float, float, float, float, float, float, str], ...] = (
    (-5.45, -3.6, -5.1, -1.6, 0.0, 2.05, "books"),
    (-5.45, 1.2, -4.75, 3.4, 0.0, 0.78, "drawers"),
    (-5.35, 1.5, -5.0, 2.1, 0.78, 1.25, "carton"),
    (5.05, -2.4, 5.45, -0.4, 0.0, 1.9, "books"),
    (4.6, 1.6, 5.45, 3.7, 0.0, 0.45, "sofa"),
    (5.2, 1.6, 5.45, 3.7, 0.45, 0.9, "sofa"),
    (-2.9, -5.45, -1.2, -4.75, 0.0, 0.76, "drawers"),
    (-2.4, -5.35, -2.0, -5.0, 0.76, 1.2, "carton"),
    (3.9, -5.4, 4.5, -4.8, 0.0, 0.6, "carton"),
    (4.6, -5.4, 5.3, -4.7, 0.0, 0.8, "carton"),
    (4.65, -5.3, 5.15, -4.8, 0.8, 1.25, "carton"),
    (-4.9, 4.6, -4.2, 5.3, 0.0, 0.55, "carton"),
)
# Footprints x0, y0, x1, y1 of the pieces that stand on the floor.
FOOTPRINTS = tuple(piece[:4] for piece in _PIECES if piece[4] == 0.0)
_STEP_M = 0.25


def furniture(seed: int, light: Light) -> list[Mesh]:
    """Return all pieces; ``light(points (n, 3), normal (3,))`` gives ``(n, 3)`` factors."""
    noise = Noise(seed + 2)
    return [_piece(piece, k, noise, light) for k, piece in enumerate(_PIECES)]


def _piece(
    piece: tuple[float, float, float, float, float, float, str], k: int, noise: Noise, light: Light
) -> Mesh:
    """Return a box whose four sides and top show the left, right half of one picture."""
    x0, y0, x1, y1, bottom, top, look = piece
    width, depth, height = x1 - x0, y1 - y0, top - bottom
    picture = _looks(look, max(width, depth), height, k, noise)
    sides = [
        ((x0, y0, bottom), (width, 0, 0), (0, 0, height), 0.0),
        ((x1, y0, bottom), (0, depth, 0), (0, 0, height), 0.0),
        ((x1, y1, bottom), (-width, 0, 0), (0, 0, height), 0.0),
        ((x0, y1, bottom), (0, -depth, 0), (0, 0, height), 0.0),
        ((x0, y0, top), (width, 0, 0), (0, depth, 0), 0.5),
    ]
    vertices, faces, colours, uvs, count = [], [], [], [], 0
    for corner, across, up, shift in sides:
        points, uv, columns = sheet(corner, across, up, _STEP_M)
        normal = np.cross(across, up)
        factors = light(points, normal / np.linalg.norm(normal))
        # The narrow sides show a strip of the picture of the same scale.
        span = np.linalg.norm(across) / max(width, depth)
        vertices.append(points)
        colours.append(np.clip(255 * factors, 0, 255).astype(np.uint8))
        uvs.append(np.stack([shift + 0.5 * (0.01 + 0.98 * span * uv[:, 0]), uv[:, 1]], axis=1))
        faces.append(grid_faces(len(points) // columns, columns) + count)
        count += len(points)
    alpha = np.full((*picture.shape[:2], 1), 255, np.uint8)
    return Mesh(
        np.concatenate(vertices),
        np.concatenate(faces),
        np.concatenate(colours),
        np.concatenate(uvs),
        np.concatenate([picture, alpha], axis=2),
    )


def _looks(look: str, width_m: float, height_m: float, k: int, noise: Noise) -> Picture:
    """Return a picture, its left half the sides and its right half the top."""
    grid = Grid(3.0 * k, 0.0, width_m, height_m, 512, 512)
    if look == "books":
        sides = _books(k)
        top = _wood(grid, noise)
    elif look == "drawers":
        sides = _drawers(_wood(grid, noise))
        top = _wood(grid, noise)
    elif look == "sofa":
        sides = top = cloth(grid, noise, (62, 72, 84), (112, 122, 130))
    else:
        sides = _carton(
            toned(0.5 * noise.octaves(grid, 410, 0.3, 5), (142, 108, 72), (188, 154, 112)), k
        )
        top = sides
    return np.ascontiguousarray(np.concatenate([sides, top], axis=1))


def _wood(grid: Grid, noise: Noise) -> Picture:
    value = 0.6 * noise.field(grid, 400, 0.4, 0.012) + 0.4 * noise.octaves(grid, 402, 0.4, 4)
    return toned(0.7 * value, (112, 84, 60), (164, 130, 96))


def _drawers(wood: Picture) -> Picture:
    picture = wood.copy()
    for row in range(2):
        for column in range(3):
            c0, r0 = 12 + column * 166, 20 + row * 240
            cv2.rectangle(picture, (c0, r0), (c0 + 154, r0 + 226), (70, 50, 34), 5)
            cv2.rectangle(picture, (c0 + 52, r0 + 96), (c0 + 102, r0 + 108), (186, 184, 178), -1)
    return picture


def _carton(card: Picture, k: int) -> Picture:
    picture = card.copy()
    cv2.rectangle(picture, (0, 226), (511, 274), (176, 148, 108), -1)
    cv2.putText(picture, f"LAB {k:02d}", (50, 180), cv2.FONT_HERSHEY_DUPLEX, 3.0, (84, 58, 40), 7)
    cv2.rectangle(picture, (290, 320), (460, 440), (226, 224, 216), -1)
    for row in range(336, 430, 16):
        cv2.line(picture, (304, row), (304 + (row * 37) % 130 + 12, row), (60, 60, 66), 4)
    cv2.rectangle(picture, (0, 0), (511, 511), (118, 88, 58), 6)
    return picture


def _books(k: int) -> Picture:
    """Return five shelves full of books."""
    rng = np.random.default_rng(70 + k)
    picture = np.full((512, 512, 3), (52, 40, 30), np.uint8)
    for shelf in range(5):
        floor_row = 98 + shelf * 102
        x = 10
        while x < 495:
            thick, tall = int(rng.integers(7, 22)), int(rng.integers(56, 88))
            cover = _muted(rng.integers(30, 190, 3))
            if rng.random() < 0.12:
                x += thick
                continue
            end = min(x + thick, 500)
            picture[floor_row - tall : floor_row, x:end] = cover
            picture[floor_row - tall : floor_row, x : x + 2] = cover // 2
            label = floor_row - int(tall * rng.uniform(0.45, 0.8))
            picture[label : label + int(rng.integers(5, 14)), x + 2 : end] = rng.integers(
                140, 236, 3
            )
            x = end
        picture[floor_row : floor_row + 7] = (128, 98, 70)
    cv2.rectangle(picture, (0, 0), (511, 511), (120, 92, 66), 14)
    return picture


def _muted(rgb: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a random colour drawn half-way to its own grey: paper and cloth are not neon."""
    return ((rgb + rgb.mean()) / 2.0 * np.array([1.04, 1.0, 0.92])).astype(np.int64)
