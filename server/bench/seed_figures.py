"""How well the seed geometry fits the true mesh, with the mission's own pictures and true poses.

The course is the mission's: four seed views 90 degrees apart, the mission's own plan from them, six
rounds of it, each picture searched by the mission's tracker with the mission's expectation. Only
the poses are the true ones, so that what is measured is the eyes and the carving alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from server.geometry.boxes import Box3, union
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import PlannerConfig
from server.planner.mission_plan import plan_mission
from server.planner.ring import facing, frame_fill
from server.sim.meshes import ObjectModel
from server.sim.scenes.catalogue import load_object
from server.sim.world import World
from server.stages import CameraPose, Frame, SeedGeometry, View, Viewpoint
from server.vision.config import SeedConfig, VisionConfig
from server.vision.expectation import expected_region
from server.vision.region import RegionTracker
from server.vision.seed import SeedError, refine_seed, seed_from_views
from server.vision.target import TargetEstimate

Array = NDArray[np.float64]

DRONES = 4
ROUNDS = 6
# What the drones believe of their poses while they fly; it goes into the expected place alone.
_FLIGHT_SIGMA_M = 0.1
_FLIGHT_SIGMA_RAD = 0.05
# A hovering drone sends several pictures of a view; the tracker cuts some of them anew.
_LOOKS = 2
_START_RADIUS_M = 1.8
_FULL_FRAME = 0.85
_STEP_BACK_M = 0.1
_SURFACE_POINTS = 20_000
_SPACE_POINTS = 30_000


@dataclass(frozen=True, slots=True, eq=False)
class SeenRound:
    """What one round showed.

    Attributes:
        views: Views with an object in them, true poses.
        missed: Pictures in which the search found nothing.
    """

    views: tuple[View, ...]
    missed: int


class _Crew:
    """Four cameras in a simulated room, each with its tracker."""

    def __init__(self, world: World, vision: VisionConfig, target: TargetEstimate) -> None:
        self._world = world
        self._trackers = [RegionTracker(vision.region) for _ in range(DRONES)]
        self._target = target
        self._sequence = 0

    def look(self, viewpoints: Sequence[Viewpoint], seed: SeedGeometry | None) -> SeenRound:
        """Return the views from ``viewpoints``, one per camera."""
        views: list[View] = []
        for number, viewpoint in enumerate(viewpoints):
            others = [
                (other.position_world, other.yaw_rad)
                for k, other in enumerate(viewpoints)
                if k != number
            ]
            T = viewpoint.T_world_cam(TELLO_TILT_RAD)
            view = self._search(number, T, self._world.render(T, others), seed)
            if view is not None:
                views.append(view)
        return SeenRound(tuple(views), len(viewpoints) - len(views))

    def _search(
        self,
        number: int,
        T_world_cam: Array,
        image_bgr: NDArray[np.uint8],
        seed: SeedGeometry | None,
    ) -> View | None:
        drone_id = f"drone-{number + 1}"
        believed = CameraPose(drone_id, 0.0, T_world_cam, _covariance(1.0))
        expected = expected_region(believed, self._target, TELLO_INTRINSICS, seed)
        found = None
        for _ in range(_LOOKS):
            frame = Frame(drone_id, self._sequence, float(self._sequence), image_bgr, False)
            self._sequence += 1
            found = self._trackers[number].update(frame, expected)
        if found is None:
            return None
        region, box = found
        # The pose is the true one, and says so.
        pose = CameraPose(drone_id, 0.0, T_world_cam, _covariance(0.01))
        return View(pose, TELLO_INTRINSICS, box, region)


def _covariance(share: float) -> Array:
    sigmas = np.array([_FLIGHT_SIGMA_M] * 3 + [_FLIGHT_SIGMA_RAD])
    return np.diag((share * sigmas) ** 2)


# The flight ---------------------------------------------------------------------------------------


def seen_by_mission(
    model: ObjectModel, seed: int, rounds: int = ROUNDS, vision: VisionConfig | None = None
) -> list[SeenRound]:
    """Return what the cameras saw: first the four seed views, then each planned round.

    Args:
        model: The object.
        seed: Of the room, of the start's errors and of the plan.
        rounds: Rounds flown after the seed views.
        vision: Settings of the eyes.
    """
    vision = VisionConfig() if vision is None else vision
    rng = np.random.default_rng(seed)
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    world = World(model, supersample=2, seed=seed)
    try:
        crew = _Crew(world, vision, _centred_target(box, rng))
        starts = _seed_viewpoints(box, rng)
        seen = [crew.look(starts, None)]
        if rounds == 0:
            return seen
        fitted = seed_from_views(seen[0].views, vision.seed)
        for row in _plan(fitted, starts, rounds, seed):
            seen.append(crew.look(row, fitted))
            views = [view for each in seen for view in each.views]
            fitted = refine_seed(fitted, views, vision.seed)
        return seen
    finally:
        world.close()


def _centred_target(box: Box3, rng: np.random.Generator) -> TargetEstimate:
    """Return what the drones know of the object once they have centred it."""
    sigma_m = 0.1
    centre = box.centre + sigma_m * rng.standard_normal(3)
    return TargetEstimate(centre, float(box.size[2]), np.diag([sigma_m**2] * 3 + [0.2**2]))


def _seed_viewpoints(box: Box3, rng: np.random.Generator) -> list[Viewpoint]:
    """Return where centred drones hover: whole object in view, places and headings a little off."""
    space = PlannerConfig().space
    viewpoints: list[Viewpoint] = []
    for number in range(DRONES):
        azimuth_rad = number * np.pi / 2.0 + rng.normal(0.0, 0.08)
        radius_m, viewpoint = _START_RADIUS_M, None
        while (
            viewpoint is None
            or frame_fill(box, viewpoint, TELLO_INTRINSICS, TELLO_TILT_RAD) > _FULL_FRAME
        ):
            height_m = box.centre[2] + radius_m * np.tan(TELLO_TILT_RAD)
            height_m = float(np.clip(height_m, space.floor_m, space.ceiling_m))
            viewpoint = facing(box.centre, azimuth_rad, radius_m, height_m)
            radius_m += _STEP_BACK_M
        position = viewpoint.position_world + rng.normal(0.0, 0.03, 3)
        viewpoints.append(Viewpoint(position, viewpoint.yaw_rad + rng.normal(0.0, 0.03)))
    return viewpoints


def _plan(
    fitted: SeedGeometry, starts: Sequence[Viewpoint], rounds: int, seed: int
) -> list[list[Viewpoint]]:
    """Return the mission's rounds of viewpoints, in the order of the drones."""
    poses = {
        f"drone-{k + 1}": CameraPose(
            f"drone-{k + 1}", 0.0, viewpoint.T_world_cam(TELLO_TILT_RAD), _covariance(1.0)
        )
        for k, viewpoint in enumerate(starts)
    }
    _, assignment = plan_mission(
        fitted, TELLO_INTRINSICS, TELLO_TILT_RAD, poses, rounds, PlannerConfig(), seed
    )
    return [[row[drone_id] for drone_id in poses] for row in assignment.rounds]


# The judgement ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class SeedFit:
    """How well a union of boxes fits an object.

    Attributes:
        inside: Share of the true surface's area inside the union.
        volume_ratio: The union's volume over that of the perfect upright box.
        iou: 3D IoU of the union with the mesh's convex hull.
    """

    inside: float
    volume_ratio: float
    iou: float


def seed_figures(scene: str, seed: int, quick: bool) -> dict[str, Any]:
    """Return how well the seed geometry fits ``scene``.

    Args:
        scene: A scene's name or a mesh file.
        seed: Of the room, the start's errors and the plan; ``quick`` takes this one alone.
        quick: One mission instead of three.

    Returns:
        After the first four views ``seed_inside`` and ``seed_volume_ratio``; after all rounds
        ``seed_iou``, ``seed_inside_refined`` and ``seed_volume_ratio_refined``; the perfect upright
        box's ``seed_iou_perfect_box``; ``seed_views_missed``, pictures without a region. Means over
        the missions.
    """
    model = load_object(scene)
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    firsts, lasts, missed = [], [], []
    for number in range(1 if quick else 3):
        seen = seen_by_mission(model, seed + number)
        config = VisionConfig().seed
        first, last = fitted_after(seen[:1], config), fitted_after(seen, config)
        firsts.append(judge(model, () if first is None else first.boxes, seed))
        lasts.append(judge(model, () if last is None else last.boxes, seed))
        missed.append(sum(each.missed for each in seen))
    return {
        "seed_inside": float(np.mean([fit.inside for fit in firsts])),
        "seed_volume_ratio": float(np.mean([fit.volume_ratio for fit in firsts])),
        "seed_iou": float(np.mean([fit.iou for fit in lasts])),
        "seed_inside_refined": float(np.mean([fit.inside for fit in lasts])),
        "seed_volume_ratio_refined": float(np.mean([fit.volume_ratio for fit in lasts])),
        "seed_iou_perfect_box": judge(model, (box,), seed).iou,
        "seed_views_missed": int(sum(missed)),
    }


def fitted_after(seen: Sequence[SeenRound], config: SeedConfig) -> SeedGeometry | None:
    """Return the seed geometry from all views of ``seen``, None when they make none."""
    fitted: SeedGeometry | None = None
    views: list[View] = []
    for each in seen:
        views.extend(each.views)
        try:
            fitted = seed_from_views(views, config)
        except SeedError:
            continue
    return fitted


def judge(model: ObjectModel, boxes: Sequence[Box3], seed: int) -> SeedFit:
    """Return how well the union of ``boxes`` fits the true mesh."""
    if not boxes:
        return SeedFit(0.0, 0.0, 0.0)
    perfect = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    surface = trimesh.sample.sample_surface(model.trimesh, _SURFACE_POINTS, seed=seed)[0]
    everything = union((*boxes, perfect))
    rng = np.random.default_rng(seed)
    points = everything.lower + rng.random((_SPACE_POINTS, 3)) * everything.size
    planes = ConvexHull(model.vertices).equations
    in_hull = np.all(points @ planes[:, :3].T + planes[:, 3] <= 0.0, axis=1)
    in_boxes = _in_any(boxes, points)
    return SeedFit(
        inside=float(_in_any(boxes, np.asarray(surface)).mean()),
        volume_ratio=union_volume_m3(boxes) / perfect.volume_m3,
        iou=float((in_hull & in_boxes).sum() / (in_hull | in_boxes).sum()),
    )


def _in_any(boxes: Sequence[Box3], points: Array) -> NDArray[np.bool_]:
    return np.any([box.contains(points) for box in boxes], axis=0)


def union_volume_m3(boxes: Sequence[Box3]) -> float:
    """Return the exact volume of the union of ``boxes``, cubic metres."""
    edges = [
        np.unique([corner[axis] for box in boxes for corner in (box.lower, box.upper)])
        for axis in range(3)
    ]
    filled = np.zeros([len(each) - 1 for each in edges], bool)
    for box in boxes:
        low = [int(np.searchsorted(edges[a], box.lower[a])) for a in range(3)]
        high = [int(np.searchsorted(edges[a], box.upper[a])) for a in range(3)]
        filled[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = True
    widths = [np.diff(each) for each in edges]
    return float(np.einsum("ijk,i,j,k->", filled.astype(float), *widths))
