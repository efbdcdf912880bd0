"""Scale from one known length: exact marks, honest errors, marks that make no sense."""

from __future__ import annotations

import math

import numpy as np
import pytest

from server.geometry.poses import Similarity
from server.nerf.pose_scale import Mark, scale_from_length
from tests.nerf.pose_room import CAMERA, ring

ENDS = np.array([[-0.2, 0.1, 0.3], [0.3, -0.1, 0.7]])
LENGTH_M = float(np.linalg.norm(ENDS[1] - ENDS[0]))
T_TRUE = ring(4, 2, 0.4)[0]
CAMERAS = [CAMERA] * len(T_TRUE)


def marks(
    pictures: list[int], rng: np.random.Generator | None = None, sigma_px: float = 0.0
) -> tuple[list[Mark], list[Mark]]:
    found = []
    for end in ENDS:
        own = []
        for picture in pictures:
            pixel = CAMERA.project(end[None], T_TRUE[picture])[0][0]
            if rng is not None:
                pixel = pixel + rng.normal(0.0, sigma_px, 2)
            own.append(Mark(picture, pixel))
        found.append(own)
    return found[0], found[1]


def test_a_world_that_is_too_small_is_scaled_up() -> None:
    shrunk = Similarity(0.8, np.eye(3), np.array([1.0, 2.0, 0.0])).poses(T_TRUE)
    found = scale_from_length(marks([0, 2, 5]), LENGTH_M, shrunk, CAMERAS)
    assert found.factor == pytest.approx(1.25, rel=1e-6)
    assert found.measured_m == pytest.approx(0.8 * LENGTH_M, rel=1e-6)


def test_the_error_is_what_marks_scatter_by() -> None:
    rng = np.random.default_rng(1)
    found = [
        scale_from_length(marks([0, 3, 6], rng, 2.0), LENGTH_M, T_TRUE, CAMERAS) for _ in range(300)
    ]
    scatter = float(np.std([f.factor for f in found]))
    said = float(np.mean([f.sigma for f in found]))
    assert said == pytest.approx(scatter, rel=0.25)


def test_an_unsure_tape_adds_to_the_error() -> None:
    sure = scale_from_length(marks([0, 2]), LENGTH_M, T_TRUE, CAMERAS)
    unsure = scale_from_length(
        marks([0, 2]), LENGTH_M, T_TRUE, CAMERAS, length_sigma_m=0.05 * LENGTH_M
    )
    assert unsure.sigma == pytest.approx(math.hypot(sure.sigma, 0.05), rel=1e-6)


def test_marks_that_make_no_sense_are_named() -> None:
    good = marks([0, 2])
    cases = [
        ((good[0], good[0]), 1.0, "too close"),
        ((good[0], good[1][:1]), 1.0, "two pictures"),
        ((good[0], [good[1][0], Mark(0, good[1][0].pixel)]), 1.0, "two pictures"),
        (good, 0.0, "length_m"),
        (good, math.nan, "length_m"),
    ]
    for ends, length_m, what in cases:
        with pytest.raises(ValueError, match=what):
            scale_from_length(ends, length_m, T_TRUE, CAMERAS)
