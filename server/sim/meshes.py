"""The object in the middle of the simulated room: its mesh and its colours.

Symbols: ``n`` vertices, ``m`` triangles. Positions are world metres, +Z up, the object stands on z
= 0 with its bounding box centred on x = y = 0. Texture coordinates are OpenGL's: v grows upwards,
row 0 of a texture picture is v = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]


class SceneError(ValueError):
    """A scene that cannot be shown; its text is one line fit for an operator."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Coloured triangles anywhere in the world.

    Attributes:
        vertices: ``(n, 3)`` world metres.
        faces: ``(m, 3)`` int indices; winding is not to be relied upon.
        colours: ``(n, 3)`` uint8 RGB, multiplied with the texture where there is one.
        uv: ``(n, 2)`` texture coordinates, or None without a texture.
        texture: ``(h, w, 4)`` uint8 RGBA, or None; texels with alpha below one half are not drawn.

    Raises:
        ValueError: If the shapes do not fit each other or a vertex is not finite.
    """

    vertices: Array
    faces: NDArray[np.int64]
    colours: Bytes
    uv: Array | None = None
    texture: Bytes | None = None

    def __post_init__(self) -> None:
        n = len(self.vertices)
        if self.vertices.shape != (n, 3) or not np.isfinite(self.vertices).all():
            raise ValueError("vertices must be (n, 3) and finite")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or len(self.faces) == 0:
            raise ValueError("faces must be (m, 3) with m > 0")
        if self.faces.min() < 0 or self.faces.max() >= n:
            raise ValueError("faces must index vertices")
        if self.colours.shape != (n, 3) or self.colours.dtype != np.uint8:
            raise ValueError("colours must be (n, 3) uint8")
        if (self.uv is None) != (self.texture is None):
            raise ValueError("uv and texture come together")
        if self.uv is not None and self.uv.shape != (n, 2):
            raise ValueError("uv must be (n, 2)")

    @cached_property
    def trimesh(self) -> trimesh.Trimesh:
        """The same surface for ray casting; vertices and faces keep their order."""
        return trimesh.Trimesh(self.vertices, self.faces, process=False)


@dataclass(frozen=True, eq=False)
class ObjectModel(Mesh):
    """The object: a mesh that stands on z = 0, its bounding box centred in x and y.

    Attributes:
        name: Name of the scene, or the file's stem.
    """

    name: str = "object"

    @property
    def size_m(self) -> Array:
        """Edge lengths ``(3,)`` of the bounding box, metres."""
        return np.ptp(self.vertices, axis=0)


def on_floor(vertices: Array) -> Array:
    """Return ``vertices`` ``(n, 3)`` moved so that they stand on z = 0, centred in x and y."""
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    middle = (lower + upper) / 2.0
    return vertices - np.array([middle[0], middle[1], lower[2]])
