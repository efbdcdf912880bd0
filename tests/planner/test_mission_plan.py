"""The whole plan, from seed geometry to who flies where."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from planner_objects import occupied_separation, pose_at

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import (
    AnnealingConfig,
    AvoidanceConfig,
    CandidateConfig,
    FitnessConfig,
    FlightSpace,
    PidGains,
    PlannerConfig,
    RingConfig,
    TrackingConfig,
)
from server.planner.errors import PlanError
from server.planner.mission_plan import plan_mission
from server.planner.placement import PlanProgress
from server.planner.ring import standard_ring
from server.planner.surfaces import sample_surface
from server.planner.visibility import visibility_table
from server.stages import SeedGeometry

CONFIG = PlannerConfig(annealing=AnnealingConfig(swaps=5000), fitness=FitnessConfig(samples=400))
POSES = {
    f"d{i}": pose_at(f"d{i}", 2.0 * np.cos(a), 2.0 * np.sin(a), 1.0)
    for i, a in enumerate(np.arange(4) * np.pi / 2)
}


@pytest.mark.slow
def test_a_plan_is_whole_repeatable_and_sees_more_than_the_ring(dog: SeedGeometry) -> None:
    reports: list[PlanProgress] = []
    placement, assignment = plan_mission(
        dog, TELLO_INTRINSICS, TELLO_TILT_RAD, POSES, 3, CONFIG, 0, reports.append
    )
    again, _ = plan_mission(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, POSES, 3, CONFIG, 0)
    assert placement.fitness == again.fitness
    assert reports[-1].iteration == 5000
    assert placement.candidates >= 600
    assert placement.bound is not None
    assert placement.fitness <= placement.bound
    assert len(placement.viewpoints) == 12
    assert [set(r) for r in assignment.rounds] == [set(POSES)] * 3
    assert occupied_separation(assignment, POSES, CONFIG.space) >= 1.0 - 1e-6

    samples = sample_surface(dog.boxes, 400)
    ring = standard_ring(
        dog.outer, 4, 3, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG, list(np.arange(4) * np.pi / 2)
    )
    seen = []
    for views in ([v for r in ring for v in r], [v for r in assignment.rounds for v in r.values()]):
        table = visibility_table(
            views, samples, dog.boxes, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG.fitness
        )
        seen.append(float(samples.areas_m2 @ table.visible.any(axis=0) / samples.areas_m2.sum()))
    assert seen[1] > seen[0] + 0.05


def test_a_plan_that_cannot_be_says_why(dog: SeedGeometry) -> None:
    config = dataclasses.replace(CONFIG, space=FlightSpace(fence_radius_m=0.5))
    with pytest.raises(PlanError, match="fence"):
        plan_mission(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, POSES, 3, config, 0)
    with pytest.raises(ValueError, match="at least one drone"):
        plan_mission(dog, TELLO_INTRINSICS, TELLO_TILT_RAD, {}, 3, CONFIG, 0)


@pytest.mark.parametrize(
    ("make", "field", "value"),
    [
        (FlightSpace, "fence_radius_m", 0.0),
        (FlightSpace, "ceiling_m", 0.1),
        (RingConfig, "fill", 1.0),
        (CandidateConfig, "radius_factors", (0.9,)),
        (CandidateConfig, "margin", 0.5),
        (FitnessConfig, "view_decay", 0.0),
        (FitnessConfig, "weight_detail", -1.0),
        (FitnessConfig, "tau_px", 0.0),
        (AnnealingConfig, "end_factor", 2.0),
        (AnnealingConfig, "swaps", -1),
        (TrackingConfig, "heading_share", 1.5),
        (AvoidanceConfig, "horizon_s", 0.0),
        (AvoidanceConfig, "downwash_factor", 0.5),
    ],
)
def test_bad_configuration_names_its_field(make: type, field: str, value: object) -> None:
    with pytest.raises(ValueError, match=field):
        make(**{field: value})


def test_gains_are_not_negative() -> None:
    with pytest.raises(ValueError, match="i must"):
        PidGains(1.0, i=-0.1)


def test_avoidance_may_not_ask_for_more_room_than_the_plan_leaves() -> None:
    with pytest.raises(ValueError, match="separation_m"):
        PlannerConfig(avoidance=AvoidanceConfig(radius_m=0.6))
