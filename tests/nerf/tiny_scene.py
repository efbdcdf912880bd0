"""A tiny scene for tests: a textured ball on a checkered floor in a striped box, ray traced."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.dataset import PosedFile, load_dataset, write_transforms

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
BALL_CENTRE = np.array([0.0, 0.0, 0.4])
BALL_RADIUS = 0.35
BOX = Box3(BALL_CENTRE - 0.4, BALL_CENTRE + 0.4)
_WALL = 2.5


def trace(intrinsics: Intrinsics, T_world_cam: np.ndarray) -> np.ndarray:
    """Return the RGB picture ``(h, w, 3)`` uint8 of the scene."""
    v, u = np.mgrid[0 : intrinsics.height, 0 : intrinsics.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    d = intrinsics.directions(pixels) @ T_world_cam[:3, :3].T
    o = T_world_cam[:3, 3]
    with np.errstate(divide="ignore"):
        walls = np.where(d > 0, (_WALL - o) / d, (-_WALL - o) / d)
    walls[:, 2] = np.where(d[:, 2] < 0, -o[2] / np.minimum(d[:, 2], -1e-9), walls[:, 2])
    axis = walls.argmin(axis=1)
    t = walls.min(axis=1)
    p = o + t[:, None] * d
    # Shifted, so that no wall lies on a border between checks, where rounding would decide.
    checks = (np.floor(p * 2.0 + 0.25).sum(axis=1) % 2)[:, None]
    paint = np.array([[0.7, 0.3, 0.3], [0.3, 0.7, 0.4], [0.5, 0.5, 0.8]])[axis]
    rgb = paint * (0.5 + 0.5 * checks)
    b = d @ (o - BALL_CENTRE)
    inside = b**2 - ((o - BALL_CENTRE) ** 2).sum() + BALL_RADIUS**2
    hit = (inside > 0) & (b < 0)
    q = o + (-b - np.sqrt(np.maximum(inside, 0)))[:, None] * d
    stripes = 0.5 + 0.4 * np.sign(np.sin(12.0 * q))
    rgb = np.where(hit[:, None], stripes, rgb)
    return np.round(rgb * 255).astype(np.uint8).reshape(intrinsics.height, intrinsics.width, 3)


def write_tiny_scene(folder: Path, pictures: int = 24) -> Path:
    """Write a dataset of ``pictures`` views on a spiral around the ball."""
    (folder / "images").mkdir(parents=True)
    posed = []
    for k in range(pictures):
        azimuth, height = 2 * np.pi * k / pictures, 0.5 + 0.5 * (k % 3)
        pose = look_at(
            np.array([1.4 * np.cos(azimuth), 1.4 * np.sin(azimuth), height]), BALL_CENTRE
        )
        name = f"images/{k:03d}.png"
        cv2.imwrite(str(folder / name), trace(CAMERA, pose)[:, :, ::-1])
        posed.append(PosedFile(name, pose))
    write_transforms(folder, posed, CAMERA, BOX)
    return folder


def write_cut_out_scene(folder: Path, pictures: int = 24) -> Path:
    """Write the same views with every picture transparent around the ball."""
    write_tiny_scene(folder, pictures)
    dataset = load_dataset(folder)
    for file, image, T in zip(dataset.files, dataset.images, dataset.T_world_cam, strict=True):
        alpha = np.where(ball_mask(T), 255, 0).astype(np.uint8)
        cv2.imwrite(str(file), np.dstack([image[:, :, ::-1], alpha]))
    return folder


def ball_mask(T_world_cam: np.ndarray) -> np.ndarray:
    """Return which pixels see the ball, ``(h, w)``."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1).astype(float)
    d = CAMERA.directions(pixels) @ T_world_cam[:3, :3].T
    o = T_world_cam[:3, 3] - BALL_CENTRE
    b = d @ o
    hit = (b**2 - o @ o + BALL_RADIUS**2 > 0) & (b < 0)
    return hit.reshape(CAMERA.height, CAMERA.width)


def ball_points(count: int = 2000) -> np.ndarray:
    """Return ``count`` points ``(count, 3)`` on the ball."""
    d = np.random.default_rng(0).normal(size=(count, 3))
    return BALL_CENTRE + BALL_RADIUS * d / np.linalg.norm(d, axis=1, keepdims=True)
