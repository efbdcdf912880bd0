"""Pictures for a reader of every one, for one of the newest, and for one that is too slow."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from server.stages import CodedPicture, Frame
from server.swarm.errors import DroneError
from server.swarm.pictures import FrameDecoder, Pictures
from server.swarm.video import VideoDecoder


class HandFed:
    """A decoder whose frames the test hands over itself."""

    overflows = 0

    def __init__(self, on_frame: Callable[[Frame], None]) -> None:
        self.give = on_frame

    async def __aenter__(self) -> HandFed:
        return self

    async def __aexit__(self, *exc: object) -> None:
        pass

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        pass


def frame(number: int) -> Frame:
    return Frame("d", number, number / 30.0, np.zeros((2, 2, 3), np.uint8), False)


def opened() -> tuple[Pictures, Callable[[Frame], None]]:
    given: list[Callable[[Frame], None]] = []

    def make(drone_id: str, on_frame: Callable[[Frame], None]) -> FrameDecoder:
        given.append(on_frame)
        return HandFed(on_frame)

    return Pictures("d", lambda: 0.0, make), given[0]


def test_a_decoder_tells_what_it_was_too_late_for() -> None:
    decoder = VideoDecoder("d", lambda _: None)
    pictures = Pictures("d", lambda: 0.0, lambda *_: decoder)
    decoder.overflows = 3
    assert pictures.overflows == 3
    assert opened()[0].overflows == 0, "nothing waits there"


async def begin_reading(pictures: Pictures, give: Callable[[Frame], None]) -> None:
    """Make the test the reader; its first picture is number 0."""
    reading = asyncio.create_task(pictures.next_in_order())
    await asyncio.sleep(0)
    give(frame(0))
    assert (await reading).sequence == 0


async def test_a_reader_in_order_gets_each_picture_once() -> None:
    pictures, give = opened()
    await begin_reading(pictures, give)
    for number in (1, 2, 3):
        give(frame(number))
    assert [(await pictures.next_in_order()).sequence for _ in range(3)] == [1, 2, 3]
    assert pictures.skipped == 0
    reading = asyncio.create_task(pictures.next_in_order())
    await asyncio.sleep(0)
    assert not reading.done(), "nothing is returned twice"
    give(frame(4))
    assert (await reading).sequence == 4


async def test_who_is_too_slow_goes_on_with_the_newest_and_the_rest_is_counted() -> None:
    pictures, give = opened()
    await begin_reading(pictures, give)
    for number in range(1, 101):
        give(frame(number))
        assert len(pictures._waiting) <= 10
    taken = []
    while pictures._waiting:
        taken.append((await pictures.next_in_order()).sequence)
    assert taken == list(range(taken[0], 101)), "the newest, in order"
    assert len(taken) + pictures.skipped == 100


async def test_no_coded_picture_is_missing_from_what_a_slow_reader_gets() -> None:
    pictures, give = opened()
    await begin_reading(pictures, give)
    for number in range(1, 101):
        give(replace(frame(number), coded=(CodedPicture(b"", number % 30 == 1, number),)))
    numbers = []
    while pictures._waiting:
        numbers += [coded.number for coded in (await pictures.next_in_order()).coded]
    assert pictures.skipped > 0
    # Nobody came for so long that what came before is given up; then none is missing.
    assert numbers == list(range(numbers[0], 101))
    assert len(numbers) <= 60 + 12
    # What did not come coded cannot be decoded by anybody else, with or without those before it.
    for number in range(101, 131):
        give(
            frame(number)
            if number > 120
            else replace(frame(number), coded=(CodedPicture(b"", False, number),))
        )
    *_, last = [await pictures.next_in_order() for _ in range(len(pictures._waiting))]
    assert last.coded == ()


async def test_nothing_is_kept_for_a_reader_that_does_not_exist() -> None:
    pictures, give = opened()
    for number in range(10):
        give(frame(number))
    assert pictures.skipped == 0
    assert not pictures._waiting
    assert (await pictures.next(5)).sequence == 9


async def test_the_end_of_a_drone_ends_the_wait() -> None:
    pictures, _ = opened()
    reading = asyncio.create_task(pictures.next_in_order())
    await asyncio.sleep(0)
    await pictures.close()
    with pytest.raises(DroneError, match="closed"):
        await reading


async def test_coded_pictures_that_nobody_takes_do_not_pile_up() -> None:
    pictures, give = opened()
    await begin_reading(pictures, give)
    for number in range(1, 1001):
        give(replace(frame(number), coded=(CodedPicture(b"", False, number),)))
        assert sum(len(each.coded) for each in pictures._waiting) <= 60 + 12
