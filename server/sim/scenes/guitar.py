"""An acoustic guitar with a cutaway, leaning on a small stand; 1.0 m.

The guitar's front looks along +x; its neck points up, its treble side (the cutaway) is -y.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

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
    tube,
    turned,
)

Array = NDArray[np.float64]

_LENGTH_M = 0.47
_DEPTH_M = 0.095
_HOLE_Z_M = 0.315
_AXIS_Z_M = np.array([0.0, 0.03, 0.14, 0.235, 0.285, 0.34, 0.40, 0.45, 0.47])
_BASS_HALF_M = np.array([0.0, 0.115, 0.187, 0.150, 0.124, 0.133, 0.142, 0.10, 0.03])
_TREBLE_HALF_M = np.array([0.0, 0.115, 0.187, 0.150, 0.124, 0.130, 0.104, 0.034, 0.03])


def _half_widths(z: Array) -> tuple[Array, Array]:
    """Return half widths towards the bass and the treble side at heights ``z``."""
    # Interpolating the square keeps the round end round.
    bass = np.sqrt(np.maximum(PchipInterpolator(_AXIS_Z_M, _BASS_HALF_M**2)(z), 0.0))
    treble = np.sqrt(np.maximum(PchipInterpolator(_AXIS_Z_M, _TREBLE_HALF_M**2)(z), 0.0))
    return bass, treble


def _spruce(points: Array) -> Array:
    """Return the top: straight grain, darkening to a burst at the edge, scratches."""
    _, y, z = points.T
    bass, treble = _half_widths(z)
    edge = np.where(y > 0, bass - y, treble + y)
    edge = np.minimum(edge, np.minimum(z, _LENGTH_M - z))
    grain = 0.06 * np.sin(y * 2 * np.pi / 0.021) + 0.05 * np.sin(y * 2 * np.pi / 0.05 + 3 * z)
    burst = np.clip(edge / 0.06, 0.0, 1.0)[:, None]
    colours = burst * np.array([208.0, 146, 80]) + (1 - burst) * np.array([104.0, 48, 26])
    colours *= 1.0 + grain[:, None]
    colours[edge < 0.006] = (226, 214, 186)
    return colours * mottled((1, 1, 1), 0.07, 0.03, 7)(points)


def _rosewood(points: Array) -> Array:
    """Return back and sides: dark, wavy grain, a light centre strip on the back."""
    _, y, z = points.T
    wave = np.sin((y + 0.012 * np.sin(z * 26)) * 2 * np.pi / 0.034)
    colours = np.array([96.0, 56, 38]) * (1.0 + 0.10 * wave[:, None])
    colours[np.abs(y) < 0.005] = (196, 164, 112)
    return colours * mottled((1, 1, 1), 0.10, 0.05, 8)(points)


def _body() -> list[Mesh]:
    """Return top, back and rim of the body."""
    rows, columns = 42, 32
    t = (1 - np.cos(np.linspace(0, np.pi, rows))) / 2
    z = _LENGTH_M * (0.35 * np.linspace(0, 1, rows) + 0.65 * t)
    bass, treble = _half_widths(z)
    s = np.linspace(0, 1, columns)
    y = -treble[:, None] + (bass + treble)[:, None] * s
    z_all = np.repeat(z, columns)
    faces = grid_faces(rows, columns)
    arch = (0.012 * np.sin(np.pi * s) * np.minimum(1, (bass + treble)[:, None] / 0.2)).reshape(-1)
    flat = y.reshape(-1)
    front = np.stack([np.full_like(flat, _DEPTH_M / 2) + 0.3 * arch, flat, z_all], axis=1)
    back = np.stack([np.full_like(flat, -_DEPTH_M / 2) - arch, flat, z_all], axis=1)
    outline_y = np.concatenate([-treble, bass[::-1]])
    outline_z = np.concatenate([z, z[::-1]])
    depth = np.linspace(-_DEPTH_M / 2, _DEPTH_M / 2, 6)
    rim = np.stack(
        [np.repeat(depth, 2 * rows), np.tile(outline_y, 6), np.tile(outline_z, 6)], axis=1
    )
    return [
        part(front, faces, _spruce),
        part(back, faces, _rosewood),
        part(rim, grid_faces(6, 2 * rows), _rim_paint),
    ]


def _rim_paint(points: Array) -> Array:
    """Return the sides with light bindings along both edges."""
    colours = _rosewood(points + np.array([0, 0.02, 0]))
    colours[np.abs(points[:, 0]) > 0.04] = (222, 208, 178)
    return colours


def _top_fittings() -> list[Mesh]:
    """Return sound hole with rosette, pickguard, bridge, a sticker, a control knob."""
    x = _DEPTH_M / 2 + 0.0045
    angles = np.linspace(0, 2 * np.pi, 33)
    parts = [
        ellipsoid((x - 0.001, 0, _HOLE_Z_M), (0.0015, 0.046, 0.046), plain((22, 16, 13)), 9, 32)
    ]
    for radius, width, rgb in (
        (0.05, 0.0035, (40, 28, 22)),
        (0.057, 0.003, (220, 200, 158)),
        (0.063, 0.003, (70, 36, 26)),
    ):
        ring = np.stack(
            [np.full(33, x - 0.001), radius * np.cos(angles), _HOLE_Z_M + radius * np.sin(angles)],
            1,
        )
        parts.append(tube(ring, np.full(33, width), plain(rgb), 4))
    guard = ellipsoid(
        (x - 0.0015, -0.075, _HOLE_Z_M - 0.065),
        (0.002, 0.034, 0.075),
        mottled((96, 34, 26), 0.2, 0.02, 3),
        12,
        20,
    )
    parts += [
        turned(guard, "x", -22, (x, -0.075, _HOLE_Z_M - 0.065)),
        rounded_box(
            (0.012, 0.17, 0.03),
            0.005,
            mottled((44, 28, 22), 0.12, 0.02, 4),
            0.012,
            (x + 0.002, 0, 0.15),
        ),
        box((0.006, 0.075, 0.004), plain((232, 226, 208)), 0.01, (x + 0.009, 0, 0.156)),
        ellipsoid((x - 0.001, 0.11, 0.085), (0.0015, 0.032, 0.024), plain((52, 104, 128)), 12, 24),
        ellipsoid((x, 0.11, 0.085), (0.0015, 0.018, 0.012), plain((228, 206, 88)), 10, 20),
        bone(
            (0.0, 0.135, 0.40),
            (0.0, 0.155, 0.405),
            (0.007, 0.009),
            plain((196, 196, 190)),
            sides=12,
        ),
    ]
    for k in range(6):
        peg = (x + 0.008, -0.03 + 0.012 * k, 0.142)
        parts.append(ellipsoid(peg, (0.004, 0.004, 0.004), plain((230, 224, 206)), 5, 6))
    return parts


def _neck() -> list[Mesh]:
    """Return fretboard with frets and inlays, neck, headstock with tuners, strings."""
    x = _DEPTH_M / 2 + 0.006
    top = 0.775
    parts = [
        box(
            (0.009, 0.05, top - 0.385),
            mottled((48, 32, 26), 0.14, 0.03, 5),
            0.012,
            (x, 0, (top + 0.385) / 2),
        ),
        bone(
            (x - 0.012, 0, 0.45),
            (x - 0.012, 0, top),
            (0.026, 0.023, 0.021),
            mottled((138, 84, 50), 0.1, 0.05, 6),
            sides=16,
        ),
        bone(
            (0.0, 0, 0.455),
            (x - 0.02, 0, 0.49),
            (0.032, 0.022),
            mottled((138, 84, 50), 0.1, 0.05, 6),
            sides=14,
        ),
    ]
    scale_m = top - 0.156
    for fret in range(1, 18):
        z = 0.156 + scale_m * 2.0 ** (-fret / 12.0)
        if z > 0.39:
            parts.append(
                box((0.003, 0.05, 0.0028), plain((196, 190, 172)), 0.03, (x + 0.005, 0, z))
            )
        if fret in (3, 5, 7, 9, 12):
            dot = (
                x + 0.0045,
                0.0,
                z + 0.5 * scale_m * (2.0 ** (-(fret - 1) / 12.0) - 2.0 ** (-fret / 12.0)),
            )
            parts.append(ellipsoid(dot, (0.0015, 0.0065, 0.0065), plain((230, 226, 214)), 5, 10))
    head = rounded_box((0.016, 0.075, 0.165), 0.006, _headstock, 0.01, (x - 0.014, 0, top + 0.083))
    parts.append(turned(head, "y", -12, (x - 0.006, 0, top)))
    metal = plain((190, 188, 180))
    for row in range(3):
        for side in (-1.0, 1.0):
            z = top + 0.04 + 0.043 * row
            post = np.array([x - 0.016 - 0.2 * (z - top), 0.036 * side, z])
            parts.append(
                bone(post, post + np.array([0, 0.016 * side, 0]), (0.004, 0.004), metal, sides=6)
            )
            parts.append(
                ellipsoid(
                    post + np.array([0, 0.023 * side, 0]),
                    (0.006, 0.01, 0.009),
                    plain((224, 218, 200)),
                    6,
                    8,
                )
            )
            parts.append(
                bone(
                    post + np.array([0.004, -0.016 * side, 0]),
                    post + np.array([0.018, -0.016 * side, 0]),
                    (0.005, 0.004),
                    metal,
                    sides=6,
                )
            )
    for k in range(6):
        y = -0.02 + 0.008 * k
        bottom, nut = (x + 0.012, 1.5 * y, 0.156), (x + 0.008, y, top)
        parts.append(
            bone(bottom, nut, (0.0012, 0.0012), plain((206, 196, 164)), sides=4, step_m=0.05)
        )
    return parts


def _headstock(points: Array) -> Array:
    """Return dark veneer with a light emblem on the front."""
    colours = mottled((50, 32, 26), 0.12, 0.03, 9)(points)
    emblem = (points[:, 0] > 0) & (np.hypot(points[:, 1], 1.6 * (points[:, 2] - 0.045)) < 0.02)
    colours[emblem] = (214, 188, 116)
    return colours


def _stand() -> list[Mesh]:
    """Return a tripod with two padded arms."""
    steel, pad = mottled((56, 58, 62), 0.1, 0.04, 2), plain((34, 34, 36))
    hub = np.array([-0.13, 0.0, 0.20])
    parts = [bone((-0.12, 0, 0.05), (-0.085, 0, 0.48), (0.011, 0.011), steel, sides=12)]
    for angle_deg in (35, 180, -35):
        a = np.deg2rad(angle_deg)
        foot = np.array([-0.05 + 0.23 * np.cos(a), 0.26 * np.sin(a), 0.012])
        parts.append(bone(hub, foot, (0.010, 0.009), steel, sides=10))
        parts.append(ellipsoid(foot, (0.016, 0.016, 0.012), pad, 8, 12))
    for side in (-1.0, 1.0):
        elbow = np.array([-0.07, 0.085 * side, 0.085])
        tip = np.array([0.085, 0.085 * side, 0.075])
        parts.append(bone(hub - np.array([0, 0, 0.06]), elbow, (0.009, 0.009), steel, sides=10))
        parts.append(bone(elbow, tip, (0.013, 0.013), pad, sides=12))
        parts.append(
            bone(
                tip, tip + np.array([0.01, 0, 0.03]), (0.012, 0.01), plain((176, 52, 40)), sides=12
            )
        )
    return parts


def build_guitar() -> ObjectModel:
    """Return the guitar leaning back by a few degrees on its stand."""
    guitar = [*_body(), *_top_fittings(), *_neck()]
    parts = [turned(piece, "y", -7) for piece in guitar]
    raised = [Mesh(p.vertices + np.array([0.0, 0.0, 0.08]), p.faces, p.colours) for p in parts]
    return assembled("guitar", [*raised, *_stand()])
