"""Less video where much of it is lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from virtual_air import AirLink, flying_drone, in_virtual_time, now_s

from server.stages import Frame
from server.swarm.video_rate import VideoRate

LOW, FULL = "setbitrate 1", "setbitrate 0"


def orders(
    damaged: Callable[[int], bool], seconds: float, *, flies: bool, fps: int = 10
) -> list[str]:
    rate, given_orders = VideoRate(), []
    for n in range(round(seconds * fps)):
        rate.observe(n / fps, damaged(n))
        if (order := rate.order(n / fps, flies=flies)) is not None:
            given_orders.append(order)
    return given_orders


def test_whole_pictures_ask_for_nothing() -> None:
    assert orders(lambda n: False, 100.0, flies=True) == []
    assert orders(lambda n: n % 5 == 0, 100.0, flies=False) == [], "few are damaged"


def test_many_damaged_pictures_ask_for_less_until_it_helps() -> None:
    asked = orders(lambda n: n < 120, 60.0, flies=True)
    assert asked[0] == LOW
    assert set(asked) == {LOW}
    assert 2 <= len(asked) <= 4, "orders get lost, so they are repeated, but not at once"


def test_the_full_rate_comes_back_on_the_ground_alone() -> None:
    assert orders(lambda n: n < 50, 200.0, flies=True)[-1] == LOW
    on_ground = orders(lambda n: n < 50, 200.0, flies=False)
    assert on_ground[-1] == FULL
    assert on_ground.count(FULL) == 1


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.booleans(), st.booleans()), max_size=200))
def test_orders_are_rare_and_never_raise_the_rate_in_the_air(
    steps: list[tuple[float, bool, bool]],
) -> None:
    rate, now, last = VideoRate(), 0.0, -10.0
    for step_s, damaged, flies in steps:
        now += step_s
        rate.observe(now, damaged)
        order = rate.order(now, flies=flies)
        if order is not None:
            assert now - last > 4.9
            last = now
            assert order == LOW or not flies
        assert rate.low == (order == LOW) or order is None


class _Broken:
    """A decoder whose pictures are damaged, ten a second."""

    overflows = 0

    def __init__(self, drone_id: str, on_frame: Callable[[Frame], None]) -> None:
        self._drone_id, self._on_frame = drone_id, on_frame
        self._task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> object:
        self._task = asyncio.create_task(self._run())
        return self

    async def __aexit__(self, *exc: object) -> None:
        assert self._task is not None
        self._task.cancel()

    def feed(self, datagram: bytes, arrived_s: float) -> None: ...

    async def _run(self) -> None:
        n = 0
        while True:
            self._on_frame(Frame(self._drone_id, n, now_s(), np.zeros((6, 8, 3), np.uint8), True))
            n += 1
            await asyncio.sleep(0.1)


@pytest.mark.parametrize(("sdk", "asks"), [("3.0", True), ("2.0", False)])
def test_only_a_drone_that_knows_the_command_is_asked(sdk: str, asks: bool) -> None:
    async def story() -> None:
        link = AirLink(sdk=sdk)
        async with flying_drone(link, up=False, decoder=_Broken):
            await asyncio.sleep(15.0)
            assert (LOW.encode() in link.since(0.0)) == asks
            assert link.sdk.settings.bitrate_kbit_s == (1000 if asks else None)

    in_virtual_time(story())
