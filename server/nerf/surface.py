"""The object's surface, cut out of the field: triangles with a colour at every corner.

The field is looked at from its pictures' cameras, and what they see is fused: every cell of a grid
keeps the mean signed distance to the surface along the sight lines (Curless, Levoy, "A volumetric
method for building complex models from range images", 1996), out of which marching cubes
(Lorensen, Cline 1987) make triangles. Depths of several views agree where the field's own density
is too soft for a threshold. Cells outside the object's part of the field are empty, so that floor
and table do not come along.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.measure import marching_cubes

from server.geometry.cameras import Intrinsics, whole_pixels
from server.nerf.object_part import ObjectPart
from server.nerf.rendering import Rendering
from server.nerf.training import Trainer

Array = NDArray[np.float64]

# Cells along the longest side of the object's box.
CELLS = 160
# Signed distances are cut off at so many cells; what lies further behind a surface is not seen.
_REACH_CELLS = 3.0
# Samples per ray: depths want more than a picture does.
_SAMPLES = 32
# Where less of the light meets something there is nothing.
_SOLID = 0.35
# Pieces with fewer triangles than this share of the largest one's are specks in the air.
_SPECK_SHARE = 0.02


class NoSurfaceError(ValueError):
    """The field shows no surface where the object should be."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Triangles with coloured corners.

    Attributes:
        vertices: Corners ``(n, 3)``, world metres.
        faces: Triangles ``(m, 3)``, corners counter-clockwise seen from outside.
        normals: ``(n, 3)`` of unit length, pointing outwards.
        colours: sRGB ``(n, 3)`` uint8, the mean of what the views show.
    """

    vertices: Array
    faces: NDArray[np.int64]
    normals: Array
    colours: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """What the field shows of the object's box from one camera."""

    camera: Intrinsics
    T_world_cam: Array
    seen: Rendering

    def at(self, points: Array) -> tuple[NDArray[np.bool_], NDArray[np.int64], Array]:
        """Return which of ``points`` ``(n, 3)`` it sees; rows and columns, and distances of these.

        The second is ``(m, 2)``, the third ``(m,)`` in metres from the camera.
        """
        pixels, depths = self.camera.project(points, self.T_world_cam)
        columns, rows = whole_pixels(pixels).T
        inside = (columns >= 0) & (columns < self.camera.width)
        inside &= (rows >= 0) & (rows < self.camera.height) & (depths > 0.0)
        places = np.stack([rows[inside], columns[inside]], axis=1)
        away = np.linalg.norm(points[inside] - self.T_world_cam[:3, 3], axis=1)
        return inside, places, away


def extract_surface(
    trainer: Trainer, cells: int = CELLS, on_progress: Callable[[float], None] | None = None
) -> Surface:
    """Return the surface of the object in a trained field.

    Args:
        trainer: The field.
        cells: Cells along the longest side of the object's box; they are cubes.
        on_progress: Told the share that is done.

    Raises:
        NoSurfaceError: If there is none.
    """
    part = trainer.object_part(cells)
    views: list[_View] = []
    for index in range(len(trainer.dataset)):
        view = _look(trainer, index, part)
        views += [] if view is None else [view]
        if on_progress is not None:
            on_progress((index + 1) / len(trainer.dataset))
    distances = np.ones(part.cells.shape, np.float32)
    distances[part.cells] = _fused(part.points(), views, _REACH_CELLS * part.cell_m)
    if distances.min() >= 0.0:
        raise NoSurfaceError("the field shows no surface where the object should be")
    corners, faces, _, _ = marching_cubes(distances, 0.0)
    vertices, faces = _without_specks(part.corner + part.cell_m * corners, faces)
    normals = _normals(vertices, faces)
    colours = _colours(vertices, normals, views, _REACH_CELLS * part.cell_m)
    return Surface(vertices, faces, normals, colours)


def _look(trainer: Trainer, index: int, part: ObjectPart) -> _View | None:
    """Render the object as picture ``index`` has it, about a pixel per cell; None if outside."""
    T = trainer.dataset.T_world_cam[index]
    whole = trainer.dataset.intrinsics[index]
    distance_m = max(float(np.linalg.norm(part.box.centre - T[:3, 3])), 1e-6)
    whole = whole.scaled(min(1.0, distance_m / part.cell_m / whole.fx))
    pixels, depths = whole.project(part.box.corners, T)
    if (depths <= 0.0).any():
        return None
    left, top = np.maximum(np.floor(pixels.min(axis=0)), 0).astype(int)
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + 1
    right, bottom = min(right, whole.width), min(bottom, whole.height)
    if right - left < 2 or bottom - top < 2:
        return None
    camera = Intrinsics(
        int(right - left),
        int(bottom - top),
        whole.fx,
        whole.fy,
        whole.cx - left,
        whole.cy - top,
        whole.distortion,
    )
    seen = trainer.render(camera, T, samples_per_ray=_SAMPLES, only=part)
    return _View(camera, T, seen)


def _fused(points: Array, views: list[_View], reach_m: float) -> NDArray[np.float32]:
    """Return the mean signed distances ``(n,)``, in reaches, negative inside.

    What no view sees, because a surface hides it from all, is inside.
    """
    total = np.zeros(len(points), np.float32)
    count = np.zeros(len(points), np.float32)
    for view in views:
        inside, places, away = view.at(points)
        rows, columns = places.T
        ahead = (view.seen.depth_m[rows, columns] - away) / reach_m
        ahead = np.where(view.seen.opacity[rows, columns] > _SOLID, ahead, 1.0)
        told = ahead > -1.0
        index = np.flatnonzero(inside)[told]
        total[index] += np.minimum(ahead[told], 1.0)
        count[index] += 1.0
    return np.where(count > 0.0, total / np.maximum(count, 1.0), np.float32(-1.0))


def _colours(
    vertices: Array, normals: Array, views: list[_View], reach_m: float
) -> NDArray[np.uint8]:
    """Return the mean colours ``(n, 3)`` of ``vertices`` ``(n, 3)`` in the views that see them.

    The straighter a view looks at a place, the more it counts.
    """
    total, weight = np.zeros((len(vertices), 3)), np.full(len(vertices), 1e-9)
    for view in views:
        inside, places, away = view.at(vertices)
        rows, columns = places.T
        towards = (view.T_world_cam[:3, 3] - vertices[inside]) / away[:, None]
        facing = np.maximum((towards * normals[inside]).sum(axis=1), 0.0) ** 2
        facing[np.abs(view.seen.depth_m[rows, columns] - away) > reach_m] = 0.0
        facing[view.seen.opacity[rows, columns] < _SOLID] = 0.0
        # Whoever nobody sees takes the colour of what hides it.
        facing += 1e-6
        total[inside] += facing[:, None] * view.seen.rgb[rows, columns]
        weight[inside] += facing
    return np.round(np.clip(total / weight[:, None], 0.0, 1.0) * 255.0).astype(np.uint8)


def _without_specks(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Return the mesh without pieces that are tiny beside the largest."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    joined = coo_array(
        (np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(len(vertices),) * 2
    )
    _, piece_of = connected_components(joined, directed=False)
    sizes = np.bincount(piece_of[faces[:, 0]])
    faces = faces[sizes[piece_of[faces[:, 0]]] >= _SPECK_SHARE * sizes.max()]
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(faces.shape)


def _normals(vertices: Array, faces: NDArray[np.int64]) -> Array:
    """Return the normals of the corners, triangles weighted by their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    of_faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], of_faces)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
