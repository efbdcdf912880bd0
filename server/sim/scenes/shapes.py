"""Building blocks for meshes made in code: grids, boxes, tubes, ellipsoids, extrusions.

Every part is finely tessellated: the renderer snaps vertices to whole pixels, and colours given per
vertex can only carry a pattern as fine as the tessellation. Lengths are metres.

Symbols: ``n`` vertices, ``m`` triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from server.sim.meshes import Mesh, ObjectModel, on_floor

Array = NDArray[np.float64]
Paint = Callable[[Array], Array]


def plain(rgb: Sequence[float]) -> Paint:
    """Return a paint of one colour, RGB in [0, 255]."""
    return lambda points: np.tile(np.asarray(rgb, float), (len(points), 1))


def mottled(rgb: Sequence[float], amount: float, cell_m: float, seed: int) -> Paint:
    """Return ``rgb`` varied by smooth random waves of about ``cell_m``; ``amount`` is relative."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((10, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    frequencies = 2 * np.pi / (cell_m * rng.uniform(0.5, 2.0, 10))
    phases = rng.uniform(0, 2 * np.pi, 10)

    def paint(points: Array) -> Array:
        waves = np.sin(points @ (directions * frequencies[:, None]).T + phases)
        return np.asarray(rgb, float) * (1.0 + amount * waves.mean(axis=1, keepdims=True) * 3.0)

    return paint


def part(vertices: Array, faces: NDArray[np.int64], paint: Paint) -> Mesh:
    """Return a part coloured by ``paint`` at its vertices."""
    colours = np.clip(np.rint(paint(vertices)), 0, 255).astype(np.uint8)
    return Mesh(vertices, faces, colours)


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the triangles of a grid of ``rows`` x ``columns`` vertices, row by row."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None, :]).reshape(-1)
    below = first + columns
    upper = np.stack([first, first + 1, below + 1], axis=1)
    lower = np.stack([first, below + 1, below], axis=1)
    return np.concatenate([upper, lower]).astype(np.int64)


def sheet(
    corner: ArrayLike, across: ArrayLike, up: ArrayLike, step_m: float
) -> tuple[Array, Array, int]:
    """Return a grid: vertices ``(n, 3)``, coordinates ``(n, 2)`` in [0, 1], length of a row."""
    across, up = np.asarray(across, float), np.asarray(up, float)
    columns = max(2, int(np.ceil(np.linalg.norm(across) / step_m)) + 1)
    rows = max(2, int(np.ceil(np.linalg.norm(up) / step_m)) + 1)
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    uv = np.stack([u.reshape(-1), v.reshape(-1)], axis=1)
    return np.asarray(corner, float) + uv[:, :1] * across + uv[:, 1:] * up, uv, columns


def box(size: ArrayLike, paint: Paint, step_m: float, centre: ArrayLike = (0, 0, 0)) -> Mesh:
    """Return an upright box with edge lengths ``size`` around ``centre``."""
    size, centre = np.asarray(size, float), np.asarray(centre, float)
    vertices, faces, count = [], [], 0
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        across, up = np.zeros(3), np.zeros(3)
        across[a], up[b] = size[a], size[b]
        for side in (-0.5, 0.5):
            corner = centre - (across + up) / 2
            corner[axis] += side * size[axis]
            points, _, columns = sheet(corner, across, up, step_m)
            vertices.append(points)
            faces.append(grid_faces(len(points) // columns, columns) + count)
            count += len(points)
    return part(np.concatenate(vertices), np.concatenate(faces), paint)


def tube(
    path: ArrayLike, radii: ArrayLike, paint: Paint, sides: int = 16, squash: float = 1.0
) -> Mesh:
    """Return a closed tube along ``path`` ``(k, 3)`` with ``radii`` ``(k,)``.

    Args:
        path: Centre line.
        radii: Radius at each of its points; zero closes the tube to a tip.
        paint: Colours.
        sides: Vertices around.
        squash: Thickness across the first direction, relative to the other one.
    """
    path, radii = np.asarray(path, float), np.asarray(radii, float)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Carry one direction along the path so that the tube does not twist.
    side = np.cross(along[0], [0.0, 1.0, 0.0] if abs(along[0, 1]) < 0.9 else [1.0, 0.0, 0.0])
    rings = []
    angles = np.linspace(0, 2 * np.pi, sides + 1)
    for point, tangent, radius in zip(path, along, radii, strict=True):
        side = side - tangent * (side @ tangent)
        side /= np.linalg.norm(side)
        other = np.cross(tangent, side)
        circle = squash * np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * other
        rings.append(point + radius * circle)
    closed = [np.tile(path[0], (sides + 1, 1)), *rings, np.tile(path[-1], (sides + 1, 1))]
    return part(np.concatenate(closed), grid_faces(len(closed), sides + 1), paint)


def bone(
    start: ArrayLike, end: ArrayLike, radii: Sequence[float], paint: Paint, **options: float
) -> Mesh:
    """Return a tube from ``start`` to ``end`` whose radius runs smoothly through ``radii``.

    ``options``: ``step_m`` (0.02) tessellation along, ``sides`` (16), ``squash`` (1).
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    count = max(4, int(np.ceil(np.linalg.norm(end - start) / options.get("step_m", 0.02))) + 1)
    t = np.linspace(0, 1, count)
    radius = np.interp(t, np.linspace(0, 1, len(radii)), radii)
    path = start + t[:, None] * (end - start)
    return tube(path, radius, paint, int(options.get("sides", 16)), options.get("squash", 1.0))


def ellipsoid(
    centre: ArrayLike, radii: ArrayLike, paint: Paint, rows: int = 16, columns: int = 24
) -> Mesh:
    """Return an ellipsoid with half axes ``radii`` along x, y, z."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij"
    )
    unit = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    )
    points = np.asarray(centre, float) + unit.reshape(-1, 3) * np.asarray(radii, float)
    return part(points, grid_faces(rows, columns + 1), paint)


def turned(mesh: Mesh, axis: str, angle_deg: float, about: ArrayLike = (0, 0, 0)) -> Mesh:
    """Return ``mesh`` turned about an axis through ``about``."""
    pivot = np.asarray(about, float)
    R = Rotation.from_euler(axis, angle_deg, degrees=True).as_matrix()
    return Mesh(
        (mesh.vertices - pivot) @ R.T + pivot, mesh.faces, mesh.colours, mesh.uv, mesh.texture
    )


def moved(mesh: Mesh, by: ArrayLike) -> Mesh:
    """Return ``mesh`` moved by ``by``."""
    return Mesh(
        mesh.vertices + np.asarray(by, float), mesh.faces, mesh.colours, mesh.uv, mesh.texture
    )


def joined(parts: Sequence[Mesh]) -> Mesh:
    """Return untextured parts as one mesh."""
    starts = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.faces + start for p, start in zip(parts, starts, strict=True)]),
        np.concatenate([p.colours for p in parts]),
    )


def assembled(name: str, parts: Sequence[Mesh]) -> ObjectModel:
    """Return the parts as one object that stands on the floor, without empty triangles."""
    mesh = joined(parts)
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    return ObjectModel(on_floor(mesh.vertices), mesh.faces[area > 1e-12], mesh.colours, name=name)


def rounded_box(
    size: ArrayLike, radius_m: float, paint: Paint, step_m: float, centre: ArrayLike = (0, 0, 0)
) -> Mesh:
    """Return a box whose edges are rounded off with ``radius_m``; painted around the origin."""
    size, centre = np.asarray(size, float), np.asarray(centre, float)
    sharp = box(size, plain((0, 0, 0)), step_m)
    core = np.clip(sharp.vertices, -size / 2 + radius_m, size / 2 - radius_m)
    outward = sharp.vertices - core
    length = np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    vertices = core + outward / length * radius_m
    return moved(part(vertices, sharp.faces, paint), centre)
