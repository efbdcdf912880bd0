"""Objects and drones that the planner's tests share."""

from __future__ import annotations

import pytest
from planner_objects import box, seed_of

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.candidates import generate_candidates
from server.planner.config import FitnessConfig, PlannerConfig
from server.planner.fitness import FitnessProblem, build_problem
from server.stages import SeedGeometry


@pytest.fixture(scope="session")
def dog() -> SeedGeometry:
    """Four legs, a body and a head: under the body nothing can be seen from above."""
    legs = [box(x, y, 0, x + 0.08, y + 0.08, 0.25) for x in (-0.33, 0.25) for y in (-0.15, 0.07)]
    body = box(-0.35, -0.15, 0.25, 0.35, 0.15, 0.45)
    head = box(0.3, -0.08, 0.4, 0.5, 0.08, 0.6)
    return seed_of(body, head, *legs)


@pytest.fixture(scope="session")
def dog_problem(dog: SeedGeometry) -> FitnessProblem:
    config = PlannerConfig(fitness=FitnessConfig(samples=300))
    candidates = generate_candidates(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, config)
    return build_problem(dog, candidates, TELLO_INTRINSICS, TELLO_TILT_RAD, config.fitness)
