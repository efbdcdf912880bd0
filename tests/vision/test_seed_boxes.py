"""Cells into boxes: every cell held, none overlapping, cuts where they save most."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from server.vision.seed_boxes import best_cut, boxes_around


def covered(blocks, shape):
    count = np.zeros(shape, int)
    for block in blocks:
        block.of(count)[...] += 1
    return count


@given(number=st.integers(0, 100_000), share=st.floats(0.01, 0.6), most=st.integers(1, 10))
@settings(max_examples=60, deadline=None)
def test_the_boxes_hold_every_cell_once(number, share, most):
    cells = np.random.default_rng(number).random((7, 8, 9)) < share
    blocks = boxes_around(cells, most, 0.01)
    count = covered(blocks, cells.shape)
    assert (count[cells] == 1).all()
    assert count.max(initial=0) <= 1
    assert len(blocks) <= most
    assert bool(blocks) == bool(cells.any())


@given(number=st.integers(0, 100_000))
@settings(max_examples=40, deadline=None)
def test_more_boxes_never_take_more_volume(number):
    cells = np.random.default_rng(number).random((6, 6, 6)) < 0.15
    volumes = [sum(b.volume for b in boxes_around(cells, n, 0.001)) for n in range(1, 8)]
    assert all(b <= a for a, b in pairwise(volumes))


@given(number=st.integers(0, 100_000))
@settings(max_examples=40, deadline=None)
def test_the_best_cut_is_that_of_trying_all(number):
    rng = np.random.default_rng(number)
    cells = rng.random((5, 6, 4)) < 0.2
    whole = boxes_around(cells, 1, 0.01)
    if not whole:
        return
    block = whole[0].of(cells)

    def volume(part):
        filled = np.argwhere(part)
        return int(np.prod(np.ptp(filled, axis=0) + 1)) if len(filled) else 0

    saved = [
        block.size - sum(volume(part) for part in np.split(block, [place], axis=axis))
        for axis in range(3)
        for place in range(1, block.shape[axis])
    ]
    assert best_cut(block).saved == max([0, *saved])


def test_an_l_of_two_bars_becomes_two_boxes():
    cells = np.zeros((10, 10, 10), bool)
    cells[:, 2:4, 0:2] = True
    cells[0:2, 2:4, :] = True
    blocks = boxes_around(cells, 6, 0.01)
    assert len(blocks) == 2
    assert sum(block.volume for block in blocks) == cells.sum()
