"""The planning job: where the drones shall take their pictures.

JSON in and out around ``server.planner.mission_plan``; ``PlanInput`` and ``PlanResult`` are that
JSON, read and written by pydantic on both sides.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from pydantic import BaseModel, TypeAdapter

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import camera_pose
from server.jobs.spec import JobSpec, Reporting
from server.planner.bound import views_enough
from server.planner.config import PlannerConfig
from server.planner.mission_plan import placement_problem, plan_mission
from server.planner.placement import PlanProgress
from server.planner.policies import SurfaceUncertainty, uncertainty_near
from server.stages import (
    Assignment,
    BoundKind,
    CameraPose,
    Placement,
    Priority,
    SeedGeometry,
    Viewpoint,
)

_REPORT_S = 0.25
# Up to so many are tried when asked how many are enough.
_MOST_PICTURES = 100
Corners = tuple[list[float], list[float]]


class KnownPlaces(BaseModel):
    """What a field in training knows of places on the object's surface, world metres.

    Attributes:
        points: The places.
        normals: Outward there, unit.
        uncertainty: 0 (known) to 1 of each.
    """

    points: list[tuple[float, float, float]]
    normals: list[tuple[float, float, float]]
    uncertainty: list[float]


class PlanInput(BaseModel):
    """What is to be planned; lengths in metres, angles in radians, world frame.

    Attributes:
        outer: Lower and upper corner of the object's outer box.
        boxes: The same of its slices.
        views: Views the seed geometry was made from.
        intrinsics: The cameras' intrinsics, as ``server.geometry.cameras.Intrinsics``.
        tilt_rad: The cameras' tilt.
        drones: Position x, y, z and yaw of each drone by id.
        rounds: Pictures per drone.
        pictures: Pictures in all, None: one of each drone in each round.
        config: ``PlannerConfig``.
        priorities: Lower and upper corner and weight of the parts that matter more.
        taken: Where pictures were taken already: position x, y, z and yaw.
        known: What the field knows, for the policy uncertain; None: nothing yet.
        enough: Share of the visible surface for which to find how many pictures are enough.
    """

    outer: Corners
    boxes: list[Corners]
    views: int
    intrinsics: dict[str, Any]
    tilt_rad: float
    drones: dict[str, tuple[float, float, float, float]]
    rounds: int
    pictures: int | None = None
    config: dict[str, Any]
    priorities: list[tuple[list[float], list[float], float]] = []
    taken: list[tuple[float, float, float, float]] = []
    known: KnownPlaces | None = None
    enough: float | None = None


class EnoughPictures(BaseModel):
    """How many pictures see ``share`` of the surface, tried up to ``most``.

    ``sufficient`` is None when no plan was found that does, ``needed`` when it is proven that none
    can.
    """

    share: float
    most: int
    sufficient: int | None
    needed: int | None


class PlanResult(BaseModel):
    """What was planned; a viewpoint is x, y, z and yaw.

    ``spare`` are the candidates left over, ``spare_gains`` what a picture more from each would add.
    """

    viewpoints: list[tuple[float, float, float, float]]
    fitness: float
    terms: dict[str, float]
    candidates: int
    bound: float | None
    rounds: list[dict[str, tuple[float, float, float, float]]]
    spare: list[tuple[float, float, float, float]] = []
    spare_gains: list[float] = []
    enough: EnoughPictures | None = None
    bound_kind: BoundKind | None = None

    def placement(self) -> Placement:
        """Return the chosen set."""
        viewpoints = tuple(_viewpoint(v) for v in self.viewpoints)
        return Placement(
            viewpoints,
            self.fitness,
            self.terms,
            self.candidates,
            self.bound,
            tuple(_viewpoint(v) for v in self.spare),
            np.array(self.spare_gains),
            self.bound_kind,
        )

    def assignment(self) -> Assignment:
        """Return who takes which viewpoint when."""
        rounds = ({d: _viewpoint(v) for d, v in entry.items()} for entry in self.rounds)
        return Assignment(tuple(rounds))


def run(spec: JobSpec, reporter: Reporting) -> dict[str, Any]:
    """Plan, reporting the annealing a few times a second; raises ValueError on bad input."""
    wanted = PlanInput.model_validate(spec.parameters)
    seed = SeedGeometry(
        _box(wanted.outer),
        tuple(_box(corners) for corners in wanted.boxes),
        wanted.views,
        priorities=tuple(
            Priority(_box((lower, upper)), weight) for lower, upper, weight in wanted.priorities
        ),
    )
    poses = {
        drone_id: CameraPose(
            drone_id, 0.0, camera_pose(np.array(place[:3]), place[3], wanted.tilt_rad), np.eye(4)
        )
        for drone_id, place in wanted.drones.items()
    }
    reported_s = 0.0

    def on_progress(progress: PlanProgress) -> None:
        nonlocal reported_s
        if time.monotonic() - reported_s > _REPORT_S:
            reported_s = time.monotonic()
            reporter.emit(
                "progressed",
                iteration=progress.iteration,
                iterations=progress.iterations,
                temperature=progress.temperature,
                fitness=progress.fitness,
                viewpoints=[_place(view) for view in progress.best],
            )

    camera = Intrinsics(**wanted.intrinsics)
    config = TypeAdapter(PlannerConfig).validate_python(wanted.config)
    placement, assignment = plan_mission(
        seed,
        camera,
        wanted.tilt_rad,
        poses,
        wanted.rounds,
        config,
        spec.seed,
        on_progress,
        reporter.should_stop,
        uncertainty=_uncertainty(wanted.known),
        taken=[_viewpoint(place) for place in wanted.taken],
        pictures=wanted.pictures,
    )
    return PlanResult(
        viewpoints=[_place(v) for v in placement.viewpoints],
        fitness=placement.fitness,
        terms=dict(placement.terms),
        candidates=placement.candidates,
        bound=placement.bound,
        bound_kind=placement.bound_kind,
        rounds=[{d: _place(v) for d, v in entry.items()} for entry in assignment.rounds],
        spare=[_place(v) for v in placement.spare],
        spare_gains=placement.spare_gains.tolist(),
        enough=None if wanted.enough is None else _enough(wanted.enough, seed, camera, wanted),
    ).model_dump()


def _enough(
    share: float, seed: SeedGeometry, camera: Intrinsics, wanted: PlanInput
) -> EnoughPictures:
    config = TypeAdapter(PlannerConfig).validate_python(wanted.config)
    problem = placement_problem(seed, camera, wanted.tilt_rad, config)
    found = views_enough(problem, share, _MOST_PICTURES)
    most = min(_MOST_PICTURES, len(problem.candidates))
    return EnoughPictures(share=share, most=most, sufficient=found.sufficient, needed=found.needed)


def _uncertainty(known: KnownPlaces | None) -> SurfaceUncertainty | None:
    if known is None:
        return None
    points, normals = np.reshape(known.points, (-1, 3)), np.reshape(known.normals, (-1, 3))
    return uncertainty_near(points, normals, np.array(known.uncertainty))


def _box(corners: Corners) -> Box3:
    return Box3(np.array(corners[0]), np.array(corners[1]))


def _place(viewpoint: Viewpoint) -> tuple[float, float, float, float]:
    x, y, z = (float(value) for value in viewpoint.position_world)
    return x, y, z, viewpoint.yaw_rad


def _viewpoint(place: tuple[float, float, float, float]) -> Viewpoint:
    return Viewpoint(np.array(place[:3]), place[3])
