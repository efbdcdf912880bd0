"""The loop whose clock jumps."""

from __future__ import annotations

import asyncio
import time

from server.sim.virtual_time import in_virtual_time


def test_an_hour_takes_a_moment_and_timers_fire_in_order() -> None:
    fired: list[int] = []

    async def wait() -> float:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        for seconds in (1800, 60, 3600, 1):
            loop.call_later(seconds, fired.append, seconds)
        await asyncio.sleep(3601.0)
        return loop.time() - begun_s

    begun_s = time.process_time()
    assert abs(in_virtual_time(wait()) - 3601.0) < 1e-6
    assert fired == [1, 60, 1800, 3600]
    assert time.process_time() - begun_s < 5.0


def test_time_stands_still_while_a_thread_works() -> None:
    async def work() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        other = asyncio.ensure_future(asyncio.sleep(1000.0))
        await asyncio.sleep(0)
        await asyncio.to_thread(time.sleep, 0.05)
        threaded_s = loop.time() - begun_s
        await other
        return threaded_s, loop.time() - begun_s

    threaded_s, in_all_s = in_virtual_time(work())
    assert threaded_s < 1e-6
    assert abs(in_all_s - 1000.0) < 1e-6
