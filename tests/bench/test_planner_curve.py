"""What the planner bench tells of larger tasks and of wrong seed geometry."""

from __future__ import annotations

import numpy as np

from server.bench.planner_curve import size_curve, wrong_seeds
from server.bench.planner_judge import Judge
from server.bench.planner_plans import MEASURES
from server.geometry.boxes import Box3
from server.planner.config import PlannerConfig
from server.sim.scenes.catalogue import load_object

BOX = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.6]))


def test_larger_tasks_are_told_with_their_size_and_hold_more() -> None:
    small, more, finer = size_curve(BOX, 0, [(80, 200), (160, 200), (160, 800)])
    assert (small["candidates"], more["candidates"], finer["candidates"]) == (80, 160, 160)
    assert small["samples"] == more["samples"] < finer["samples"]
    assert small["mbyte"] < more["mbyte"] < finer["mbyte"]
    assert min(row[key] for row in (small, more, finer) for key in ("table_s", "search_s")) >= 0.0


def test_plans_on_wrong_boxes_are_judged_on_the_true_mesh() -> None:
    model = load_object("recycle_bin")
    box = Box3(model.vertices.min(axis=0), model.vertices.max(axis=0))
    judge = Judge(model, 300, 0)
    found = wrong_seeds(judge, box, 4, PlannerConfig(), 0)
    assert list(found) == ["times_0.8", "times_1.2"]
    for figures in found.values():
        assert set(figures) == set(MEASURES)
        assert 0.2 < figures["visibility"] <= 1.0
