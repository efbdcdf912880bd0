"""How little a field knows of the object's surface, asked by rays from outside.

A ray tells two things. Where it ends is a distribution, the weights ``w_i`` of its samples and the
light ``T`` that passes them all; its entropy says how unsure the field is of the place (Lee et al.
2022, "Uncertainty guided policy for active robotic 3D reconstruction using neural radiance
fields", equation 5):

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
_OFF_SURFACE = 0.04
# A ray that most light passes has met no surface.
_MET = 0.5
# The box is known to some centimetres: rays are followed this much of its size beyond it.
_AROUND = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class KnownSurface:
    """What a field knows of an object's surface, in places.

    Attributes:
        points: ``(n, 3)`` world metres.
        normals: ``(n, 3)`` unit, towards where it was looked at from.
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
    directions, targets = _rays(box, rng)
    reach = (0.5 + _AROUND) * float(np.linalg.norm(box.size))
    away = np.linspace(-reach, reach, _SAMPLES)
    step_m = float(away[1] - away[0])
    along = targets[:, None] + away[None, :, None] * directions[:, None]
    thickness = trainer.densities_at(along.reshape(-1, 3)).reshape(along.shape[:2]) * step_m
    grown = box.grown(_AROUND * float(box.size.max()))
    thickness[~grown.contains(along.reshape(-1, 3)).reshape(thickness.shape)] = 0.0
    before = np.cumsum(thickness, axis=1) - thickness
    weights = np.exp(-before) * (1.0 - np.exp(-thickness))
    light = np.exp(-thickness.sum(axis=1))
    met = light < _MET
    weights, light, directions = weights[met], light[met], directions[met]
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-9)
    points = targets[met] + (shares @ away)[:, None] * directions
    entropy = -(_xlogx(weights).sum(axis=1) + _xlogx(light)) / np.log(_SAMPLES + 1.0)
    evidence = _evidence(trainer, points, -directions, reach)
    unknown = 1.0 - (1.0 - entropy) * (1.0 - np.exp(-evidence))
    return KnownSurface(points, -directions, np.clip(unknown, 0.0, 1.0))


def _rays(box: Box3, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return directions ``(n, 3)`` from all sides but below, and what they aim at ``(n, 3)``."""
    directions = rng.normal(size=(_RAYS, 3))
    directions[:, 2] = -np.abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions, rng.uniform(box.lower, box.upper, (_RAYS, 3))


def _evidence(trainer: Trainer, points: Array, normals: Array, reach: float) -> Array:
    """Return E ``(n,)`` of the pictures that the field is trained on."""
    total = np.zeros(len(points))
    dataset = trainer.dataset
    stations = reach * np.linspace(2.0 * _OFF_SURFACE, 2.0, _SAMPLES_TO_CAMERA)
    step_m = float(stations[1] - stations[0])
    for index in trainer.training_pictures:
        T, camera = dataset.T_world_cam[index], dataset.intrinsics[index]
        towards = T[:3, 3] - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        straight = (towards * normals).sum(axis=1)
        pixels, depths = camera.project(points, T)
        shown = np.flatnonzero((straight > 0.0) & (depths > 0.0) & camera.contains(pixels))
        if len(shown) == 0:
            continue
        way = points[shown, None] + stations[None, :, None] * towards[shown, None]
        thickness = trainer.densities_at(way.reshape(-1, 3)).reshape(way.shape[:2]) * step_m
        total[shown] += straight[shown] * np.exp(-thickness.sum(axis=1))
    return total


def _xlogx(values: Array) -> Array:
    return values * np.log(np.maximum(values, 1e-12))
