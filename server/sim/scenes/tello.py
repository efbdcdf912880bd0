"""The body of another drone as the cameras see it: a small white and grey quadcopter."""

from __future__ import annotations

import numpy as np

from server.sim.meshes import Mesh
from server.sim.scenes.shapes import bone, box, ellipsoid, joined, plain


def tello_body() -> Mesh:
    """Return a quadcopter about 0.18 m across, its body frame FLU at the origin, nose along +x."""
    white, grey, dark = plain((208, 208, 204)), plain((92, 94, 98)), plain((36, 37, 40))
    parts = [
        ellipsoid((0.0, 0.0, 0.002), (0.052, 0.026, 0.017), white, 9, 14),
        box((0.06, 0.034, 0.022), grey, 0.03, (-0.008, 0.0, -0.006)),
        box((0.012, 0.016, 0.012), dark, 0.02, (0.05, 0.0, -0.002)),
    ]
    for sx in (-1.0, 1.0):
        for sy in (-1.0, 1.0):
            hub = np.array([0.052 * sx, 0.052 * sy, 0.0])
            parts.append(bone((0.02 * sx, 0.016 * sy, 0.0), hub, (0.006, 0.004), dark, sides=6))
            parts.append(
                bone(
                    hub + np.array([0, 0, -0.014]),
                    hub + np.array([0, 0, 0.012]),
                    (0.008, 0.007),
                    grey,
                    sides=8,
                )
            )
            parts.append(
                ellipsoid(hub + np.array([0, 0, 0.014]), (0.036, 0.036, 0.0015), grey, 5, 14)
            )
    return joined(parts)
