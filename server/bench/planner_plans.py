"""The plans that the planner bench compares, each by its plain definition.

Symbols: K views; measures are ``visibility``, ``detail_visibility`` and ``visibility_two_views``,
as ``server.bench.planner_judge`` computes them on the true mesh.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from server.bench.planner_judge import DETAIL_PX_PER_M2, INCIDENCE_MAX_RAD, Judge, Sights
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.planner.config import FitnessConfig, PlannerConfig
from server.planner.fitness import FitnessProblem, problem_from_table
from server.planner.mission_plan import plan_mission
from server.planner.ring import facing, standard_ring
from server.planner.surfaces import SurfaceSamples
from server.planner.visibility import VisibilityTable
from server.stages import CameraPose, SeedGeometry, Viewpoint

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MEASURES = ("visibility", "detail_visibility", "visibility_two_views")
DRONES = 4
# Divides 360 degrees so that rings of 4 and of 24 views have whole phases.
_AZIMUTHS = 48
_RING_RADII, _RING_HEIGHTS = 6, 6


def score(sights: Sights, chosen: Sequence[int] | Indices, measure: str) -> float:
    """Return ``measure`` of the views ``chosen``."""
    if measure == "detail_visibility":
        return sights.detail(chosen)
    return sights.visibility(chosen, 2 if measure == "visibility_two_views" else 1)


def objective(measure: str) -> FitnessConfig:
    """Return weights with which the fitness is ``measure`` and nothing else, up to a factor.

    Two views are asked for by their concave hull, min(n, 2) / 2, which greedy choice can climb.
    """
    none = FitnessConfig(
        incidence_max_rad=float(INCIDENCE_MAX_RAD),
        sharp_share=1e-9,
        detail_px_per_m2=DETAIL_PX_PER_M2,
        normal_doubt=0.0,
        views_wanted=1,
        weight_agreement=0.0,
        weight_visibility=0.0,
        weight_detail=1.0,
        weight_priority=0.0,
        weight_spread=0.0,
        weight_baseline=0.0,
        weight_overlap=0.0,
    )
    if measure == "detail_visibility":
        return none
    seen = replace(none, weight_detail=0.0, weight_visibility=1.0)
    if measure == "visibility":
        return seen
    return replace(seen, views_wanted=2, pictures_per_view=1.0, view_decay=1.0)


def exact_problem(
    judge: Judge, candidates: Sequence[Viewpoint], sights: Sights, measure: str
) -> FitnessProblem:
    """Return the problem of choosing by ``measure`` on the true mesh itself."""
    count = len(judge.points_world)
    samples = SurfaceSamples(
        judge.points_world,
        judge.normals_world,
        np.full(count, judge.area_m2 / count),
        np.zeros(count),
    )
    table = VisibilityTable(sights.visible, sights.detail_px_per_m2, sights.visible.astype(float))
    return problem_from_table(candidates, samples, table, objective(measure))


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """Poses on circles about the object, ``_AZIMUTHS`` on each; the first circle is the standard.

    Attributes:
        views: All poses, circle after circle, counter-clockwise.
        circles: Number of circles.
    """

    views: tuple[Viewpoint, ...]
    circles: int

    def phases(self, circle: int, k: int) -> Iterator[Indices]:
        """Yield the indices of K evenly spaced poses of one circle, in every phase."""
        step = _AZIMUTHS // k
        for phase in range(step):
            yield circle * _AZIMUTHS + phase + step * np.arange(k)


def rings_around(box: Box3, config: PlannerConfig) -> Rings:
    """Return the standard circle and a grid of all radii and heights that may be flown."""
    standard = standard_ring(
        box, DRONES, 1, TELLO_INTRINSICS, TELLO_TILT_RAD, config, list(np.arange(4) * np.pi / 2)
    )[0][0].position_world
    space = config.space
    own = float(np.hypot(*(standard - box.centre)[:2]))
    nearest = float(np.hypot(*(box.size[:2] / 2.0))) + space.standoff_m
    farthest = max(nearest, min(2.0 * own, space.fence_radius_m))
    radii = np.linspace(nearest, farthest, _RING_RADII)
    heights = np.linspace(space.floor_m, space.ceiling_m, _RING_HEIGHTS)
    circles = [(own, float(standard[2]))]
    circles += [(float(radius), float(height)) for radius in radii for height in heights]
    azimuths = np.arange(_AZIMUTHS) * 2.0 * np.pi / _AZIMUTHS
    views = tuple(facing(box.centre, float(a), r, h) for r, h in circles for a in azimuths)
    return Rings(views, len(circles))


def ring_score(rings: Rings, sights: Sights, k: int, measure: str) -> float:
    """Return the mean of the standard ring over its phases."""
    return float(np.mean([score(sights, chosen, measure) for chosen in rings.phases(0, k)]))


def best_ring(rings: Rings, sights: Sights, k: int, measure: str) -> Indices:
    """Return the best ring over all radii, heights and phases."""
    every = (chosen for circle in range(rings.circles) for chosen in rings.phases(circle, k))
    return max(every, key=lambda chosen: score(sights, chosen, measure))


def farthest_views(candidates: Sequence[Viewpoint], k: int, rng: np.random.Generator) -> Indices:
    """Return K candidates by farthest-point sampling of their places, from a random first one."""
    places = np.array([view.position_world for view in candidates])
    chosen = [int(rng.integers(len(places)))]
    nearest = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < k:
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return np.array(chosen, np.intp)


def mission_views(
    seed: SeedGeometry, k: int, config: PlannerConfig, seed_value: int
) -> tuple[Viewpoint, ...]:
    """Return what the mission would fly with ``DRONES`` drones that stand around ``seed``."""
    poses = {}
    for number in range(DRONES):
        start = facing(seed.outer.centre, number * np.pi / 2.0, 2.0, 1.0)
        T = camera_pose(start.position_world, start.yaw_rad, TELLO_TILT_RAD)
        name = f"drone-{number + 1}"
        poses[name] = CameraPose(name, 0.0, T, np.diag([0.01] * 3 + [0.0025]))
    _, assignment = plan_mission(
        seed, TELLO_INTRINSICS, TELLO_TILT_RAD, poses, k // DRONES, config, seed_value
    )
    return tuple(view for row in assignment.rounds for view in row.values())
