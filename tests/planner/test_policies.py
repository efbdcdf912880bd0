"""The rules that choose viewpoints, behind one signature."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from planner_objects import pose_at

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.planner.config import AnnealingConfig, FitnessConfig, PlannerConfig
from server.planner.errors import PlanError
from server.planner.fitness import FitnessProblem
from server.planner.mission_plan import plan_mission
from server.planner.policies import (
    POLICIES,
    SurfaceUncertainty,
    choose_farthest,
    uncertain_weights,
    uncertainty_near,
)
from server.stages import SeedGeometry

CONFIG = AnnealingConfig(swaps=500)
SMALL = PlannerConfig(
    annealing=AnnealingConfig(swaps=2000, prove=False), fitness=FitnessConfig(samples=300)
)


@pytest.mark.parametrize("name", sorted(POLICIES))
def test_every_policy_chooses_different_candidates_repeatably(
    name: str, dog_problem: FitnessProblem
) -> None:
    chosen, stopped = POLICIES[name](dog_problem, 6, CONFIG, np.random.default_rng(1))
    again, _ = POLICIES[name](dog_problem, 6, CONFIG, np.random.default_rng(1))
    assert not stopped
    assert len(set(chosen.tolist())) == 6
    np.testing.assert_array_equal(chosen, again)


def test_farthest_views_are_farther_apart_than_random_ones(dog_problem: FitnessProblem) -> None:
    def least_rad(chosen: np.ndarray) -> float:
        angles = dog_problem.angles_rad[np.ix_(chosen, chosen)]
        return float(angles[np.triu_indices(len(chosen), 1)].min())

    rng = np.random.default_rng(0)
    chosen, _ = choose_farthest(dog_problem, 8, CONFIG, rng)
    draws = [rng.choice(len(dog_problem.candidates), 8, replace=False) for _ in range(50)]
    assert least_rad(chosen) > max(least_rad(draw) for draw in draws)


def test_farthest_refuses_what_cannot_be(dog_problem: FitnessProblem) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="at least one"):
        choose_farthest(dog_problem, 0, CONFIG, rng)
    with pytest.raises(PlanError, match="feasible"):
        choose_farthest(dog_problem, len(dog_problem.candidates) + 1, CONFIG, rng)


def test_what_the_field_does_not_know_draws_the_views(dog: SeedGeometry) -> None:
    poses = {"d0": pose_at("d0", 2.0, 0.0, 1.0)}
    config = dataclasses.replace(SMALL, policy="uncertain", uncertainty_gain=30.0)

    def mean_x(uncertainty: SurfaceUncertainty | None) -> float:
        placement, _ = plan_mission(
            dog, TELLO_INTRINSICS, TELLO_TILT_RAD, poses, 3, config, 0, uncertainty=uncertainty
        )
        return float(np.mean([view.position_world[0] for view in placement.viewpoints]))

    west = mean_x(lambda points, _: (points[:, 0] < 0.0).astype(float))
    east = mean_x(lambda points, _: (points[:, 0] >= 0.0).astype(float))
    assert west < east - 0.05


def test_the_two_sides_of_a_thin_part_are_known_apart() -> None:
    places = np.array([[x, 0.0, z] for x in np.linspace(-0.5, 0.5, 9) for z in (0.2, 0.5, 0.8)])
    front = np.tile([0.0, -1.0, 0.0], (len(places), 1))
    known = uncertainty_near(
        np.concatenate([places, places + np.array([0.0, 0.02, 0.0])]),
        np.concatenate([front, -front]),
        np.repeat([0.1, 0.9], len(places)),
    )
    asked = np.array([[0.1, 0.01, 0.4]])
    assert known(asked, front[:1]) < 0.4
    assert known(asked, -front[:1]) > 0.8


def test_without_places_nothing_is_known() -> None:
    known = uncertainty_near(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    np.testing.assert_array_equal(known(np.zeros((3, 3)), np.zeros((3, 3))), 1.0)


def test_one_place_is_enough() -> None:
    up = np.array([[0.0, 0.0, 1.0]])
    known = uncertainty_near(np.zeros((1, 3)), up, np.array([0.4]))
    assert known(np.zeros((1, 3)), up) == pytest.approx(0.4)


def test_far_from_all_places_nothing_is_known() -> None:
    places = np.stack(np.meshgrid([0.0, 0.1], np.linspace(0.0, 1.0, 11), 0.5), -1).reshape(-1, 3)
    up = np.tile([0.0, 0.0, 1.0], (len(places), 1))
    known = uncertainty_near(places, up, np.full(len(places), 0.1))
    assert known(places[:1], up[:1]) == pytest.approx(0.1)
    near, far = known(np.array([[-0.1, 0.5, 0.5], [-0.8, 0.5, 0.5]]), up[:2])
    assert 0.1 < near < 0.5 < 0.99 < far


def test_a_field_that_answers_nonsense_is_refused() -> None:
    points = np.zeros((4, 3))
    for answer in (np.zeros(3), np.full(4, 1.5), np.full(4, np.nan)):
        with pytest.raises(ValueError, match="uncertainty"):
            uncertain_weights(points, points, lambda *_, answer=answer: answer, 1.0)


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(ValueError, match="policy"):
        PlannerConfig(policy="luck")
