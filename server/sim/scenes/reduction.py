"""Reducing a mesh by vertex clustering with quadric representatives.

Vertices are sorted into the cubes of a grid; each cube keeps one vertex, placed where it is closest
to the planes of all triangles that met in the cube (Lindstrom, "Out-of-core simplification of large
polygonal models", SIGGRAPH 2000). Texture coordinates and colours are averaged per cube and chart,
so that seams of the texture stay sharp. The method needs no consistent winding and no closed
surface.

Symbols: ``n`` vertices, ``m`` triangles, ``c`` occupied cubes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# Pull towards the mean of the cube's vertices where the planes leave a direction open.
_REGULARISATION = 3e-2


def reduced(
    vertices: Array, faces: Ints, attributes: Array, max_faces: int
) -> tuple[Array, Ints, Array]:
    """Return a coarser mesh of at most ``max_faces`` triangles.

    Args:
        vertices: ``(n, 3)`` metres.
        faces: ``(m, 3)``.
        attributes: ``(n, k)`` values to carry along, as texture coordinates and colours.
        max_faces: Upper limit; a mesh below it is returned as it is.

    Returns:
        Vertices, faces and attributes; some vertices share a place because a texture seam runs
        there.
    """
    if len(faces) <= max_faces:
        return vertices, faces, attributes
    vertices, faces, attributes = _welded(vertices, faces, attributes)
    size = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    # The count grows as the cube shrinks: bisect on the logarithm of the cube's edge.
    fine, coarse = size / 1000.0, size / 16.0
    while len(_surviving(_cubes(vertices, coarse)[faces])) > max_faces:
        fine, coarse = coarse, 2.0 * coarse
    for _ in range(12):
        middle = float(np.sqrt(fine * coarse))
        if len(_surviving(_cubes(vertices, middle)[faces])) > max_faces:
            fine = middle
        else:
            coarse = middle
    return _clustered(vertices, faces, attributes, coarse)


def _welded(vertices: Array, faces: Ints, attributes: Array) -> tuple[Array, Ints, Array]:
    """Merge equal vertices: many files store three of their own for every triangle."""
    rows = np.concatenate([vertices, attributes], axis=1).astype(np.float32)
    rows = np.ascontiguousarray(rows + np.float32(0.0))  # Minus zero becomes zero.
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).reshape(-1)
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return vertices[first], inverse.reshape(-1)[faces], attributes[first]


def _cubes(vertices: Array, edge_m: float) -> Ints:
    """Return the number of the occupied cube of every vertex ``(n,)``."""
    keys = np.floor((vertices - vertices.min(axis=0)) / edge_m + 0.5).astype(np.int64)
    spans = keys.max(axis=0) + 1
    flat = (keys[:, 0] * spans[1] + keys[:, 1]) * spans[2] + keys[:, 2]
    return np.unique(flat, return_inverse=True)[1].reshape(-1)


def _surviving(corner_cubes: Ints) -> Ints:
    """Return indices of one triangle per set of three different cubes."""
    a, b, c = corner_cubes.T
    alive = np.flatnonzero((a != b) & (b != c) & (c != a))
    keys = np.sort(corner_cubes[alive], axis=1)
    # A lattice of cubes has far fewer than 2**21 members, so three fit into one 64-bit key.
    flat = (keys[:, 0] << 42) | (keys[:, 1] << 21) | keys[:, 2]
    return alive[np.unique(flat, return_index=True)[1]]


def _charts(count: int, faces: Ints) -> Ints:
    """Return the connected component of every vertex in the triangle graph ``(n,)``."""
    rows = np.concatenate([faces[:, 0], faces[:, 1]])
    columns = np.concatenate([faces[:, 1], faces[:, 2]])
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _clustered(
    vertices: Array, faces: Ints, attributes: Array, edge_m: float
) -> tuple[Array, Ints, Array]:
    """Merge all vertices of a cube of ``edge_m`` metres; see ``reduced``."""
    cubes = _cubes(vertices, edge_m)
    places = _representatives(vertices, faces, cubes, edge_m)
    kept = faces[_surviving(cubes[faces])]
    charts = _charts(len(vertices), faces)
    pairs = cubes * (charts.max() + 1) + charts
    _, first, corner = np.unique(pairs, return_index=True, return_inverse=True)
    corner = corner.reshape(-1)
    counts = np.bincount(corner).astype(float)
    means = np.stack(
        [np.bincount(corner, attributes[:, k]) / counts for k in range(attributes.shape[1])], axis=1
    )
    new_faces = corner[kept]
    used, flat = np.unique(new_faces, return_inverse=True)
    return places[cubes[first]][used], flat.reshape(-1, 3).astype(np.int64), means[used]


def _representatives(vertices: Array, faces: Ints, cubes: Ints, edge_m: float) -> Array:
    """Return the place ``(c, 3)`` of every cube's vertex nearest to its planes."""
    count = int(cubes.max()) + 1
    members = np.bincount(cubes, minlength=count).astype(float)
    mean = (
        np.stack([np.bincount(cubes, vertices[:, k], count) for k in range(3)], 1)
        / members[:, None]
    )
    corners = vertices[faces]
    # Length of the cross product is twice the area: big triangles count more.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    unit = normals / np.maximum(area, 1e-30)[:, None]
    outer = area[:, None, None] * unit[:, :, None] * unit[:, None, :]
    A = np.zeros((count, 3, 3))
    b = np.zeros((count, 3))
    for k in range(3):
        cube = cubes[faces[:, k]]
        # Heights over the cube's mean keep the numbers small.
        height = ((corners[:, 0] - mean[cube]) * unit).sum(axis=1) * area
        np.add.at(A, cube, outer)
        np.add.at(b, cube, height[:, None] * unit)
    weight = _REGULARISATION * np.trace(A, axis1=1, axis2=2) + 1e-12
    A[:, np.arange(3), np.arange(3)] += weight[:, None]
    offset = np.linalg.solve(A, b[:, :, None])[:, :, 0]
    return mean + np.clip(offset, -edge_m / 2.0, edge_m / 2.0)
