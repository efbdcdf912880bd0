"""A wheeled recycling bin, its lid ajar over bottles and cardboard; 0.75 m.

The bin's front, with the sign, looks along +x; hinge and wheels are at the back.
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
    grid_faces,
    mottled,
    part,
    plain,
    rounded_box,
    turned,
)

Array = NDArray[np.float64]

_BLUE = (48, 92, 138)
_LID = (206, 160, 46)
_BOTTOM_Z_M, _RIM_Z_M = 0.05, 0.62
_ROWS, _AROUND = 44, 97


def _half_size(z: Array) -> tuple[Array, Array]:
    """Return half depth (x) and half width (y) of the tapered body at heights ``z``."""
    t = (z - _BOTTOM_Z_M) / (_RIM_Z_M - _BOTTOM_Z_M)
    return 0.165 + 0.055 * t, 0.175 + 0.05 * t


def _plastic(points: Array) -> Array:
    """Return blue plastic: splashed dirt, scuffs, a label on the left, a stripe."""
    x, y, z = points.T
    colours = mottled(_BLUE, 0.07, 0.06, 11)(points)
    splash = mottled((1, 1, 1), 0.5, 0.06, 12)(points)[:, :1]
    dirt = np.clip(0.75 * splash - (z[:, None] - 0.05) / 0.16, 0.0, 0.75)
    colours = colours * (1 - dirt) + dirt * np.array([118.0, 100, 78])
    scuff = mottled((1, 1, 1), 0.5, 0.035, 13)(points)[:, 0] > 1.75
    colours[scuff] = (136, 158, 178)
    left = y > 0.15
    label = left & (np.abs(x + 0.01) < 0.085) & (np.abs(z - 0.42) < 0.065)
    colours[label] = (226, 222, 208)
    bars = label & (z < 0.41) & (z > 0.37) & (np.sin(x * 420) + np.sin(x * 171) > 0.1)
    colours[bars] = (36, 36, 40)
    lines = label & (np.abs(np.sin((z - 0.43) * np.pi / 0.02)) > 0.8) & (z > 0.425) & (x < 0.05)
    colours[lines] = (70, 74, 84)
    right = y < -0.15
    colours[right & (np.abs(z - 0.50) < 0.02)] = (196, 198, 194)
    colours[right & (np.abs(z - 0.46) < 0.01)] = (170, 60, 48)
    return colours


def _body() -> list[Mesh]:
    """Return the hollow tapered body, walls seen from both sides, rim and ribs."""
    z = np.linspace(_BOTTOM_Z_M, _RIM_Z_M, _ROWS)
    half_x, half_y = _half_size(z)
    unit = _rounded_square(_AROUND)
    wall = np.stack(
        [
            half_x[:, None] * unit[:, 0],
            half_y[:, None] * unit[:, 1],
            np.repeat(z[:, None], _AROUND, 1),
        ],
        axis=-1,
    )
    ribs = 0.005 * (np.abs(np.sin(z * np.pi / 0.19)) > 0.93)
    wall[..., :2] *= (1.0 + ribs / 0.2)[:, None, None]
    inner = wall[_ROWS // 2 :: 3] * np.array([0.93, 0.93, 1.0])
    floor = np.array([0.155, 0.165, 1.0]) * np.stack(
        [unit[:, 0], unit[:, 1], np.full(_AROUND, _BOTTOM_Z_M)], 1
    )
    bottom = np.concatenate([floor, np.tile([0.0, 0.0, _BOTTOM_Z_M], (_AROUND, 1))])
    top = np.concatenate([wall[-1] * [1.05, 1.05, 1.0], wall[-1] * [0.93, 0.93, 1.0]])
    skirt = np.concatenate(
        [wall[-1] * [1.05, 1.05, 1.0], wall[-1] * [1.05, 1.05, 1.0] - np.array([0, 0, 0.022])]
    )
    dark = mottled((36, 66, 100), 0.08, 0.05, 14)
    return [
        part(wall.reshape(-1, 3), grid_faces(_ROWS, _AROUND), _plastic),
        part(inner.reshape(-1, 3), grid_faces(len(inner), _AROUND), plain((24, 38, 54))),
        part(bottom, grid_faces(2, _AROUND), dark),
        part(top, grid_faces(2, _AROUND), dark),
        part(skirt, grid_faces(2, _AROUND), dark),
    ]


def _rounded_square(count: int) -> Array:
    """Return ``count`` evenly spaced points ``(count, 2)`` around a square with rounded corners."""
    angles = np.linspace(0, 2 * np.pi, 4001)
    c, s = np.cos(angles), np.sin(angles)
    # A superellipse of high power; its own angle would crowd the points in the corners.
    fine = np.stack([np.sign(c) * np.abs(c) ** 0.28, np.sign(s) * np.abs(s) ** 0.28], axis=1)
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    places = np.linspace(0, run[-1], count)
    return np.stack([np.interp(places, run, fine[:, k]) for k in range(2)], axis=1)


def _on_front(u: Array, v: Array, lift_m: float) -> Array:
    """Return points of the front wall at ``u`` (to its right as seen) and height ``v``, metres."""
    half_x, _ = _half_size(v)
    return np.stack([half_x + lift_m, u, v], axis=1)


def _sign() -> list[Mesh]:
    """Return the recycling sign: three bent arrows that chase each other around a triangle."""
    white = plain((228, 230, 224))
    centre = np.array([0.0, 0.335])
    parts = []
    for k in range(3):
        turn = np.deg2rad(120.0 * k)
        R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        # One arrow runs along a side of the triangle and ends in a head past its corner.
        shaft = np.array([[-0.062, -0.058], [0.028, -0.058], [0.028, -0.026], [-0.043, -0.026]])
        head = np.array([[0.028, -0.078], [0.078, -0.042], [0.028, -0.006]])
        tail = np.array([[-0.062, -0.058], [-0.043, -0.026], [-0.058, 0.0], [-0.086, -0.016]])
        for polygon, rgb in ((shaft, None), (head, None), (tail, (188, 194, 188))):
            flat = _fan(polygon @ R.T + centre)
            points = _on_front(flat[:, 0], flat[:, 1], 0.006)
            faces = np.arange(len(points)).reshape(-1, 3)
            parts.append(part(points, faces, white if rgb is None else plain(rgb)))
    return parts


def _fan(polygon: Array) -> Array:
    """Return a convex polygon ``(k, 2)`` as small triangles, three rows each ``(3 t, 2)``."""
    corners = [(polygon[0], polygon[i], polygon[i + 1]) for i in range(1, len(polygon) - 1)]
    for _ in range(2):
        finer = []
        for a, b, c in corners:
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            finer += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = finer
    return np.array(corners).reshape(-1, 2)


def _lid() -> list[Mesh]:
    """Return the domed lid, hinged at the back and ajar, with a handle and a slot."""

    def paint(points: Array) -> Array:
        colours = mottled(_LID, 0.07, 0.05, 15)(points)
        x, y, _ = points.T
        slot = (np.abs(x - 0.06) < 0.022) & (np.abs(y) < 0.12)
        colours[slot] = (46, 44, 40)
        colours[(np.abs(x + 0.08) < 0.045) & (np.abs(y - 0.09) < 0.055)] = (70, 128, 80)
        return colours

    centre = np.array([0.0, 0.0, _RIM_Z_M + 0.028])
    lid = rounded_box((0.485, 0.495, 0.05), 0.024, paint, 0.018, centre)
    lip = bone(
        (0.235, -0.11, _RIM_Z_M + 0.02),
        (0.235, 0.11, _RIM_Z_M + 0.02),
        (0.014, 0.014),
        plain((156, 118, 30)),
        sides=12,
    )
    hinge = (-0.235, 0.0, _RIM_Z_M + 0.01)
    return [turned(piece, "y", -11, hinge) for piece in (lid, lip)]


def _chassis() -> list[Mesh]:
    """Return wheels, axle, the rear handle and front feet."""
    rubber, hub = mottled((38, 38, 40), 0.15, 0.02, 16), plain((178, 178, 172))
    parts = [
        bone(
            (-0.17, -0.24, 0.085),
            (-0.17, 0.24, 0.085),
            (0.01, 0.01),
            plain((110, 110, 112)),
            sides=10,
        )
    ]
    for side in (-1.0, 1.0):
        inner, outer = np.array([-0.17, 0.2 * side, 0.085]), np.array([-0.17, 0.25 * side, 0.085])
        parts.append(
            bone(inner, outer, (0.078, 0.085, 0.085, 0.078), rubber, sides=26, step_m=0.017)
        )
        parts.append(
            bone(outer, outer + np.array([0, 0.006 * side, 0]), (0.045, 0.042), hub, sides=20)
        )
        parts.append(
            bone(
                (-0.225, 0.13 * side, 0.585),
                (-0.285, 0.13 * side, 0.60),
                (0.012, 0.012),
                plain((40, 72, 108)),
                sides=10,
            )
        )
        parts.append(
            box(
                (0.05, 0.06, 0.055),
                mottled((36, 66, 100), 0.1, 0.03, 17),
                0.015,
                (0.13, 0.12 * side, 0.027),
            )
        )
    parts.append(
        bone(
            (-0.285, -0.17, 0.60),
            (-0.285, 0.17, 0.60),
            (0.014, 0.014),
            plain((34, 34, 38)),
            sides=12,
        )
    )
    return parts


def _contents() -> list[Mesh]:
    """Return what shows under the lid: a bottle, folded cardboard, a newspaper."""
    green = mottled((64, 122, 76), 0.1, 0.03, 18)
    card = mottled((176, 138, 92), 0.1, 0.02, 19)
    paper = mottled((206, 202, 190), 0.12, 0.012, 20)
    return [
        bone(
            (0.12, 0.10, 0.5),
            (0.225, 0.13, 0.655),
            (0.036, 0.036, 0.034, 0.014, 0.013),
            green,
            sides=16,
        ),
        turned(
            rounded_box((0.012, 0.16, 0.2), 0.004, card, 0.012, (0.18, -0.08, 0.58)),
            "y",
            25,
            (0.18, -0.08, 0.58),
        ),
        turned(
            box((0.2, 0.14, 0.02), paper, 0.014, (0.08, -0.02, 0.6)), "y", -14, (0.08, -0.02, 0.6)
        ),
        ellipsoid((0.02, 0.08, 0.58), (0.07, 0.07, 0.05), paper, 12, 18),
    ]


def build_recycle_bin() -> ObjectModel:
    """Return the recycling bin."""
    return assembled("recycle_bin", [*_body(), *_sign(), *_lid(), *_chassis(), *_contents()])
