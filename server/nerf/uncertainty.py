"""How little a field knows of the object's surface, asked by rays from outside.

A ray tells two things. Where it ends is a distribution, the weights ``w_i`` of its n samples and
the light ``T`` that passes them all; its entropy says how unsure the field is of the place (Lee et
al. 2022, "Uncertainty guided policy for active robotic 3D reconstruction using neural radiance
fields"):

    H = -(sum_i w_i ln w_i + T ln T) / ln(n + 1).

A surface that no picture shows can still be sharp: the inner side of one that is shown from the
other side. So the pictures count, too, each by the light that reaches it from there through the
field, and by how straight it looks there:

    E = sum_k T_k max(0, cos angle(towards camera k, towards the ray's origin)),
    u = 1 - (1 - H) (1 - exp(-E)).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.nerf.training import Trainer

Array = NDArray[np.float64]

_RAYS = 600
_SAMPLES = 64
_SAMPLES_TO_CAMERA = 32
# On its way to a camera light leaves the surface it came from, which is not what hides it: so much
# of the box's diagonal is skipped.
_OFF_SURFACE = 0.05
# A ray that most light passes has met no surface.
_MET = 0.5
# The box is known to some centimetres: it is grown by this share of its largest side.
_AROUND = 0.1
# The floor is no part of the object: so much of the box's height above its foot is left out.
_ABOVE_FLOOR = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class KnownSurface:
    """What a field knows of an object's surface, in places.

    Attributes:
        points: ``(n, 3)`` world metres.
        normals: ``(n, 3)`` unit, back along the rays that asked: on average those of the surface.
        uncertainty: ``(n,)`` 0 (known) to 1.
    """

    points: Array
    normals: Array
    uncertainty: Array


def known_surface(trainer: Trainer, box: Box3, rng: np.random.Generator) -> KnownSurface:
    """Return what the field knows of the surface of what is in ``box``.

    Args:
        trainer: The field, and the pictures that it was trained on.
        box: Around the object, world metres.
        rng: Chooses the rays.
    """
    space = _around(box)
    directions, targets = _rays(box, rng)
    enter, leave = _crossing(space, targets, directions)
    # From a target inside the box both ends are found; the ray begins where it comes in.
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    along = enter[:, None] + (leave - enter)[:, None] * share
    places = targets[:, None] + along[..., None] * directions[:, None]
    densities = trainer.densities_at(places.reshape(-1, 3)).reshape(along.shape)
    thickness = densities * ((leave - enter) / _SAMPLES)[:, None]
    before = np.cumsum(thickness, axis=1) - thickness
    weights = np.exp(-before) * (1.0 - np.exp(-thickness))
    light = np.exp(-thickness.sum(axis=1))
    met = light < _MET
    weights, light, directions, along = weights[met], light[met], directions[met], along[met]
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    points = targets[met] + (shares * along).sum(axis=1)[:, None] * directions
    entropy = ending_entropy(weights, light)
    evidence = _evidence(trainer, points, -directions, float(np.linalg.norm(box.size)))
    unknown = 1.0 - (1.0 - entropy) * (1.0 - np.exp(-evidence))
    return KnownSurface(points, -directions, np.clip(unknown, 0.0, 1.0))


def ending_entropy(weights: Array, light: Array) -> Array:
    """Return H ``(n,)`` of rays by weights ``(n, samples)`` and the light that passes ``(n,)``."""
    return -(_xlogx(weights).sum(axis=1) + _xlogx(light)) / np.log(weights.shape[1] + 1.0)


def _around(box: Box3) -> Box3:
    grown = box.grown(_AROUND * float(box.size.max()))
    foot = box.lower[2] + _ABOVE_FLOOR * box.size[2]
    return Box3(np.append(grown.lower[:2], foot), grown.upper)


def _rays(box: Box3, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return directions ``(n, 3)`` from all sides but below, and what they aim at ``(n, 3)``."""
    directions = rng.normal(size=(_RAYS, 3))
    directions[:, 2] = -np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lower = np.append(box.lower[:2], box.lower[2] + 2.0 * _ABOVE_FLOOR * box.size[2])
    return directions, rng.uniform(lower, box.upper, (_RAYS, 3))


def _crossing(box: Box3, origins: Array, directions: Array) -> tuple[Array, Array]:
    """Return where lines enter and leave ``box`` ``(n,)``, metres along from ``origins`` in it."""
    along = np.where(np.abs(directions) < 1e-9, 1e-9, directions)
    one, other = (box.lower - origins) / along, (box.upper - origins) / along
    return np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)


def _evidence(trainer: Trainer, points: Array, normals: Array, diagonal_m: float) -> Array:
    """Return E ``(n,)`` of the pictures that the field is trained on."""
    total = np.zeros(len(points))
    dataset = trainer.dataset
    skip_m = _OFF_SURFACE * diagonal_m
    share = (np.arange(_SAMPLES_TO_CAMERA) + 0.5) / _SAMPLES_TO_CAMERA
    for index in trainer.training_pictures:
        T, camera = dataset.T_world_cam[index], dataset.intrinsics[index]
        towards = T[:3, 3] - points
        distance = np.linalg.norm(towards, axis=1)
        towards /= distance[:, None]
        straight = (towards * normals).sum(axis=1)
        pixels, depths = camera.project(points, T)
        shown = np.flatnonzero((straight > 0.0) & (depths > 0.0) & camera.contains(pixels))
        if len(shown) == 0:
            continue
        # Beyond the object's own size nothing but air is between it and a camera.
        end_m = np.minimum(skip_m + diagonal_m, distance[shown])
        step_m = np.maximum(end_m - skip_m, 0.0)[:, None]
        way = points[shown, None] + (skip_m + step_m * share)[..., None] * towards[shown, None]
        densities = trainer.densities_at(way.reshape(-1, 3)).reshape(way.shape[:2])
        thickness = densities * step_m / _SAMPLES_TO_CAMERA
        total[shown] += straight[shown] * np.exp(-thickness.sum(axis=1))
    return total


def _xlogx(values: Array) -> Array:
    return values * np.log(np.maximum(values, 1e-12))
