"""A four-legged robot with a sensor head, an arm stump and a carrying handle; 0.65 x 0.32 x 0.42 m.

The robot's nose points along +x, its left side along +y.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.sim.meshes import Mesh, ObjectModel
from server.sim.scenes.shapes import (
    assembled,
    bone,
    box,
    ellipsoid,
    mottled,
    moved,
    plain,
    rounded_box,
    turned,
)

Array = NDArray[np.float64]

_ORANGE = (206, 118, 34)
_BLACK = (44, 45, 49)
_GREY = (124, 127, 131)
_ALUMINIUM = (172, 175, 178)


def _hull_paint(points: Array) -> Array:
    """Return the trunk's paint: orange shell, dark belly, stripes, a number on the left."""
    colours = mottled(_ORANGE, 0.05, 0.05, 3)(points)
    x, y, z = points.T
    colours[z < -0.018] = _BLACK
    # Hazard stripes run around the rear third, slanted.
    rear = (x < -0.12) & (x > -0.19) & (z > -0.018)
    stripe = np.sin((x + 0.6 * z) * (2 * np.pi / 0.028)) > 0
    colours[rear & stripe] = (40, 38, 36)
    colours[rear & ~stripe] = (222, 190, 62)
    colours[(np.abs(x - 0.16) < 0.006) & (z > -0.018)] = (60, 56, 52)
    colours[(np.abs(x + 0.09) < 0.003) & (z > -0.018)] = (60, 56, 52)
    _number(colours, x, z, (y > 0.05) & (z > -0.015))
    grille = (y < -0.05) & (np.abs(x - 0.03) < 0.06) & (np.abs(z - 0.018) < 0.02)
    colours[grille & (np.sin(x * 2 * np.pi / 0.014) > 0)] = (52, 50, 50)
    return colours * mottled((1, 1, 1), 0.06, 0.018, 9)(points)


def _number(colours: Array, x: Array, z: Array, where: Array) -> None:
    """Paint a white field with the number 4 on it, in place; seen from +y, x runs to the left."""
    u, v = (0.075 - x) / 0.075, (z + 0.008) / 0.05
    inside = where.astype(bool) & (u > 0) & (u < 1) & (v > 0) & (v < 1)
    colours[inside] = (226, 224, 216)
    stem = (np.abs(u - 0.66) < 0.08) & (v > 0.1) & (v < 0.9)
    bar = (np.abs(v - 0.36) < 0.09) & (u > 0.22) & (u < 0.84)
    slope = (np.abs(u - (0.22 + 0.8 * (v - 0.36))) < 0.09) & (v > 0.36) & (v < 0.9)
    colours[inside & (stem | bar | slope)] = (34, 34, 38)


def _banded(rgb: tuple[int, int, int], other: tuple[int, int, int], z_m: float, half_m: float):
    """Return a paint with a band of another colour around height ``z_m``."""
    base = mottled(rgb, 0.08, 0.03, 5)

    def paint(points: Array) -> Array:
        colours = base(points)
        colours[np.abs(points[:, 2] - z_m) < half_m] = other
        return colours

    return paint


def _leg(hip: Array, side: float, swing_m: float, lift_m: float) -> list[Mesh]:
    """Return a leg: hip motor, thigh, knee, shank and foot.

    Args:
        hip: Hip joint ``(3,)``.
        side: +1 left, -1 right.
        swing_m: How far the foot stands in front of the hip.
        lift_m: How far the foot is above the floor.
    """
    out = np.array([0.0, side, 0.0])
    shoulder = hip + 0.052 * out
    foot = np.array([hip[0] + swing_m, shoulder[1] + 0.004 * side, 0.019 + lift_m])
    # The knee of a two-link leg of equal links, bent backwards.
    span = foot - shoulder
    reach = np.linalg.norm(span[[0, 2]])
    link = 0.19
    bend = np.sqrt(max(link**2 - (reach / 2) ** 2, 1e-4))
    across = np.array([span[2], 0.0, -span[0]]) / reach
    knee = (shoulder + foot) / 2 + bend * across
    dark, metal = mottled(_BLACK, 0.1, 0.03, 4), mottled(_ALUMINIUM, 0.06, 0.03, 6)
    return [
        bone(
            hip - 0.012 * out,
            hip + 0.04 * out,
            (0.036, 0.04, 0.04, 0.036),
            dark,
            sides=18,
            step_m=0.014,
        ),
        bone(
            hip + 0.034 * out,
            shoulder + 0.026 * out,
            (0.034, 0.041, 0.041, 0.02),
            metal,
            sides=18,
            step_m=0.014,
        ),
        bone(
            shoulder,
            knee,
            (0.034, 0.03, 0.024, 0.021),
            _banded(_ORANGE, _BLACK, shoulder[2] - 0.07, 0.012),
            sides=16,
            step_m=0.012,
            squash=0.72,
        ),
        bone(
            knee - 0.02 * out,
            knee + 0.02 * out,
            (0.016, 0.024, 0.024, 0.016),
            metal,
            sides=12,
            step_m=0.014,
        ),
        bone(
            knee,
            foot,
            (0.019, 0.014, 0.011, 0.012),
            _banded(_GREY, (214, 214, 208), 0.11, 0.014),
            sides=12,
            step_m=0.012,
        ),
        ellipsoid(foot, (0.021, 0.018, 0.019), mottled((34, 34, 36), 0.12, 0.01, 2), 9, 14),
    ]


def _head() -> list[Mesh]:
    """Return the head: two camera eyes, a lamp, a mast with a lidar."""
    dark = mottled((58, 60, 65), 0.08, 0.03, 8)
    lens, rim = plain((18, 22, 32)), plain((188, 190, 192))
    parts = [
        turned(
            rounded_box((0.085, 0.125, 0.075), 0.018, dark, 0.013, (0.255, 0, 0.022)),
            "y",
            8,
            (0.255, 0, 0.022),
        ),
        rounded_box(
            (0.02, 0.1, 0.03),
            0.006,
            mottled((150, 152, 156), 0.06, 0.02, 3),
            0.008,
            (0.293, 0, -0.008),
        ),
    ]
    for y, radius in ((0.034, 0.019), (-0.034, 0.019), (0.0, 0.009)):
        parts.append(
            bone(
                (0.285, y, 0.026), (0.304, y, 0.023), (radius, radius), rim, sides=18, step_m=0.006
            )
        )
        parts.append(
            ellipsoid((0.302, y, 0.0235), (0.007, radius * 0.8, radius * 0.8), lens, 8, 14)
        )
    mast = np.array([0.11, 0.03, 0.0])
    parts += [
        bone(
            mast + np.array([0, 0, 0.06]),
            mast + np.array([0, 0, 0.085]),
            (0.02, 0.016),
            plain(_GREY),
            sides=14,
            step_m=0.01,
        ),
        bone(
            mast + np.array([0, 0, 0.085]),
            mast + np.array([0, 0, 0.12]),
            (0.033, 0.033, 0.033),
            _lidar_paint,
            sides=24,
            step_m=0.005,
        ),
        ellipsoid(mast + np.array([0, 0, 0.12]), (0.032, 0.032, 0.01), plain((70, 72, 76)), 8, 20),
    ]
    return parts


def _lidar_paint(points: Array) -> Array:
    """Return dark glass between two light rings."""
    colours = np.tile([38.0, 44.0, 66.0], (len(points), 1))
    z = points[:, 2]
    colours[(z < 0.095) | (z > 0.113)] = (186, 188, 190)
    return colours


def _back() -> list[Mesh]:
    """Return what is on the back: a handle, a battery lid, an antenna on the right side."""
    blue = mottled((54, 92, 146), 0.07, 0.03, 12)
    handle = plain((40, 41, 44))
    return [
        rounded_box((0.13, 0.11, 0.022), 0.008, blue, 0.014, (-0.03, -0.01, 0.07)),
        box((0.03, 0.03, 0.003), plain((222, 222, 214)), 0.01, (-0.06, -0.02, 0.082)),
        box((0.016, 0.05, 0.003), plain((188, 46, 40)), 0.01, (-0.005, 0.0, 0.082)),
        bone((-0.22, 0.045, 0.045), (-0.22, 0.045, 0.1), (0.007, 0.007), handle, sides=10),
        bone((-0.22, -0.045, 0.045), (-0.22, -0.045, 0.1), (0.007, 0.007), handle, sides=10),
        bone(
            (-0.22, -0.052, 0.1),
            (-0.22, 0.052, 0.1),
            (0.009, 0.009),
            plain((190, 60, 40)),
            sides=10,
        ),
        bone(
            (-0.15, -0.06, 0.05),
            (-0.17, -0.075, 0.13),
            (0.006, 0.004, 0.003),
            plain((30, 30, 32)),
            sides=8,
        ),
        ellipsoid((-0.17, -0.075, 0.132), (0.006, 0.006, 0.006), plain((200, 50, 40)), 6, 8),
    ]


def build_robot_dog() -> ObjectModel:
    """Return the robot dog in mid-step: no two legs stand alike."""
    body_m = 0.285
    trunk = rounded_box((0.43, 0.16, 0.115), 0.035, _hull_paint, 0.0105)
    parts = [trunk, *_head(), *_back()]
    parts = [moved(p, (0.0, 0.0, body_m)) for p in parts]
    steps = {
        (1, 1): (0.035, 0.0),
        (1, -1): (-0.05, 0.0),
        (-1, 1): (-0.055, 0.0),
        (-1, -1): (0.03, 0.035),
    }
    for (front, side), (swing_m, lift_m) in steps.items():
        hip = np.array([0.185 * front, 0.07 * side, body_m - 0.012])
        parts += _leg(hip, side, swing_m, lift_m)
    return assembled("robot_dog", parts)
