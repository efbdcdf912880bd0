"""The story of a capture: every turn of its course gives one line, repetitions give none."""

from __future__ import annotations

import asyncio
from dataclasses import replace

from server.mission.chronicle import Chronicle, follow
from server.mission.events import CaptureChanged, Event, EventStream, MetricsMeasured, Noted
from server.stages import Metrics

START = CaptureChanged(
    id="night-fox",
    state="running",
    phase="preflight",
    progress=0.0,
    eta_s=None,
    run="runs/night-fox",
    error=None,
    mode="optimized",
    round_index=0,
    rounds=2,
    images=0,
    images_total=8,
)


def told(*course: Event) -> list[tuple[str, str]]:
    chronicle = Chronicle()
    return [(line.level, line.text) for event in course for line in chronicle.lines(event)]


def test_a_capture_that_goes_well_is_told_from_its_start_to_its_end() -> None:
    story = told(
        START,
        START,
        replace(START, phase="take_off"),
        replace(START, phase="centre"),
        replace(START, phase="capture"),
        replace(START, phase="fly", round_index=1, images=4),
        replace(START, phase="capture", round_index=1, images=4),
        replace(START, phase="land", round_index=1, images=8),
        replace(START, phase="train", round_index=1, images=8),
        MetricsMeasured(Metrics(24, 3, 23.456, 0.8, 0.1, None)),
        replace(START, phase="done", state="succeeded", round_index=1, images=8),
    )
    assert [text for _, text in story] == [
        "Capture night-fox: 8 pictures wanted.",
        "Taking off.",
        "In the air: turning to the object.",
        "Round 1 of 2: 4 of 8 pictures.",
        "Round 2 of 2: 8 of 8 pictures.",
        "Landing.",
        "On the ground with 8 pictures.",
        "Held-out pictures: 23.46 dB, SSIM 0.800.",
        "Capture complete.",
    ]
    assert {level for level, _ in story} == {"info"}


def test_a_pause_and_an_early_end_are_told() -> None:
    flying = replace(START, phase="fly")
    story = told(
        START,
        flying,
        replace(flying, state="paused"),
        flying,
        replace(flying, state="aborted", phase="ended", error="aborted by the operator"),
    )
    assert story[1:] == [
        ("info", "Paused."),
        ("info", "The capture goes on."),
        ("warning", "Capture ended early: aborted by the operator."),
    ]


def test_what_becomes_of_an_earlier_capture_is_not_told_as_this_ones() -> None:
    earlier = replace(START, id="old-owl", state="interrupted", phase="fly")
    assert told(earlier, START, earlier) == told(START)


def test_figures_that_an_adopted_training_tells_again_are_not_told_again() -> None:
    assert told(MetricsMeasured(Metrics(24, 3, 23.456, 0.8, 0.1, None))) == []


async def test_the_lines_go_back_into_the_stream() -> None:
    events = EventStream()
    with events.subscribe() as subscription:
        task = asyncio.create_task(follow(events))
        await asyncio.sleep(0)
        events.publish(START)
        assert await anext(subscription) is START
        line = await anext(subscription)
        task.cancel()
    assert isinstance(line, Noted)
    assert line.text.startswith("Capture night-fox")
