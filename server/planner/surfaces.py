"""Surface samples of the seed geometry.

The seed geometry is a union of upright boxes; its surface is what of their faces no other box
covers. Symbols: samples have ``points`` and outward ``normals`` ``(s, 3)`` in the world, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3

Array = NDArray[np.float64]

# Samples are tested this far off their face: far above rounding, far below any real thickness.
_OFF_FACE_M = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """The surface of the seed geometry in small patches.

    Attributes:
        points: Patch centres ``(s, 3)``, world metres.
        normals: Outward unit normals ``(s, 3)``, world.
        areas_m2: Patch areas ``(s,)``.
        concavity: ``(s,)`` share of the half-space above the patch that the object itself blocks.
    """

    points: Array
    normals: Array
    areas_m2: Array
    concavity: Array

    def __len__(self) -> int:
        return len(self.points)


def sample_surface(boxes: Sequence[Box3], wanted: int) -> SurfaceSamples:
    """Cut the outer surface of the union of ``boxes`` into about ``wanted`` patches.

    Raises:
        ValueError: If there are no boxes or none has a surface.
    """
    total = sum(2.0 * (b.size[[0, 1, 2]] * b.size[[1, 2, 0]]).sum() for b in boxes)
    if not boxes or total <= 0:
        raise ValueError("the seed geometry has no surface to sample")
    spacing = float(np.sqrt(total / wanted))
    points, normals, areas = _exposed_patches(boxes, spacing)
    # Covered faces are gone now; a second pass with the spacing that this count asks for.
    spacing *= float(np.sqrt(max(len(points), 1) / wanted))
    points, normals, areas = _exposed_patches(boxes, spacing)
    if len(points) == 0:
        raise ValueError("the seed geometry has no surface to sample")
    return SurfaceSamples(points, normals, areas, _concavity(points, normals, boxes))


def segments_blocked(starts: Array, ends: Array, boxes: Sequence[Box3]) -> NDArray[np.bool_]:
    """Return which segments from ``starts`` to ``ends``, both ``(n, 3)``, pass through a box."""
    along = ends - starts
    along = np.where(np.abs(along) < 1e-12, 1e-12, along)
    blocked = np.zeros(len(starts), bool)
    for box in boxes:
        t_low, t_high = (box.lower - starts) / along, (box.upper - starts) / along
        enter = np.minimum(t_low, t_high).max(axis=1)
        leave = np.maximum(t_low, t_high).min(axis=1)
        blocked |= np.maximum(enter, 0.0) < np.minimum(leave, 1.0) - 1e-9
    return blocked


def even_directions(count: int) -> Array:
    """Return ``count`` nearly even unit directions ``(count, 3)``, along a golden spiral."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * index
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _exposed_patches(boxes: Sequence[Box3], spacing: float) -> tuple[Array, Array, Array]:
    points, normals, areas = [], [], []
    for index, box in enumerate(boxes):
        face_points, face_normals, face_areas = _face_patches(box, spacing)
        above = face_points + _OFF_FACE_M * face_normals
        below = face_points - _OFF_FACE_M * face_normals
        keep = np.ones(len(face_points), bool)
        for other_index, other in enumerate(boxes):
            if other_index == index:
                continue
            covered = other.contains(above)
            if other_index < index:
                # Two boxes with faces in one plane own the common part once: the first has it.
                covered = covered | other.contains(below)
            keep &= ~covered
        points.append(face_points[keep])
        normals.append(face_normals[keep])
        areas.append(face_areas[keep])
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


def _face_patches(box: Box3, spacing: float) -> tuple[Array, Array, Array]:
    """Return patch centres, normals ``(n, 3)`` and areas ``(n,)`` on all six faces of one box."""
    points, normals, areas = [], [], []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        if box.size[u] <= 0 or box.size[v] <= 0:
            continue
        nu, nv = (max(1, round(float(box.size[a]) / spacing)) for a in (u, v))
        steps_u = box.lower[u] + (np.arange(nu) + 0.5) * box.size[u] / nu
        steps_v = box.lower[v] + (np.arange(nv) + 0.5) * box.size[v] / nv
        grid_u, grid_v = (g.ravel() for g in np.meshgrid(steps_u, steps_v, indexing="ij"))
        for sign, corner in ((-1.0, box.lower), (1.0, box.upper)):
            face = np.empty((nu * nv, 3))
            face[:, u], face[:, v], face[:, axis] = grid_u, grid_v, corner[axis]
            normal = np.zeros(3)
            normal[axis] = sign
            points.append(face)
            normals.append(np.tile(normal, (nu * nv, 1)))
            areas.append(np.full(nu * nv, box.size[u] * box.size[v] / (nu * nv)))
    if not points:
        return np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    return np.concatenate(points), np.concatenate(normals), np.concatenate(areas)


def _concavity(points: Array, normals: Array, boxes: Sequence[Box3]) -> Array:
    """Return the share ``(s,)`` of directions above each patch that the object itself blocks."""
    lower = np.min([b.lower for b in boxes], axis=0)
    upper = np.max([b.upper for b in boxes], axis=0)
    reach = float(np.linalg.norm(upper - lower))
    directions = even_directions(48)
    starts = points + _OFF_FACE_M * normals
    blocked, total = np.zeros(len(points)), np.zeros(len(points))
    for direction in directions:
        facing = normals @ direction
        # Grazing directions say nothing about a hollow; the cosine weighs them down.
        weight = np.maximum(facing, 0.0)
        blocked += weight * segments_blocked(starts, starts + reach * direction, boxes)
        total += weight
    return blocked / total
