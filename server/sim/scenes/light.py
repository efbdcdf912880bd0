"""Light on the object and its shadow on the floor, computed once and baked into colours.

Symbols: ``n`` vertices, ``m`` triangles, ``r`` sky directions.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from server.sim.meshes import Mesh, ObjectModel

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_DIRECTIONS = 28
_KEY = np.array([0.35, 0.75, 0.56]) / np.linalg.norm([0.35, 0.75, 0.56])
_FILL = np.array([-0.7, -0.4, 0.6]) / np.linalg.norm([-0.7, -0.4, 0.6])
# Vertices start their rays a little off the surface, so that they do not hit their own triangles.
_OFFSET_M = 0.004
_SHADOW_PX = 768


def lit_colours(model: ObjectModel) -> Bytes:
    """Return the object's colours ``(n, 3)`` with soft light multiplied in.

    Half-open sky light with occlusion by the object itself, a key light from the windows and a weak
    one from the other side. The winding is not trusted: of a vertex's two sides the more open one
    is lit.
    """
    surface = model.trimesh
    normals = _vertex_normals(model)
    sky = _fibonacci_sphere(_DIRECTIONS)
    openness, outward = _openness(model, normals, sky)
    normals = normals * outward[:, None]
    # A single vertex's openness is noisy; its triangles' neighbours smooth it.
    openness = _smoothed(openness, surface.faces, len(normals), rounds=2)
    key = np.clip(normals @ _KEY, 0.0, 1.0)
    fill = np.clip(normals @ _FILL, 0.0, 1.0)
    ambient = 0.40 + 0.16 * normals[:, 2]
    light = openness * (ambient + 0.50 * key + 0.20 * fill) + 0.16
    return np.clip(np.rint(model.colours * light[:, None]), 0, 255).astype(np.uint8)


def _vertex_normals(mesh: Mesh) -> Array:
    """Return unit normals ``(n, 3)``, smooth across shared vertices only."""
    corners = mesh.vertices[mesh.faces]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(total, mesh.faces[:, k], face)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def _openness(model: ObjectModel, normals: Array, sky: Array) -> tuple[Array, Array]:
    """Return the open share of the sky in [0, 1] over each vertex and the sign of its open side."""
    ray = model.trimesh.ray
    n = len(normals)
    open_share = []
    for sign in (1.0, -1.0):
        origins = model.vertices + sign * _OFFSET_M * normals
        facing = sign * (normals @ sky.T)
        which, direction = np.nonzero(facing > 0.05)
        hit = np.asarray(ray.intersects_any(origins[which], sky[direction]), bool)
        weight = facing[which, direction]
        free = np.bincount(which, weight * ~hit, n) / np.maximum(
            np.bincount(which, weight, n), 1e-9
        )
        open_share.append(free)
    outward = np.where(open_share[0] >= open_share[1], 1.0, -1.0)
    return np.maximum(open_share[0], open_share[1]), outward


def _fibonacci_sphere(count: int) -> Array:
    """Return ``(count, 3)`` evenly spread unit vectors."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    angle = np.pi * (1.0 + np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _smoothed(values: Array, faces: NDArray[np.int64], count: int, rounds: int) -> Array:
    """Return per-vertex values averaged over the triangles around each vertex, ``rounds`` times."""
    flat = np.asarray(faces).reshape(-1)
    members = np.maximum(np.bincount(flat, minlength=count), 1)
    for _ in range(rounds):
        means = values[faces].mean(axis=1)
        around = np.bincount(flat, np.repeat(means, 3), count) / members
        values = 0.5 * values + 0.5 * around
    return values


def floor_shadow(model: ObjectModel, extent_m: float, seed: int) -> NDArray[np.float32]:
    """Return how much light the object leaves on the floor, ``(k, k)`` in [0, 1].

    Parts of the object darken the floor below them, the more the closer they are, and the softer
    the higher they are.

    Args:
        model: The object.
        extent_m: Edge of the square of floor, centred on the origin; row 0 is at +y.
        seed: Seed of the sampling.
    """
    rng = np.random.default_rng(seed)
    corners = model.vertices[model.faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    picks = rng.choice(len(area), 60_000, p=area / area.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), len(picks))
    points = (corners[picks] * weights[:, :, None]).sum(axis=1)
    light = np.ones((_SHADOW_PX, _SHADOW_PX), np.float32)
    scale = _SHADOW_PX / extent_m
    layers = (
        (0.0, 0.05, 0.30),
        (0.05, 0.15, 0.26),
        (0.15, 0.4, 0.26),
        (0.4, 0.9, 0.2),
        (0.9, 2.1, 0.14),
    )
    for lower, upper, strength in layers:
        inside = points[(points[:, 2] >= lower) & (points[:, 2] < upper)]
        if len(inside) == 0:
            continue
        # The key light pushes the shadow away from the windows.
        fallen = inside[:, :2] - 0.3 * inside[:, 2:] * _KEY[:2] / _KEY[2]
        column = ((fallen[:, 0] + extent_m / 2) * scale).astype(np.int64)
        row = ((extent_m / 2 - fallen[:, 1]) * scale).astype(np.int64)
        inside_px = (column >= 0) & (column < _SHADOW_PX) & (row >= 0) & (row < _SHADOW_PX)
        cover = np.zeros_like(light)
        cover[row[inside_px], column[inside_px]] = 1.0
        cover = cv2.morphologyEx(cover, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        sigma = max(1.5, 0.45 * (lower + upper) / 2 * scale)
        light *= 1.0 - strength * np.minimum(1.0, 1.3 * cv2.GaussianBlur(cover, (0, 0), sigma))
    return light
