"""The measures of the seed bench, on shapes whose figures are known."""

import numpy as np
import pytest
import trimesh

from server.bench.seed_figures import judge, seen_by_mission, union_volume_m3
from server.geometry.boxes import Box3
from server.sim.meshes import ObjectModel
from server.sim.scenes.catalogue import load_object


def cube() -> ObjectModel:
    mesh = trimesh.creation.box((0.6, 0.4, 0.8))
    vertices = np.asarray(mesh.vertices) + np.array([0.0, 0.0, 0.4])
    colours = np.full((len(vertices), 3), 200, np.uint8)
    return ObjectModel(vertices, np.asarray(mesh.faces), colours)


WHOLE = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.8]))


def test_the_perfect_box_of_a_cuboid_is_perfect():
    fit = judge(cube(), (WHOLE.grown(1e-9),), 0)
    assert fit.inside == 1.0
    assert fit.volume_ratio == pytest.approx(1.0)
    assert fit.iou == pytest.approx(1.0)


def test_half_of_a_cuboid_and_twice_it():
    lower_half = Box3(WHOLE.lower, np.array([0.3, 0.2, 0.4]))
    half = judge(cube(), (lower_half,), 0)
    assert half.volume_ratio == pytest.approx(0.5)
    assert half.iou == pytest.approx(0.5, abs=0.02)
    assert 0.4 < half.inside < 0.6
    double = judge(cube(), (Box3(WHOLE.lower, np.array([0.3, 0.2, 1.6])),), 0)
    assert double.volume_ratio == pytest.approx(2.0)
    assert double.iou == pytest.approx(0.5, abs=0.02)
    assert judge(cube(), (), 0).inside == 0.0


def test_overlapping_boxes_count_once():
    aside = np.array([0.3, 0.0, 0.0])
    shifted = Box3(WHOLE.lower + aside, WHOLE.upper + aside)
    assert union_volume_m3((WHOLE, shifted)) == pytest.approx(1.5 * WHOLE.volume_m3)
    assert union_volume_m3((WHOLE, WHOLE)) == pytest.approx(WHOLE.volume_m3)


@pytest.mark.slow
def test_the_seed_views_are_the_missions():
    (seen,) = seen_by_mission(load_object("recycle_bin"), 0, rounds=0)
    assert len(seen.views) + seen.missed == 4
    assert len(seen.views) >= 3
    # Each camera looks at the object from its own side, its pose sure.
    places = np.stack([view.pose.position_world for view in seen.views])
    apart_m = np.linalg.norm(places[:, None] - places[None], axis=2)
    assert apart_m[np.triu_indices(len(places), 1)].min() > 1.0
    assert all(view.pose.position_sigma_m < 0.01 for view in seen.views)
