"""The operator is told when the drones seem to stand in another order than assumed."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from server.mission import disagreement
from server.mission.disagreement import DisagreementWatch
from server.mission.events import EventStream, Noted
from server.vision.arrangement import Arrangement
from server.vision.config import AgreementConfig

DRONES = ("a", "b", "c", "d")
RIGHT, SWAPPED = Arrangement((0, 1, 2, 3), 0.5), Arrangement((0, 2, 1, 3), 0.9)


class Heard(EventStream):
    """An event stream that is remembered."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def publish(self, event: Any) -> None:
        if isinstance(event, Noted):
            self.texts.append(event.text)


def told(
    monkeypatch: pytest.MonkeyPatch, answers: list[list[Arrangement]], watching: list[bool]
) -> list[str]:
    """Return what is said when the outlines give ``answers``, one look each."""
    left = iter(answers)
    monkeypatch.setattr(disagreement, "arrangements", lambda *_: next(left))
    drones: Any = {d: SimpleNamespace(config=SimpleNamespace(label=d.upper())) for d in DRONES}
    pilot: Any = SimpleNamespace(target=lambda: SimpleNamespace(centre=np.zeros(3)))
    events = Heard()
    watch = DisagreementWatch(drones, {}, pilot, AgreementConfig(), events, lambda: 0.0)
    views: Any = [SimpleNamespace(pose=SimpleNamespace(drone_id=d)) for d in DRONES]

    async def look() -> None:
        for each in watching:
            await watch._ask_order(views, watching=each)

    asyncio.run(look())
    return events.texts


def test_changed_places_are_told_once_with_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    (text,) = told(monkeypatch, [[RIGHT, SWAPPED], [RIGHT, SWAPPED]], [True, True])
    assert "B at the place of C, C at the place of B" in text
    assert "D at" not in text


def test_it_is_asked_again_while_not_all_see_the_object_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert len(told(monkeypatch, [[], [], [RIGHT, SWAPPED]], [True, True, True])) == 1


def test_the_right_order_is_no_news_and_each_capture_asks_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right = [Arrangement((0, 1, 2, 3), 0.9), Arrangement((0, 2, 1, 3), 0.85)]
    answers = [right, [RIGHT, SWAPPED]]
    assert told(monkeypatch, answers, [True, True]) == []
    assert len(told(monkeypatch, answers, [True, False, True])) == 1
