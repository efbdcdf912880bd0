"""A textured room, the flights around the box in it, and what drones would believe of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.geometry.poses import camera_pose

CAMERA = TELLO_INTRINSICS.scaled(0.5)
TILT_RAD = math.radians(12.0)
OBJECT_WORLD = np.array([0.0, 0.0, 0.5])


@dataclass(frozen=True)
class Plane:
    """A rectangle from ``corner`` along ``u`` and ``v`` (world metres) with a grey ``texture``."""

    corner: np.ndarray
    u: np.ndarray
    v: np.ndarray
    texture: np.ndarray


def _texture(rng: np.random.Generator, side_px: int) -> np.ndarray:
    """Return noise of several scales ``(side_px, side_px)``, grey levels."""
    sum_of_noise = np.zeros((side_px, side_px), np.float32)
    for sigma in (2.0, 4.0, 10.0):
        noise = rng.standard_normal((side_px, side_px)).astype(np.float32)
        blurred = cv2.GaussianBlur(noise, (0, 0), sigma)
        sum_of_noise += blurred / blurred.std()
    return np.clip(128.0 + 32.0 * sum_of_noise, 0, 255).astype(np.uint8)


def textured_room(rng: np.random.Generator) -> list[Plane]:
    """Return floor and walls of a room of 7 m and a box of half a metre in its middle."""
    x, y, z = np.eye(3)

    def box(centre: np.ndarray, half: np.ndarray, side_px: int) -> list[Plane]:
        low, size = centre - half, 2.0 * half
        sx, sy, sz = size[0] * x, size[1] * y, size[2] * z
        faces = [(low, sx, sy), (low, sx, sz), (low, sy, sz)]
        faces += [(low + sz, sx, sy), (low + sy, sx, sz), (low + sx, sy, sz)]
        return [Plane(c, u, v, _texture(rng, side_px)) for c, u, v in faces]

    walls = box(np.array([0.0, 0.0, 1.5]), np.array([3.5, 3.5, 1.5]), 700)
    return walls + box(OBJECT_WORLD, np.array([0.25, 0.25, 0.25]), 200)


def render(planes: list[Plane], T_world_cam: np.ndarray, camera: Intrinsics) -> np.ndarray:
    """Cast one ray per pixel at every plane and keep the nearest hit."""
    xs, ys = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([xs.ravel(), ys.ravel()], axis=1).astype(float)
    rays = camera.directions(pixels) @ T_world_cam[:3, :3].T
    origin = T_world_cam[:3, 3]
    nearest = np.full(len(rays), np.inf)
    image = np.full(len(rays), 128, np.uint8)
    for plane in planes:
        normal = np.cross(plane.u, plane.v)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((plane.corner - origin) @ normal) / (rays @ normal)
            at = origin + depth[:, None] * rays - plane.corner
            a, b = at @ plane.u / (plane.u @ plane.u), at @ plane.v / (plane.v @ plane.v)
        hit = (depth > 1e-3) & (depth < nearest) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        side = len(plane.texture)
        columns = np.where(hit, a * (side - 1), 0).astype(np.float32).reshape(xs.shape)
        rows = np.where(hit, b * (side - 1), 0).astype(np.float32).reshape(xs.shape)
        shade = cv2.remap(plane.texture, columns, rows, cv2.INTER_LINEAR).ravel()
        image[hit], nearest[hit] = shade[hit], depth[hit]
    return image.reshape(xs.shape)


def ring(drones: int, stops: int, step_rad: float) -> tuple[np.ndarray, list[str]]:
    """Return true poses on a ring around the object, each drone on an arc of its own."""
    poses, drone_ids = [], []
    for d in range(drones):
        for s in range(stops):
            azimuth = d * 2.0 * math.pi / drones + s * step_rad
            radius = 1.7 + 0.15 * math.sin(1.3 * s + d)
            height = 0.8 + 0.12 * math.cos(2.1 * s + d)
            centre = np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), height])
            yaw = azimuth + math.pi + 0.05 * math.sin(3.0 * s)
            poses.append(camera_pose(centre, yaw, TILT_RAD))
            drone_ids.append(f"drone-{d + 1}")
    return np.stack(poses), drone_ids


def believed(
    poses: np.ndarray,
    drone_ids: list[str],
    rng: np.random.Generator,
    offset_m: float,
    yaw_rad: float,
    noise_m: float,
    noise_rad: float,
) -> np.ndarray:
    """Return ``poses`` as drones with a shifted, turned start and noise would believe them."""
    out = poses.copy()
    for drone in sorted(set(drone_ids)):
        own = np.array([d == drone for d in drone_ids])
        R = Rotation.from_euler("z", rng.normal(0.0, yaw_rad)).as_matrix()
        pivot = poses[own][0, :3, 3]
        out[own, :3, 3] = (poses[own, :3, 3] - pivot) @ R.T + pivot
        out[own, :3, 3] += rng.normal(0.0, offset_m, 3)
        out[own, :3, :3] = R @ poses[own, :3, :3]
    out[:, :3, 3] += rng.normal(0.0, noise_m, (len(out), 3))
    turns = Rotation.from_rotvec(rng.normal(0.0, noise_rad, (len(out), 3)))
    out[:, :3, :3] = turns.as_matrix() @ out[:, :3, :3]
    return out


def angles_rad(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    relative = np.swapaxes(T_a[:, :3, :3], 1, 2) @ T_b[:, :3, :3]
    return Rotation.from_matrix(relative).magnitude()
