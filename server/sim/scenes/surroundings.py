"""What a bench may vary about the room: floor, walls, furniture and light, drawn from a seed.

A region search that was tuned on one room knows that room. Here every seed gives another one:
colours at random, smooth, grained and tiled floors, plain, striped and crowded walls, light of
another strength, colour and direction, shadows from faint to dark.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from server.sim.scenes.surfaces import Grid, Noise, Picture, bricks, cloth, planks, plaster, toned

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

FLOORS = ("planks", "carpet", "concrete", "tiles", "checks")
WALLS = ("furnished", "plaster", "bricks", "stripes", "posters")
_TILE_EDGE_M, _JOINT_M = 0.35, 0.006
_POSTERS = 14


@dataclass(frozen=True, slots=True)
class Surroundings:
    """One room.

    Attributes:
        seed: Seed of its textures.
        floor: One of ``FLOORS``.
        floor_rgb: Darkest and lightest tone of the floor.
        rug: Whether a patterned rug lies in the room.
        wall: One of ``WALLS``.
        wall_rgb: Darkest and lightest tone of the walls; ``furnished`` keeps its own.
        furniture: Whether shelves and cartons stand along the walls.
        light_rgb: Strength of the light per channel, 1 as in the ordinary room.
        slope: How much brighter it becomes per metre along x and y, as a share.
        shadow: Strength of the object's shadow on the floor, 1 as in the ordinary room.
    """

    seed: int = 0
    floor: str = "planks"
    floor_rgb: tuple[Colour, Colour] = ((104, 80, 58), (184, 152, 116))
    rug: bool = True
    wall: str = "furnished"
    wall_rgb: tuple[Colour, Colour] = ((150, 152, 148), (206, 207, 200))
    furniture: bool = True
    light_rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    slope: tuple[float, float] = (0.0, 0.0)
    shadow: float = 1.0

    def __post_init__(self) -> None:
        if self.floor not in FLOORS:
            raise ValueError(f"floor must be one of {', '.join(FLOORS)}, got {self.floor!r}")
        if self.wall not in WALLS:
            raise ValueError(f"wall must be one of {', '.join(WALLS)}, got {self.wall!r}")
        if min(self.light_rgb) <= 0.0:
            raise ValueError("light_rgb must be above zero")
        if not 0.0 <= self.shadow <= 2.0:
            raise ValueError("shadow must lie between 0 and 2")

    def light(self, points: Array) -> Array:
        """Return the factors ``(n, 3)`` on the ordinary room's light at ``points`` ``(n, 3)``."""
        along = 1.0 + points[:, 0] * self.slope[0] + points[:, 1] * self.slope[1]
        return np.clip(along, 0.4, 1.8)[:, None] * np.asarray(self.light_rgb)


ORDINARY = Surroundings()


def random_surroundings(seed: int) -> Surroundings:
    """Return the room of a seed."""
    rng = np.random.default_rng(seed)
    warmth = rng.normal(0.0, 0.06)
    gain = rng.uniform(0.65, 1.15)
    floor, wall = rng.choice(FLOORS), rng.choice(WALLS)
    return Surroundings(
        seed=seed,
        floor=str(floor),
        floor_rgb=_two_tones(rng, 16.0 if floor in ("carpet", "concrete") else 30.0),
        rug=bool(rng.random() < 0.3),
        wall=str(wall),
        wall_rgb=_two_tones(rng, 22.0),
        furniture=bool(rng.random() < 0.6),
        light_rgb=(gain * (1.0 + warmth), gain, gain * (1.0 - warmth)),
        slope=(float(rng.uniform(-0.06, 0.06)), float(rng.uniform(-0.06, 0.06))),
        shadow=float(rng.uniform(0.4, 1.5)),
    )


def _two_tones(rng: np.random.Generator, contrast: float) -> tuple[Colour, Colour]:
    """Return a muted darker and lighter tone, ``contrast`` levels to both sides of their mean."""
    grey = rng.uniform(55.0, 205.0)
    middle = grey + rng.normal(0.0, 14.0, 3)
    half = contrast * rng.uniform(0.5, 1.2)
    dark, light = (np.clip(middle + sign * half, 8, 250).astype(int) for sign in (-1.0, 1.0))
    return (int(dark[0]), int(dark[1]), int(dark[2])), (int(light[0]), int(light[1]), int(light[2]))


def floor_picture(grid: Grid, noise: Noise, room: Surroundings) -> Picture:
    """Return a part of the floor."""
    dark, light = room.floor_rgb
    if room.floor == "planks":
        return _recoloured(planks(grid, noise), dark, light)
    if room.floor == "carpet":
        return cloth(grid, noise, dark, light)
    if room.floor == "concrete":
        return plaster(grid, noise, dark, light)
    column = np.floor(grid.x / _TILE_EDGE_M).astype(np.int64)[None, :]
    row = np.floor(grid.y / _TILE_EDGE_M).astype(np.int64)[:, None]
    grain = 0.35 * noise.octaves(grid, 500, 0.08, 4, 0.7)
    if room.floor == "checks":
        return toned(grain + ((row + column) % 2) * 1.6 - 0.8, dark, light)
    tones = np.random.default_rng(room.seed).normal(0.0, 0.35, 4096).astype(np.float32)
    picture = toned(grain + tones[(row * 71 + column * 29) % 4096], dark, light)
    across = np.abs(grid.x / _TILE_EDGE_M - np.round(grid.x / _TILE_EDGE_M))[None, :]
    along = np.abs(grid.y / _TILE_EDGE_M - np.round(grid.y / _TILE_EDGE_M))[:, None]
    joint = np.minimum(across, along) * _TILE_EDGE_M < _JOINT_M
    return np.where(joint[..., None], (0.6 * picture).astype(np.uint8), picture)


def wall_picture(grid: Grid, noise: Noise, room: Surroundings, number: int) -> Picture:
    """Return one of the four walls of a room that is not ``furnished``."""
    dark, light = room.wall_rgb
    if room.wall == "bricks":
        return _recoloured(bricks(grid, noise), dark, light)
    picture = plaster(grid, noise, dark, light)
    if room.wall == "stripes":
        stripe = np.sin(grid.x * (2.0 * np.pi / 0.6))[None, :, None] > 0.0
        return (picture * np.where(stripe, 1.0, 0.8)).astype(np.uint8)
    if room.wall == "posters":
        _hang_posters(picture, np.random.default_rng((room.seed, number)))
    return picture


def _recoloured(picture: Picture, dark: Colour, light: Colour) -> Picture:
    """Return the picture's pattern between two other tones."""
    grey = picture.mean(axis=2)
    return toned((grey - grey.mean()) / (2.0 * max(float(grey.std()), 1.0)), dark, light)


def _hang_posters(picture: Picture, rng: np.random.Generator) -> None:
    """Paint rectangles of random colour with a random print on a wall, in place."""
    rows, columns = picture.shape[:2]
    for _ in range(_POSTERS):
        width, height = int(columns * rng.uniform(0.03, 0.1)), int(rows * rng.uniform(0.1, 0.4))
        left = int(rng.integers(0, columns - width))
        top = int(rng.integers(0, max(int(0.9 * rows) - height, 1)))
        colour = tuple(int(c) for c in rng.integers(20, 235, 3))
        cv2.rectangle(picture, (left, top), (left + width, top + height), colour, -1)
        for _ in range(4):
            ink = tuple(int(c) for c in rng.integers(20, 235, 3))
            x, y = left + int(rng.integers(0, width)), top + int(rng.integers(0, height))
            radius = int(0.2 * min(width, height))
            cv2.circle(
                picture[top : top + height, left : left + width],
                (x - left, y - top),
                radius,
                ink,
                -1,
            )
