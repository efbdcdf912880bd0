"""A standing person with one arm raised, a cap, a checked shirt and a shoulder bag; 1.65 m.

The person looks along +x; the left side is +y.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.sim.meshes import Mesh, ObjectModel
from server.sim.scenes.shapes import (
    assembled,
    bone,
    ellipsoid,
    mottled,
    plain,
    rounded_box,
    tube,
    turned,
)

Array = NDArray[np.float64]

_SKIN = (198, 146, 116)
_DENIM = (62, 78, 112)
_SHIRT = (150, 58, 52)
_HAIR = (52, 36, 26)
_CAP = (48, 84, 72)
# Heights and half widths of the torso, hip to neck, metres.
_TORSO_Z = np.array([0.80, 0.84, 0.90, 0.98, 1.06, 1.15, 1.24, 1.31, 1.36, 1.385, 1.40])
_TORSO_HALF = np.array([0.13, 0.165, 0.170, 0.155, 0.145, 0.158, 0.178, 0.185, 0.160, 0.100, 0.06])


def _shirt(points: Array) -> Array:
    """Return a red checked shirt with buttons, a breast pocket, folds, and a belt below it."""
    x, y, z = points.T
    angle = np.arctan2(y, x)
    colours = mottled(_SHIRT, 0.10, 0.16, 21)(points)
    across = np.sin(z * 2 * np.pi / 0.075) > 0.45
    along = np.sin(angle * 11) > 0.45
    colours[across] *= 0.62
    colours[along] *= 0.62
    colours[np.abs(np.sin(z * np.pi / 0.075 + 0.6)) < 0.12] = (196, 178, 150)
    placket = (np.abs(y) < 0.011) & (x > 0)
    colours[placket] = (122, 44, 42)
    colours[placket & (np.abs(np.sin(z * np.pi / 0.085)) > 0.93)] = (228, 222, 206)
    pocket = (x > 0) & (np.abs(y - 0.082) < 0.042) & (np.abs(z - 1.235) < 0.05)
    edge = pocket & ((np.abs(y - 0.082) > 0.034) | (np.abs(z - 1.235) > 0.042))
    colours[pocket] *= 1.18
    colours[edge] = (96, 36, 36)
    belt = np.abs(z - 0.935) < 0.019
    colours[belt] = (58, 42, 30)
    colours[belt & (np.abs(y) < 0.022) & (x > 0)] = (192, 178, 128)
    below = z < 0.917
    colours[below] = _jeans(points[below])
    return colours


def _jeans(points: Array) -> Array:
    """Return worn denim: threads, pale thighs and knees, a patch on the left knee."""
    x, y, z = points.T
    colours = mottled(_DENIM, 0.14, 0.05, 31)(points)
    worn = np.exp(-(((z - 0.62) / 0.11) ** 2)) * (x > 0.0) + 0.7 * np.exp(
        -(((z - 0.43) / 0.06) ** 2)
    ) * (x > 0)
    colours += worn[:, None] * np.array([52.0, 54.0, 50.0])
    patch = (y > 0) & (x > 0) & (np.abs(z - 0.45) < 0.05) & (np.abs(y - 0.1) < 0.045)
    colours[patch] = mottled((150, 118, 74), 0.14, 0.03, 33)(points[patch])
    colours[np.abs(z - 0.115) < 0.01] *= 0.6
    return colours


def _face(points: Array) -> Array:
    """Return skin with hair, brows, eyes, mouth; ``points`` in the head's frame."""
    x, y, z = points.T
    colours = mottled(_SKIN, 0.05, 0.05, 41)(points)
    hair = ((z > 0.045) | (x < -0.015)) & ~((x < -0.02) & (z < -0.07))
    colours[hair] = mottled(_HAIR, 0.25, 0.015, 42)(points[hair])
    front = x > 0.04
    beard = (
        front & (z < -0.042) & (z > -0.11) & ~((np.abs(y) < 0.026) & (np.abs(z + 0.058) < 0.009))
    )
    colours[beard] = mottled((92, 66, 50), 0.18, 0.012, 43)(points[beard])
    colours[front & (np.abs(y) < 0.026) & (np.abs(z + 0.058) < 0.008)] = (158, 84, 76)
    for side in (-1, 1):
        brow = front & (np.abs(y - 0.032 * side) < 0.019) & (np.abs(z - 0.033) < 0.006)
        colours[brow] = _HAIR
    return colours


def _head() -> list[Mesh]:
    """Return head, ears, nose, glasses, cap and neck."""
    centre = np.array([0.012, 0.0, 1.515])
    skin, cap = mottled(_SKIN, 0.05, 0.04, 44), mottled(_CAP, 0.1, 0.03, 45)

    def face(points: Array) -> Array:
        return _face(points - centre)

    parts = [
        ellipsoid(centre, (0.094, 0.074, 0.115), face, 26, 36),
        bone((-0.005, 0, 1.36), (0.003, 0, 1.45), (0.062, 0.055, 0.056), skin, sides=18),
        bone(
            centre + np.array([0.088, 0, 0.02]),
            centre + np.array([0.104, 0, -0.022]),
            (0.007, 0.012, 0.013),
            skin,
            sides=10,
        ),
        ellipsoid(centre + np.array([-0.006, 0, 0.052]), (0.1, 0.081, 0.078), cap, 12, 24),
        ellipsoid(
            centre + np.array([0.105, 0, 0.05]), (0.075, 0.062, 0.008), plain((36, 62, 54)), 8, 20
        ),
        ellipsoid(
            centre + np.array([0.09, 0, 0.083]),
            (0.012, 0.026, 0.018),
            plain((214, 196, 120)),
            8,
            12,
        ),
    ]
    for side in (-1.0, 1.0):
        eye = centre + np.array([0.081, 0.032 * side, 0.012])
        angles = np.linspace(0, 2 * np.pi, 15)
        ring = eye + np.stack(
            [0.009 + 0 * angles, 0.022 * np.cos(angles), 0.017 * np.sin(angles)], axis=1
        )
        parts += [
            ellipsoid(eye, (0.008, 0.016, 0.010), plain((226, 222, 216)), 8, 12),
            ellipsoid(
                eye + np.array([0.005, 0, 0]), (0.005, 0.007, 0.007), plain((40, 52, 46)), 6, 10
            ),
            tube(ring, np.full(15, 0.0025), plain((24, 24, 28)), 6),
            ellipsoid(
                centre + np.array([-0.004, 0.075 * side, 0.0]), (0.02, 0.011, 0.03), skin, 10, 12
            ),
        ]
    return parts


def _legs() -> list[Mesh]:
    """Return legs and shoes; the right foot stands a little forward."""
    parts = []
    for side, stride_m in ((1.0, -0.03), (-1.0, 0.07)):
        hip = np.array([0.0, 0.085 * side, 0.88])
        knee = np.array([0.035 + stride_m * 0.6, 0.098 * side, 0.46])
        ankle = np.array([stride_m, 0.105 * side, 0.085])
        parts.append(bone(hip, knee, (0.088, 0.086, 0.076, 0.064), _jeans, sides=24, step_m=0.022))
        parts.append(
            bone(
                knee + np.array([0, 0, 0.012]),
                ankle,
                (0.063, 0.062, 0.056, 0.056),
                _jeans,
                sides=22,
                step_m=0.022,
            )
        )
        toe = ankle + np.array([0.155, 0.02 * side, -0.05])
        heel = ankle + np.array([-0.05, 0.0, -0.048])
        shoe = mottled((206, 200, 188), 0.08, 0.03, 51)
        parts.append(
            bone(
                heel,
                toe,
                (0.018, 0.038, 0.042, 0.04, 0.036, 0.014),
                shoe,
                sides=14,
                step_m=0.018,
                squash=0.9,
            )
        )
        parts.append(
            bone(
                ankle + np.array([0, 0, 0.025]),
                ankle + np.array([0.01, 0, -0.045]),
                (0.042, 0.046, 0.04),
                plain((176, 66, 48)),
                sides=16,
            )
        )
        sole = rounded_box(
            (0.235, 0.074, 0.024),
            0.012,
            plain((62, 62, 66)),
            0.02,
            (ankle[0] + 0.045, ankle[1] + 0.008 * side, 0.012),
        )
        parts.append(sole)
    return parts


def _arm(shoulder: Array, elbow: Array, wrist: Array, hand: Array) -> list[Mesh]:
    """Return an arm with a rolled-up sleeve, a forearm and a hand with fingers."""
    skin = mottled(_SKIN, 0.06, 0.04, 61)

    def sleeve(points: Array) -> Array:
        colours = mottled(_SHIRT, 0.12, 0.07, 62)(points)
        along = (points - shoulder) @ (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
        colours[np.sin(along * 2 * np.pi / 0.075) > 0.45] *= 0.6
        colours[np.sin(points[:, 0] * 2 * np.pi / 0.06) > 0.5] *= 0.68
        return colours

    direction = (hand - wrist) / np.linalg.norm(hand - wrist)
    sideways = np.cross(direction, [1.0, 0.0, 0.0])
    sideways /= np.linalg.norm(sideways)
    parts = [
        bone(shoulder, elbow, (0.056, 0.06, 0.052, 0.05), sleeve, sides=18, step_m=0.018),
        bone(
            elbow,
            elbow + 0.2 * (wrist - elbow),
            (0.05, 0.05),
            plain((122, 44, 42)),
            sides=18,
            step_m=0.012,
        ),
        ellipsoid(elbow, (0.049, 0.049, 0.049), sleeve, 10, 16),
        bone(elbow, wrist, (0.04, 0.043, 0.036, 0.026), skin, sides=14, step_m=0.022),
        bone(wrist, hand, (0.026, 0.038, 0.042, 0.034), skin, sides=12, step_m=0.016, squash=0.55),
    ]
    for k, spread in enumerate((-0.03, -0.01, 0.01, 0.03)):
        root = hand + spread * sideways - 0.012 * direction
        tip = root + (0.085 - 0.012 * (k in (0, 3))) * direction + 0.5 * spread * sideways
        parts.append(bone(root, tip, (0.010, 0.010, 0.006), skin, sides=7, step_m=0.03))
    thumb = wrist + 0.35 * (hand - wrist)
    parts.append(
        bone(
            thumb,
            thumb + 0.055 * direction - 0.055 * sideways,
            (0.012, 0.012, 0.007),
            skin,
            sides=7,
            step_m=0.03,
        )
    )
    return parts


def _bag() -> list[Mesh]:
    """Return a shoulder bag on the right hip and its strap across the chest."""
    canvas = mottled((122, 112, 78), 0.12, 0.03, 71)

    def paint(points: Array) -> Array:
        colours = canvas(points)
        colours[(points[:, 2] > 0.01) & (points[:, 2] < 0.02)] = (72, 58, 40)
        colours[(np.abs(points[:, 0]) < 0.014) & (points[:, 2] < 0.05)] = (84, 56, 36)
        badge = (points[:, 1] < 0) & (np.hypot(points[:, 0] - 0.06, points[:, 2] + 0.04) < 0.028)
        colours[badge] = (200, 170, 60)
        return colours

    t = np.linspace(0, 1, 40)
    angle = np.deg2rad(75) - np.deg2rad(165) * t
    z = 1.375 - 0.43 * t
    half = np.interp(z, _TORSO_Z, _TORSO_HALF)
    front = np.stack(
        [(0.62 * half + 0.008) * np.cos(angle), (half + 0.006) * np.sin(angle), z], axis=1
    )
    back = front * np.array([-1.0, 1.0, 1.0])
    strap = plain((78, 60, 42))
    bag = turned(rounded_box((0.25, 0.08, 0.2), 0.03, paint, 0.019, (-0.01, -0.215, 0.86)), "z", 6)
    return [
        tube(front, np.full(40, 0.016), strap, 6),
        tube(back, np.full(40, 0.016), strap, 6),
        bag,
    ]


def build_human() -> ObjectModel:
    """Return the person: the left arm raised to wave, the right one hanging with a slight bend."""
    z = np.linspace(_TORSO_Z[0], _TORSO_Z[-1], 42)
    half = np.interp(z, _TORSO_Z, _TORSO_HALF)
    path = np.stack([0 * z, 0 * z, z], axis=1)
    parts = [tube(path, half, _shirt, 54, squash=0.62), *_head(), *_legs(), *_bag()]
    raised = [(0.0, 0.175, 1.325), (0.05, 0.40, 1.30), (0.10, 0.46, 1.50), (0.115, 0.475, 1.57)]
    hanging = [
        (0.0, -0.175, 1.325),
        (-0.02, -0.285, 1.06),
        (0.10, -0.335, 0.86),
        (0.135, -0.335, 0.80),
    ]
    for joints in (raised, hanging):
        parts += _arm(*(np.array(joint) for joint in joints))
    return assembled("human", parts)
