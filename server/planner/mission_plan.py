"""From seed geometry to who flies where: all planning in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from server.geometry.cameras import Intrinsics
from server.planner.assignment import assign
from server.planner.candidates import generate_candidates
from server.planner.config import PlannerConfig
from server.planner.fitness import FitnessProblem, build_problem
from server.planner.placement import CancelCheck, ProgressReport, place
from server.planner.policies import POLICIES, SurfaceUncertainty, uncertain_weights
from server.stages import Assignment, CameraPose, Placement, SeedGeometry, Viewpoint


def plan_mission(
    seed: SeedGeometry,
    intrinsics: Intrinsics,
    tilt_rad: float,
    drone_poses: Mapping[str, CameraPose],
    rounds: int,
    config: PlannerConfig,
    seed_value: int,
    on_progress: ProgressReport | None = None,
    cancelled: CancelCheck | None = None,
    uncertainty: SurfaceUncertainty | None = None,
    taken: Sequence[Viewpoint] = (),
    pictures: int | None = None,
) -> tuple[Placement, Assignment]:
    """Choose viewpoints around ``seed`` and share them out.

    Args:
        seed: The object's crude geometry.
        intrinsics: Camera.
        tilt_rad: How far the camera looks down.
        drone_poses: Where each drone is now; its keys name the drones.
        rounds: Pictures per drone.
        config: Everything else.
        seed_value: Seed of the annealing; the same inputs and seed give the same plan.
        on_progress: Called every few thousand moves.
        cancelled: Asked as often; True ends the search with the best choice so far.
        uncertainty: How little the field knows of the surface; the policy uncertain needs it and
            without it anneals as if everything were known equally well.
        pictures: How many to choose, None: one for each drone in each round.
        taken: Where pictures were taken already; what is chosen adds to them.

    Returns:
        The placement, and which drone takes which of its viewpoints in which round. In the
        assignment a viewpoint may stand farther out than in the placement, to keep drones apart.

    Raises:
        ValueError: Without drones or rounds.
        PlanError: If the constraints leave no plan; the text names the constraint.
    """
    if not drone_poses or rounds < 1:
        raise ValueError("a mission plan needs at least one drone and one round")
    problem = placement_problem(seed, intrinsics, tilt_rad, config, uncertainty, taken)
    placement = place(
        problem,
        len(taken) + (len(drone_poses) * rounds if pictures is None else pictures),
        config.annealing,
        np.random.default_rng(seed_value),
        on_progress,
        cancelled,
        POLICIES[config.policy],
    )
    assignment = assign(placement.viewpoints, drone_poses, seed.outer.centre, config.space)
    return placement, assignment


def placement_problem(
    seed: SeedGeometry,
    intrinsics: Intrinsics,
    tilt_rad: float,
    config: PlannerConfig,
    uncertainty: SurfaceUncertainty | None = None,
    taken: Sequence[Viewpoint] = (),
) -> FitnessProblem:
    """Return what ``plan_mission`` chooses by: the candidates around ``seed``, what each sees.

    Raises:
        PlanError: If no candidate is left; the text names the constraint.
    """
    candidates = generate_candidates(seed, intrinsics, tilt_rad, config)
    weigh = None
    if config.policy == "uncertain" and uncertainty is not None:
        weigh = partial(uncertain_weights, uncertainty=uncertainty, gain=config.uncertainty_gain)
    neighbours = config.annealing.neighbours
    return build_problem(
        seed, candidates, intrinsics, tilt_rad, config.fitness, neighbours, weigh, taken
    )
