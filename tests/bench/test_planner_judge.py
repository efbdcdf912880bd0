"""The planner bench's judge and rivals, on shapes whose figures are known."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np
import pytest
import trimesh

from server.bench.planner_judge import Judge
from server.bench.planner_plans import (
    MEASURES,
    best_ring,
    exact_problem,
    farthest_views,
    ring_score,
    rings_around,
    score,
)
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS
from server.planner.config import AnnealingConfig, PlannerConfig
from server.planner.placement import choose
from server.planner.ring import facing
from server.sim.meshes import ObjectModel

WHOLE = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.8]))
CENTRE = WHOLE.centre


def model_of(mesh: trimesh.Trimesh) -> ObjectModel:
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    return ObjectModel(vertices, faces, np.full((len(vertices), 3), 200, np.uint8))


def joined(*parts: trimesh.Trimesh) -> trimesh.Trimesh:
    return cast(trimesh.Trimesh, trimesh.util.concatenate(list(parts)))


def cuboid() -> trimesh.Trimesh:
    mesh = trimesh.creation.box((0.6, 0.4, 0.8))
    mesh.apply_translation([0.0, 0.0, 0.4])
    return mesh


def test_a_level_view_sees_one_face_of_a_cuboid() -> None:
    sights = Judge(model_of(cuboid()), 4000, 0).look([facing(CENTRE, 0.0, 2.0, 0.6)])
    # Two of 0.4 x 0.8, two of 0.6 x 0.8, two of 0.6 x 0.4: 2.08 square metres.
    assert sights.visibility([0]) == pytest.approx(0.32 / 2.08, abs=0.02)
    assert sights.visibility([0], views=2) == 0.0
    seen = sights.detail_px_per_m2[0][sights.visible[0]]
    head_on = TELLO_INTRINSICS.fx**2 / 1.7**2
    assert seen.max() == pytest.approx(head_on, rel=0.05)
    assert sights.detail([0]) == pytest.approx(
        float(np.log1p(sights.detail_px_per_m2[0] / 2e4).mean())
    )


def test_winding_does_not_matter_and_what_is_inside_stays_hidden() -> None:
    plain = cuboid()
    turned = plain.copy()
    turned.invert()
    views = [facing(CENTRE, a, 1.8, 1.2) for a in (0.4, 2.0)]
    first, second = (Judge(model_of(mesh), 2000, 0).look(views) for mesh in (plain, turned))
    assert abs(first.visibility([0, 1]) - second.visibility([0, 1])) < 0.02
    inner = trimesh.creation.box((0.1, 0.1, 0.1))
    inner.apply_translation([0.0, 0.0, 0.4])
    judge = Judge(model_of(joined(plain, inner)), 4000, 0)
    hidden = np.abs(judge.points_world - [0.0, 0.0, 0.4]).max(axis=1) < 0.06
    assert hidden.sum() > 20
    assert not judge.look(views).visible[:, hidden].any()


def test_what_stands_in_front_hides() -> None:
    wall = trimesh.creation.box((0.05, 1.0, 1.6))
    wall.apply_translation([0.6, 0.0, 0.8])
    both = joined(cuboid(), wall)
    judge = Judge(model_of(both), 3000, 0)
    behind = judge.points_world[:, 0] < 0.5
    east, west = judge.look([facing(CENTRE, a, 2.2, 0.8) for a in (0.0, np.pi)]).visible
    assert not east[behind].any()
    assert west[behind].any()


def test_rings_have_whole_phases_and_the_best_is_no_worse() -> None:
    rings = rings_around(WHOLE, PlannerConfig())
    sights = Judge(model_of(cuboid()), 400, 0).look(rings.views)
    for k in (4, 24):
        phases = list(rings.phases(0, k))
        assert len(phases) == 48 // k
        assert all(len(set(phase.tolist())) == k for phase in phases)
        for measure in MEASURES:
            best = score(sights, best_ring(rings, sights, k, measure), measure)
            assert best >= ring_score(rings, sights, k, measure) - 1e-12


@pytest.mark.parametrize("measure", MEASURES[:2])
def test_the_objective_is_the_measure(measure: str) -> None:
    """Annealing a measure's objective climbs that measure, past random choices."""
    judge = Judge(model_of(cuboid()), 400, 0)
    views = [facing(CENTRE, a, 1.6, h) for a in np.arange(24) * np.pi / 12 for h in (0.5, 1.4)]
    sights = judge.look(views)
    problem = exact_problem(judge, views, sights, measure)
    rng = np.random.default_rng(0)
    chosen, _ = choose(problem, 4, AnnealingConfig(swaps=3000), rng)
    draws = [rng.choice(len(views), 4, replace=False) for _ in range(300)]
    assert score(sights, chosen, measure) >= max(score(sights, d, measure) for d in draws) - 1e-9


def test_farthest_views_are_apart() -> None:
    views = [facing(CENTRE, a, 1.6, 1.0) for a in np.arange(36) * np.pi / 18]
    chosen = farthest_views(views, 4, np.random.default_rng(3))
    places = np.array([views[i].position_world for i in chosen])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(4, 1)]
    assert apart.min() > 1.6


def test_no_detail_without_visibility() -> None:
    judge = Judge(model_of(cuboid()), 300, 0)
    sights = judge.look([facing(CENTRE, 0.0, 2.0, 0.6)])
    assert not sights.detail_px_per_m2[~sights.visible].any()
    blind = dataclasses.replace(sights, visible=np.zeros_like(sights.visible))
    assert blind.visibility([0]) == 0.0
