"""The table against a second ray caster, Algorithm 1 against the table, the terms by hand."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from planner_objects import box, seed_of

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD, Intrinsics
from server.planner.algorithm1 import Sight, algorithm1
from server.planner.config import AnnealingConfig, FitnessConfig
from server.planner.fitness import (
    FitnessProblem,
    _nearest,
    baseline,
    build_problem,
    coverage,
    evaluate,
    overlap,
    patch_weights,
    problem_from_table,
    view_worth,
)
from server.planner.placement import place
from server.planner.ring import facing
from server.planner.visibility import pose_deviations, visibility_table
from server.stages import Priority, SeedGeometry

CONFIG = FitnessConfig()


def test_the_table_agrees_with_a_mesh_ray_caster(
    dog: SeedGeometry, dog_problem: FitnessProblem
) -> None:
    mesh = trimesh.util.concatenate(
        [trimesh.creation.box(bounds=np.stack([b.lower, b.upper])) for b in dog.boxes]
    )
    assert isinstance(mesh, trimesh.Trimesh)
    samples, visible = dog_problem.samples, dog_problem.table.visible
    differing = total = 0
    for index in range(0, len(dog_problem.candidates), 90):
        eye = dog_problem.candidates[index].position_world
        lines = samples.points - eye
        distance = np.linalg.norm(lines, axis=1)
        cosine = -(lines * samples.normals).sum(axis=1) / distance
        hits, rays, _ = mesh.ray.intersects_location(
            np.tile(eye, (len(lines), 1)), lines / distance[:, None], multiple_hits=False
        )
        first = np.full(len(lines), np.inf)
        first[rays] = np.linalg.norm(hits - eye, axis=1)
        seen = (first > distance - 1e-3) & (cosine > np.cos(CONFIG.incidence_max_rad))
        differing += int((seen != visible[index]).sum())
        total += len(lines)
    # Rays along the common edge of two boxes may fall either way.
    assert differing <= 0.005 * total


def test_algorithm_1_by_its_letter_equals_the_table() -> None:
    boxes = (box(-0.2, -0.2, 0, 0.2, 0.2, 0.5), box(0.3, -0.1, 0, 0.5, 0.1, 0.9))
    seed = seed_of(*boxes)
    config = FitnessConfig(samples=50)
    views = [facing(seed.outer.centre, a, 1.9, 0.9) for a in (0.3, 1.4, 2.9, 4.2)]
    problem = build_problem(seed, views, TELLO_INTRINSICS, TELLO_TILT_RAD, config)
    literal = algorithm1(
        C=[views[:2], views[2:]],
        S=(boxes, problem.samples),
        D=pose_deviations(config),
        F=range(2),
        sight=Sight(TELLO_INTRINSICS, TELLO_TILT_RAD, config.tau_px, config.incidence_max_rad),
        weights=problem.area_share,
    )
    assert literal == pytest.approx((problem.table.agreement @ problem.area_share).sum(), rel=1e-6)
    assert literal > 0.1


def test_algorithm_1_takes_off_for_uncertain_poses_and_hidden_samples() -> None:
    near = box(-0.2, -0.2, 0, 0.2, 0.2, 0.5)
    screen = box(0.5, -0.5, 0, 0.6, 0.5, 1.5)
    view = [facing(near.centre, 0.0, 2.0, 0.6)]
    sight = Sight(TELLO_INTRINSICS, TELLO_TILT_RAD, 60.0, CONFIG.incidence_max_rad)
    samples = build_problem(
        seed_of(near), view, TELLO_INTRINSICS, TELLO_TILT_RAD, FitnessConfig(samples=50)
    ).samples
    weights = np.full(len(samples), 1.0 / len(samples))

    def value(boxes: list, sigma: float) -> float:
        deviations = pose_deviations(FitnessConfig(position_sigma_m=sigma, yaw_sigma_rad=0.0))
        return algorithm1([view], (boxes, samples), deviations, [0], sight, weights)

    assert value([near], 0.0) > value([near], 0.05) > value([near], 0.2) > 0.0
    assert value([near, screen], 0.0) < 0.5 * value([near], 0.0)


def test_a_distorted_camera_gives_the_same_table_as_its_own_projection() -> None:
    lens = Intrinsics(960, 720, 921.0, 921.0, 479.5, 359.5, (-0.05, 0.02, 0.001, -0.001, 0.0))
    seed = seed_of(box(-0.2, -0.2, 0, 0.2, 0.2, 0.5))
    # Near enough that the picture cuts the object off.
    view = facing(seed.outer.centre, 0.2, 0.75, 0.5)
    samples = build_problem(seed, [view], lens, TELLO_TILT_RAD, CONFIG).samples
    table = visibility_table([view], samples, seed.boxes, lens, TELLO_TILT_RAD, CONFIG)
    pixels, _ = lens.project(samples.points, view.T_world_cam(TELLO_TILT_RAD))
    seen = table.visible[0]
    assert seen.any()
    assert lens.contains(pixels[seen]).all()


def test_detail_is_the_formula(dog_problem: FitnessProblem) -> None:
    c, s = (int(i[0]) for i in np.nonzero(dog_problem.table.visible))
    line = dog_problem.candidates[c].position_world - dog_problem.samples.points[s]
    distance = np.linalg.norm(line)
    cosine = line @ dog_problem.samples.normals[s] / distance
    doubt = dog_problem.config.normal_doubt
    expected = ((1.0 - doubt) * cosine + doubt / 2.0) * (921 / distance) ** 2
    assert dog_problem.table.detail_px_per_m2[c, s] == pytest.approx(expected)


def test_more_views_of_a_sample_are_worth_less_and_less() -> None:
    worth = view_worth(CONFIG, 24)
    steps = np.diff(worth)
    assert worth[0] == 0.0
    assert worth[-1] == pytest.approx(1.0)
    assert (np.diff(steps) <= 1e-12).all()
    assert steps[CONFIG.views_wanted - 1] > 0 == steps[CONFIG.views_wanted]
    assert view_worth(CONFIG, 4)[1] == 1.0


def test_every_term_and_the_fitness_stay_between_zero_and_one(dog_problem: FitnessProblem) -> None:
    rng = np.random.default_rng(1)
    for views in (1, 4, 24):
        chosen = rng.choice(len(dog_problem.candidates), views, replace=False)
        value, terms = evaluate(dog_problem, chosen, views)
        assert 0.0 <= value <= 1.0
        for name, term in terms.items():
            assert 0.0 <= term <= 1.0, name


def test_coverage_never_falls_when_a_view_is_added(dog_problem: FitnessProblem) -> None:
    chosen = np.random.default_rng(2).permutation(len(dog_problem.candidates))[:12]
    values = [coverage(dog_problem, chosen[:n], dog_problem.area_share, 12) for n in range(13)]
    assert (np.diff(values) >= -1e-12).all()
    assert values[-1] > values[1] > values[0] == 0.0


def test_twins_overlap_and_are_bad_neighbours() -> None:
    seed = seed_of(box(-0.2, -0.2, 0, 0.2, 0.2, 0.5))
    azimuths = (0.0, 0.001, np.deg2rad(25.0), np.pi)
    views = [facing(seed.outer.centre, a, 1.9, 0.9) for a in azimuths]
    problem = build_problem(seed, views, TELLO_INTRINSICS, TELLO_TILT_RAD, CONFIG)
    twins, spaced, opposite = np.array([0, 1]), np.array([0, 2]), np.array([0, 3])
    assert overlap(problem, twins, 2) == pytest.approx(0.5, abs=0.02)
    assert overlap(problem, spaced, 2) == overlap(problem, opposite, 2) == 0.0
    # With 24 views in mind 25 degrees is a good baseline; half a turn is none.
    assert baseline(problem, spaced, 24) * 12 == pytest.approx(1.0, abs=0.01)
    assert baseline(problem, twins, 24) < 0.02
    assert baseline(problem, opposite, 24) == 0.0


def test_a_marked_part_counts_as_often_as_was_asked_for(dog_problem: FitnessProblem) -> None:
    samples = dog_problem.samples
    top = float(samples.points[:, 2].max())
    lower, upper = samples.points.min(axis=0), samples.points.max(axis=0)
    lower[2] = top - 0.2 * (top - lower[2])
    part = Box3(lower, upper)
    inside = part.grown(1e-4).contains(samples.points)
    assert 0 < inside.sum() < len(samples)
    weights = patch_weights(samples, [Priority(part, 4.0), Priority(part, 2.0)])
    assert (weights[inside] == 4.0).all()
    assert (weights[~inside] == 1.0).all()
    marked = problem_from_table(
        dog_problem.candidates, samples, dog_problem.table, dog_problem.config, weights=weights
    )
    for plain, share in (
        (dog_problem.area_share, marked.area_share),
        (dog_problem.priority_share, marked.priority_share),
    ):
        assert share.sum() == pytest.approx(1.0)
        outside = ~inside & (plain > 0.0)
        some = inside & (plain > 0.0)
        ratio = (share[some] / plain[some]).mean() / (share[outside] / plain[outside]).mean()
        assert ratio == pytest.approx(4.0)


def test_a_plan_looks_more_closely_at_a_marked_part(dog_problem: FitnessProblem) -> None:
    samples = dog_problem.samples
    side = samples.points[:, 0] > np.quantile(samples.points[:, 0], 0.8)
    weights = np.where(side, 10.0, 1.0)
    marked = problem_from_table(
        dog_problem.candidates, samples, dog_problem.table, dog_problem.config, weights=weights
    )
    config = AnnealingConfig(swaps=3000, prove=False)

    def views_of_side(problem: FitnessProblem, views: int) -> float:
        placement = place(problem, views, config, np.random.default_rng(0))
        chosen = [problem.candidates.index(view) for view in placement.viewpoints]
        seen = problem.quality[chosen].sum(axis=0)
        share = samples.areas_m2 * side
        return float(seen @ share / share.sum())

    assert views_of_side(marked, 2) > 1.3 * views_of_side(dog_problem, 2)
    # With many more views a plan sees every part well, marked or not.
    assert views_of_side(marked, 8) > views_of_side(dog_problem, 8)


def test_the_nearest_others_are_nearest_and_never_oneself() -> None:
    rng = np.random.default_rng(4)
    places = rng.normal(size=(60, 3))
    places[7] = places[21] = places[33]  # Several may stand at one place and look elsewhere.
    found = _nearest(places, 12)
    assert found.shape == (60, 12)
    away = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(away, np.inf)
    told = np.take_along_axis(away, found, axis=1)
    np.testing.assert_allclose(told, np.sort(away, axis=1)[:, :12])


def test_two_candidates_have_one_neighbour_each() -> None:
    np.testing.assert_array_equal(_nearest(np.eye(3)[:2], 12), [[1], [0]])


def test_a_crowd_at_one_place_does_not_count_itself() -> None:
    found = _nearest(np.zeros((20, 3)), 12)
    assert (found != np.arange(20)[:, None]).all()
