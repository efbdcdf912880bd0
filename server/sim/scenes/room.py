"""The room around the object: floor, walls, ceiling and furniture with their light baked in.

The room is 11 x 11 m and 4.2 m high, the origin in the middle of the floor. Light comes from the
windows in the +Y wall and from lamps under the ceiling; it is multiplied into colours and textures
because the software renderer has no light worth the name.

Symbols: ``n`` vertices; pictures are RGB, row 0 at the top.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from server.sim.meshes import Mesh
from server.sim.scenes.furniture import FOOTPRINTS, furniture
from server.sim.scenes.shapes import grid_faces, sheet
from server.sim.scenes.surfaces import Grid, Noise, Picture, planks, plaster, rug
from server.sim.scenes.surroundings import ORDINARY, Surroundings, floor_picture, wall_picture
from server.sim.scenes.walls import wall_pictures

Array = NDArray[np.float64]

SIDE_M = 11.0
HEIGHT_M = 4.2
_HALF = SIDE_M / 2.0
_TILES = 5
_TILE_M = SIDE_M / _TILES
_STEP_M = 0.3
# Left, top, width, height of the rug in metres; top is measured along -y.
_RUG = (1.9, 1.2, 2.4, 1.7)


def textured_sheet(corner: ArrayLike, across: ArrayLike, up: ArrayLike, picture: Picture) -> Mesh:
    """Return a flat rectangle that shows ``picture`` upright, tessellated, lit for its place."""
    vertices, uv, columns = sheet(corner, across, up, _STEP_M)
    normal = np.cross(np.asarray(across, float), np.asarray(up, float))
    light = room_light(vertices, normal / np.linalg.norm(normal))
    colours = np.clip(255.0 * light, 0, 255).astype(np.uint8)
    faces = grid_faces(len(vertices) // columns, columns)
    alpha = np.full((*picture.shape[:2], 1), 255, np.uint8)
    return Mesh(vertices, faces, colours, uv, np.concatenate([picture, alpha], axis=2))


def room_light(points: Array, normal: Array) -> Array:
    """Return the light ``(n, 3)`` on a surface of the room, 1 leaves its colour as it is."""
    window = np.array([0.5, _HALF, 2.2]) - points
    distance = np.linalg.norm(window, axis=1)
    facing = np.clip(0.35 + 0.65 * (window @ normal) / distance, 0.0, 1.0)
    daylight = 0.40 * facing / (1.0 + (distance / 7.0) ** 2)
    # Corners are darker: less of the room is seen from there.
    gap = np.stack([_HALF - np.abs(points[:, 0]), _HALF - np.abs(points[:, 1]), points[:, 2]], 1)
    gap = np.concatenate([gap, HEIGHT_M - points[:, 2:]], axis=1)
    gap = np.sort(np.maximum(gap, 0.0), axis=1)[:, 1]
    corner = 1.0 - 0.34 * np.exp(-gap / 0.5)
    lamps = 0.66 + 0.12 * np.exp(-(points[:, 0] ** 2 + points[:, 1] ** 2) / 14.0)
    return ((lamps + daylight) * corner)[:, None] * np.array([1.0, 0.985, 0.955])


def room(
    shadow: NDArray[np.float32], seed: int, surroundings: Surroundings = ORDINARY
) -> list[Mesh]:
    """Return the room's surfaces.

    Args:
        shadow: Light that the object leaves on the floor, ``(k, k)`` in [0, 1], row 0 at +y, over
            the 3 x 3 middle tiles; see ``shadow_extent_m``.
        seed: Seed of all textures.
        surroundings: What is other than in the ordinary room.
    """
    softened = 1.0 - np.clip(surroundings.shadow * (1.0 - shadow), 0.0, 1.0)
    meshes = [
        *_floor(softened.astype(np.float32), seed, surroundings),
        *_walls_and_ceiling(seed, surroundings),
        *(furniture(seed, room_light) if surroundings.furniture else ()),
    ]
    if surroundings == ORDINARY:
        return meshes
    return [_relit(mesh, surroundings) for mesh in meshes]


def _relit(mesh: Mesh, surroundings: Surroundings) -> Mesh:
    """Return a surface of the ordinary room in other light."""
    lit = np.asarray(mesh.colours, float) * surroundings.light(np.asarray(mesh.vertices, float))
    colours = np.clip(np.rint(lit), 0, 255).astype(np.uint8)
    return Mesh(mesh.vertices, mesh.faces, colours, mesh.uv, mesh.texture)


def shadow_extent_m() -> float:
    """Return the edge of the square of floor, centred on the origin, that takes the shadow."""
    return 3 * _TILE_M


def _floor(shadow: NDArray[np.float32], seed: int, surroundings: Surroundings) -> list[Mesh]:
    """Return the floor's tiles: fine ones in the middle, coarse ones outside."""
    meshes = []
    for (row, column), picture in _floor_pictures(seed, surroundings).items():
        if 1 <= row <= 3 and 1 <= column <= 3:
            size = picture.shape[0]
            k = shadow.shape[0] // 3
            part = shadow[(row - 1) * k : row * k, (column - 1) * k : column * k]
            fine = cv2.resize(part, (size, size), interpolation=cv2.INTER_LINEAR)
            picture = (picture * fine[..., None]).astype(np.uint8)
        corner = (-_HALF + column * _TILE_M, _HALF - (row + 1) * _TILE_M, 0.0)
        meshes.append(textured_sheet(corner, (_TILE_M, 0, 0), (0, _TILE_M, 0), picture))
    return meshes


@lru_cache(maxsize=2)
def _floor_pictures(seed: int, surroundings: Surroundings) -> dict[tuple[int, int], Picture]:
    """Return the pictures of the floor's tiles by row (from +y) and column (from -x)."""
    noise = Noise(seed)
    pictures = {}
    for row in range(_TILES):
        for column in range(_TILES):
            middle = 1 <= row <= 3 and 1 <= column <= 3
            # Cameras come closest to the tile under the object.
            size = 2048 if (row, column) == (2, 2) else 1024 if middle else 512
            left, top = column * _TILE_M - _HALF, row * _TILE_M - _HALF
            grid = Grid(left, top, _TILE_M, _TILE_M, size, size)
            if surroundings == ORDINARY:
                picture = planks(grid, noise)
            else:
                picture = floor_picture(grid, noise, surroundings)
            if surroundings.rug:
                _lay_rug(picture, left, top, size, noise)
            if surroundings.furniture:
                _shade_under_furniture(picture, left, top, size)
            pictures[row, column] = picture
    return pictures


def _lay_rug(picture: Picture, left: float, top: float, size: int, noise: Noise) -> None:
    """Paint the part of the rug that lies on a tile."""
    x0, y0, width, height = _RUG
    scale = size / _TILE_M
    c0, c1 = (int(np.clip(round((x - left) * scale), 0, size)) for x in (x0, x0 + width))
    r0, r1 = (int(np.clip(round((y - top) * scale), 0, size)) for y in (y0, y0 + height))
    if c1 <= c0 or r1 <= r0:
        return
    whole = Grid(x0, y0, width, height, round(width * scale), round(height * scale))
    full = rug(whole, noise)
    first_c = int(np.clip(round((left - x0) * scale), 0, whole.columns - (c1 - c0)))
    first_r = int(np.clip(round((top - y0) * scale), 0, whole.rows - (r1 - r0)))
    picture[r0:r1, c0:c1] = full[first_r : first_r + r1 - r0, first_c : first_c + c1 - c0]


def _shade_under_furniture(picture: Picture, left: float, top: float, size: int) -> None:
    """Darken the floor around furniture, in place."""
    grid = Grid(left, top, _TILE_M, _TILE_M, size, size)
    x, y = grid.x[None, :], grid.y[:, None]
    for x0, y0, x1, y1 in FOOTPRINTS:
        # The footprint's y is the world's; the picture's grows downwards.
        dx = np.maximum(np.maximum(x0 - x, x - x1), 0.0)
        dy = np.maximum(np.maximum(-y1 - y, y + y0), 0.0)
        if dx.min() > 1.0 or dy.min() > 1.0:
            continue
        light = 1.0 - 0.5 * np.exp(-np.hypot(dx, dy) / 0.18)
        picture[:] = (picture * light[..., None]).astype(np.uint8)


@lru_cache(maxsize=2)
def _walls_and_ceiling(seed: int, surroundings: Surroundings) -> tuple[Mesh, ...]:
    """Return the four walls, three sheets each, and the ceiling."""
    meshes = []
    starts = [(-_HALF, _HALF), (_HALF, _HALF), (_HALF, -_HALF), (-_HALF, -_HALF)]
    directions = [(1, 0), (0, -1), (-1, 0), (0, 1)]
    third = SIDE_M / 3
    for start, direction, picture in zip(
        starts, directions, _walls(seed, surroundings), strict=True
    ):
        along = np.array([*direction, 0.0])
        for k in range(3):
            width = picture.shape[1] // 3
            piece = np.ascontiguousarray(picture[:, k * width : (k + 1) * width])
            corner = np.array([*start, 0.0]) + k * third * along
            meshes.append(textured_sheet(corner, third * along, (0, 0, HEIGHT_M), piece))
        meshes.append(_joint(np.array([*start, 0.0]), along))
    noise = Noise(seed + 5)
    grid = Grid(0, 0, SIDE_M, SIDE_M, 1024, 1024)
    white = plaster(grid, noise, (176, 174, 168), (222, 220, 214))
    # A grid of ceiling panels.
    seam = np.minimum(
        np.abs((grid.x + 0.3) % 0.6 - 0.3)[None, :], np.abs((grid.y + 0.3) % 0.6 - 0.3)[:, None]
    )
    white = (white * (1.0 - 0.35 * (seam < 0.012))[..., None]).astype(np.uint8)
    corner = (-_HALF, _HALF, HEIGHT_M)
    meshes.append(textured_sheet(corner, (SIDE_M, 0, 0), (0, -SIDE_M, 0), white))
    return tuple(meshes)


def _walls(seed: int, surroundings: Surroundings) -> list[Picture]:
    """Return the pictures of the four walls."""
    if surroundings.wall == "furnished":
        return wall_pictures(seed)
    noise = Noise(seed + 1)
    grids = [Grid(20.0 * k, 0.0, SIDE_M, HEIGHT_M, 1536, 512) for k in range(4)]
    return [wall_picture(grid, noise, surroundings, k) for k, grid in enumerate(grids)]


def _joint(start: Array, along: Array) -> Mesh:
    """Return a dark strip along the foot of a wall.

    Floor and wall end in vertices that are snapped to pixels on their own; the strip, a little
    outside and reaching below the floor, keeps the ground from showing in the cracks.
    """
    outward = np.cross(along, [0.0, 0.0, 1.0]) * -0.01
    dark = np.full((8, 8, 3), 70, np.uint8)
    return textured_sheet(
        start + outward - np.array([0, 0, 0.04]), SIDE_M * along, (0, 0, 0.1), dark
    )
