"""The pictures on which the region search is judged: random rooms, poses, light and disturbances.

Every shot is one pose: what a hovering camera takes there, what the drone believes of its pose and
of the object, and the true silhouette's box, which the search never sees.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3, union
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.planner.config import FlightSpace
from server.planner.ring import facing, frame_fill
from server.sim.meshes import ObjectModel
from server.sim.scenes.surroundings import random_surroundings
from server.sim.world import World
from server.stages import CameraPose, SeedGeometry, Viewpoint
from server.vision.expectation import expected_region
from server.vision.prior import RegionPrior
from server.vision.target import TargetEstimate

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

Kind = Literal["start", "seeded", "under_way"]
KINDS: tuple[Kind, ...] = ("start", "seeded", "under_way")

# Errors of what a drone believes: place per axis, heading, the object's place per axis.
_ERRORS: dict[Kind, tuple[float, float, float]] = {
    "start": (0.12, np.deg2rad(8.0), 0.1),
    "seeded": (0.05, np.deg2rad(2.5), 0.03),
    "under_way": (0.2, np.deg2rad(6.0), 0.05),
}
# Drones on their way to a viewpoint fly up to this much higher than one that waits, metres.
_CLIMB_M = 1.3
_DRONES = 4
_SLICES = 6
_EDGE_SHARE, _AWAY_SHARE = 0.12, 0.1
_LEAST_SEEN_PX = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One pose.

    Attributes:
        room: Number of the room.
        kind: Before the seed geometry is known, just after, or later on the way to a viewpoint.
        image_bgr: The clean picture ``(h, w, 3)``.
        truth_px: The true silhouette's box ``(4,)``, None when the object is not in the picture.
        pose: Where the drone believes to be.
        target: What it believes of the object.
        seed: The seed geometry it knows, None before there is one.
    """

    room: int
    kind: Kind
    image_bgr: Image
    truth_px: Array | None
    pose: CameraPose
    target: TargetEstimate
    seed: SeedGeometry | None

    @property
    def prior(self) -> RegionPrior:
        """Where the mission would expect the object."""
        return expected_region(self.pose, self.target, TELLO_INTRINSICS, self.seed)


def shots(model: ObjectModel, seed: int, rooms: int, poses: int) -> Iterator[Shot]:
    """Yield shots in ``rooms`` random rooms; one in ten shows no object.

    In each room ``poses`` shots are from before and just after the seed geometry, in turn, and half
    as many from later, on the way.
    """
    rng = np.random.default_rng(seed)
    rng_under_way = np.random.default_rng((seed, 2))
    world = World(model)
    try:
        for room in range(rooms):
            number = int(rng.integers(1 << 30))
            world.furnish(number, random_surroundings(number))
            for pose in range(poses):
                yield _shot(world, model, rng, room, "seeded" if pose % 2 == 1 else "start")
            for _ in range(poses // 2):
                yield _shot(world, model, rng_under_way, room, "under_way")
    finally:
        world.close()


def box_of_mask(mask: NDArray[np.bool_]) -> Array | None:
    """Return the upright box ``(4,)`` of a full-size mask, None when it is all but empty."""
    if mask.sum() < _LEAST_SEEN_PX:
        return None
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return np.array([left, top, left + width, top + height], float) - 0.5


def disturbed(image_bgr: Image, rng: np.random.Generator, exposure: bool = True) -> Image:
    """Return the picture with (exposure,) motion blur and noise of a small camera."""
    picture = image_bgr.astype(np.float32)
    if exposure:
        picture = picture * np.float32(rng.uniform(0.75, 1.2))
    length = int(rng.integers(0, 4)) * 2 + 1
    if length > 1:
        kernel = np.zeros((length, length), np.float32)
        angle = rng.uniform(0.0, np.pi)
        half = length // 2
        step = (np.array([np.cos(angle), np.sin(angle)]) * half).round().astype(int)
        cv2.line(kernel, (half - step[0], half - step[1]), (half + step[0], half + step[1]), 1.0)
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    picture = picture + rng.normal(0.0, rng.uniform(1.0, 6.0), picture.shape).astype(np.float32)
    return np.clip(picture, 0, 255).astype(np.uint8)


def _shot(
    world: World, model: ObjectModel, rng: np.random.Generator, room: int, kind: Kind
) -> Shot:
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    viewpoint = _viewpoint(box, rng, climb_m=_CLIMB_M if kind == "under_way" else 0.0)
    others = [
        (_viewpoint(box, rng, around=k * 2.0 * np.pi / _DRONES, base=viewpoint).position_world, 0.0)
        for k in range(1, _DRONES)
    ]
    T_world_cam = viewpoint.T_world_cam(TELLO_TILT_RAD)
    image = disturbed(world.render(T_world_cam, others), rng)
    truth = box_of_mask(world.silhouette(T_world_cam))
    pose, target = _belief(box, viewpoint, rng, kind)
    seed = None if kind == "start" else _seed(model, rng)
    return Shot(room, kind, image, truth, pose, target, seed)


def _viewpoint(
    box: Box3,
    rng: np.random.Generator,
    around: float = 0.0,
    base: Viewpoint | None = None,
    climb_m: float = 0.0,
) -> Viewpoint:
    """Return a viewpoint that shows the object at a random size, sometimes at the frame's edge."""
    space = FlightSpace()
    azimuth = rng.uniform(-np.pi, np.pi)
    if base is not None:
        place = base.position_world
        azimuth = float(np.arctan2(place[1], place[0])) + around + rng.normal(0.0, 0.15)
    fill, radius_m = rng.uniform(0.35, 0.95), 0.4 * float(np.hypot(*box.size[:2])) + 0.6
    lift_m = rng.normal(0.0, 0.15)
    if climb_m > 0.0:
        lift_m += rng.uniform(0.0, climb_m)
    while True:
        height_m = box.centre[2] + radius_m * np.tan(TELLO_TILT_RAD) + lift_m
        height_m = float(np.clip(height_m, space.floor_m, space.ceiling_m))
        viewpoint = facing(box.centre, azimuth, radius_m, height_m)
        if frame_fill(box, viewpoint, TELLO_INTRINSICS, TELLO_TILT_RAD) <= fill or radius_m > 4.2:
            break
        radius_m += 0.05
    turn, kind = rng.normal(0.0, 0.08), rng.random()
    if kind < _EDGE_SHARE:
        turn = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.45)
    elif kind < _EDGE_SHARE + _AWAY_SHARE:
        turn = rng.choice([-1.0, 1.0]) * rng.uniform(1.2, np.pi)
    return Viewpoint(viewpoint.position_world, viewpoint.yaw_rad + float(turn))


def _belief(
    box: Box3, viewpoint: Viewpoint, rng: np.random.Generator, kind: Kind
) -> tuple[CameraPose, TargetEstimate]:
    """Return what a drone would believe of itself and of the object, with honest errors."""
    place_m, heading_rad, target_m = _ERRORS[kind]
    position = viewpoint.position_world + rng.normal(0.0, place_m, 3) * (1.0, 1.0, 0.3)
    heading = viewpoint.yaw_rad + rng.normal(0.0, heading_rad)
    covariance = np.diag([place_m**2, place_m**2, (0.3 * place_m) ** 2, heading_rad**2])
    believed = CameraPose("d", 0.0, camera_pose(position, heading, TELLO_TILT_RAD), covariance)
    target = TargetEstimate(
        box.centre + rng.normal(0.0, target_m, 3),
        float(box.size[2]) * float(np.exp(rng.normal(0.0, 0.3))),
        np.diag([target_m**2] * 3 + [0.3**2]),
    )
    return believed, target


def _seed(model: ObjectModel, rng: np.random.Generator) -> SeedGeometry:
    """Return slices like those carved in flight: some centimetres wrong, mostly too large."""
    points = np.asarray(model.vertices, float)
    edges = np.linspace(0.0, points[:, 2].max(), _SLICES + 1)
    boxes = []
    for lower, upper in itertools.pairwise(edges):
        part = points[(points[:, 2] >= lower - 0.02) & (points[:, 2] <= upper + 0.02)]
        if len(part) == 0:
            continue
        margin = rng.normal(0.02, 0.02, (2, 2))
        low = np.append(part[:, :2].min(axis=0) - margin[0], lower)
        high = np.append(part[:, :2].max(axis=0) + margin[1], upper)
        boxes.append(Box3(low, np.maximum(high, low + 0.03)))
    return SeedGeometry(union(tuple(boxes)), tuple(boxes), 4)
