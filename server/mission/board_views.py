"""Views of a board from a live stream, one picture at a time: for the shell and for the browser.

Finding a board takes tens of milliseconds, so it is done in a thread; the pictures that come
meanwhile are left out.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TypeVar

from server.stages import Frame
from server.vision.calibration_board import BoardFinder
from server.vision.calibration_views import Picked, ViewPicker

_T = TypeVar("_T")
FrameSource = Callable[[], Awaitable[Frame | None]]


@dataclass(frozen=True, slots=True)
class GatherConfig:
    """When a collection of views ends and how fast it goes.

    Attributes:
        views: So many distinct views are collected.
        patience_s: After so long without a new view the collection ends, seconds.
        pause_s: Pause between two pictures, seconds.
    """

    views: int = 25
    patience_s: float = 90.0
    pause_s: float = 0.0


async def gather_views(
    next_frame: FrameSource,
    finder: BoardFinder,
    picker: ViewPicker,
    config: GatherConfig,
    progress: Callable[[Picked], None],
    stop: asyncio.Event,
    threads: Executor | None = None,
) -> None:
    """Let ``picker`` keep distinct views until there are enough or nothing new comes.

    Args:
        next_frame: Waits a while for the next whole picture, None when none came; what it raises
            ends the collection.
        finder: Finds the board.
        picker: Chooses views; it has them in the end.
        config: How many, and how patient.
        progress: Told about every picture that was looked at.
        stop: Ends the collection; what was collected counts.
        threads: Where pictures are looked at; without it in asyncio's own.
    """
    loop = asyncio.get_running_loop()

    def look(frame: Frame) -> Picked:
        return picker.consider(finder.find(frame.image_bgr))

    ends_s = loop.time() + config.patience_s
    while len(picker.views) < config.views and loop.time() < ends_s:
        frame = await _unless(stop, next_frame())
        if stop.is_set():
            return
        if frame is None:
            continue
        picked = await loop.run_in_executor(threads, look, frame)
        progress(picked)
        if picked.view is not None:
            ends_s = loop.time() + config.patience_s
        if config.pause_s > 0.0:
            await _unless(stop, asyncio.sleep(config.pause_s))


async def _unless(stop: asyncio.Event, waited: Awaitable[_T]) -> _T | None:
    """Wait for ``waited``, but no longer than until ``stop`` is set."""
    waiting = asyncio.ensure_future(waited)
    stopping = asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait({waiting, stopping}, return_when=asyncio.FIRST_COMPLETED)
        return waiting.result() if waiting.done() else None
    finally:
        # Also when this task is cancelled: nobody else ends them.
        for each in (waiting, stopping):
            each.cancel()
