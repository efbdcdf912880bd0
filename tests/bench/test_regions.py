"""The judgement of the region search, on made-up boxes and on one small room."""

import numpy as np
import pytest

from server.bench.region_course import disturbed, shots
from server.bench.regions import _Tally, box_iou
from server.sim.scenes.catalogue import load_object
from server.sim.scenes.surroundings import FLOORS, WALLS, Surroundings, random_surroundings

BOX = np.array([100.0, 100.0, 200.0, 300.0])


def test_the_same_box_has_an_iou_of_one_and_a_half_box_of_a_half():
    assert box_iou(BOX, BOX) == pytest.approx(1.0)
    assert box_iou(BOX, BOX + np.array([0.0, 0.0, 0.0, -100.0])) == pytest.approx(0.5)
    assert box_iou(BOX, BOX + 500.0) == 0.0


def test_a_missed_object_counts_as_nothing_and_a_box_without_object_as_false():
    tally = _Tally()
    tally.count(BOX, BOX, 0.9)
    tally.count(BOX, None, 0.0)
    tally.count(BOX, BOX + 500.0, 0.3)
    tally.count(None, BOX, 0.4)
    tally.count(None, None, 0.0)
    assert tally.ious == [pytest.approx(1.0), 0.0, 0.0]
    assert tally.detected == 1
    assert (tally.empty, tally.false_positives) == (2, 1)
    assert tally.reports == [(0.9, True), (0.3, False), (0.4, False)]


def test_every_seed_is_another_room_and_always_the_same():
    rooms = [random_surroundings(seed) for seed in range(60)]
    assert rooms == [random_surroundings(seed) for seed in range(60)]
    assert {room.floor for room in rooms} == set(FLOORS)
    assert {room.wall for room in rooms} == set(WALLS)


@pytest.mark.parametrize(
    ("field", "value"),
    [("floor", "lava"), ("wall", "none"), ("light_rgb", (1.0, 0.0, 1.0)), ("shadow", 3.0)],
)
def test_impossible_surroundings_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Surroundings(**{field: value})


def test_disturbed_pictures_differ_but_not_much():
    image = np.full((720, 960, 3), 120, np.uint8)
    other = disturbed(image, np.random.default_rng(0))
    assert other.shape == image.shape
    assert 0.0 < np.abs(other.astype(float) - image).mean() < 60.0


@pytest.mark.slow
def test_a_shot_holds_the_true_box_and_an_expectation_near_it():
    taken = list(shots(load_object("recycle_bin"), seed=3, rooms=1, poses=8))
    seen = [(shot, shot.truth_px) for shot in taken if shot.truth_px is not None]
    assert len(seen) >= 4
    for shot, truth_px in seen:
        assert shot.image_bgr.shape == (720, 960, 3)
        assert (truth_px[2:] > truth_px[:2]).all()
        centre = (truth_px[:2] + truth_px[2:]) / 2.0
        # Four standard deviations and the share of the object that the frame may cut off.
        reach = 4.0 * shot.prior.sigma_px + 300.0
        assert np.abs(shot.prior.centre_px - centre).max() < reach
    assert any(shot.seed is not None for shot in taken)
    assert any(shot.seed is None for shot in taken)
