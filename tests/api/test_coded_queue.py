"""Coded pictures on their way to one client: chains without gaps; JPEG where there is none."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from fake_mission import JPEG, frame
from hypothesis import given
from hypothesis import strategies as st

from server.api.coded_queue import CodedQueue
from server.api.messages import CodedTileHeader, TileHeader
from server.api.outbox import Outbox
from server.api.translate import coded_tile_from_frame
from server.mission.events import FrameAnnotated, PictureMarks
from server.stages import Box, CodedPicture


def coded(number: int, *, key: bool = False, drone_id: str = "drone-1") -> FrameAnnotated:
    picture = CodedPicture(b"\0\0\1" + bytes([number % 256]), key, number)
    return replace(frame(drone_id, number), coded=(picture,))


def opened(message: object) -> tuple[TileHeader, bytes]:
    assert isinstance(message, bytes)
    end = 4 + int.from_bytes(message[:4], "big")
    known = CodedTileHeader if "coding" in json.loads(message[4:end]) else TileHeader
    return known.model_validate_json(message[4:end]), message[end:]


def taken(outbox: Outbox) -> list[tuple[TileHeader, bytes]]:
    sent = []
    while (message := outbox.take(0.0)) is not None:
        sent.append(opened(message))
    return sent


def test_a_chain_begins_at_a_key_picture_and_ends_at_a_gap() -> None:
    queue = CodedQueue()
    offered = [coded(1), coded(2, key=True), coded(3), coded(5), coded(6), coded(7, key=True)]
    assert [queue.offer(event) for event in offered] == [False, True, True, False, False, True]
    # The key picture needs none of those that wait.
    assert queue.take() is offered[-1]
    assert queue.take() is None


def test_a_picture_that_did_not_come_coded_ends_the_chain() -> None:
    queue = CodedQueue()
    assert queue.offer(coded(1, key=True))
    assert not queue.offer(frame("drone-1", 2))
    assert not queue.offer(coded(2))


def test_pictures_that_nobody_looked_at_come_along() -> None:
    def looked_at(*numbers: int, key: int | None = None) -> FrameAnnotated:
        pictures = tuple(CodedPicture(bytes([n]), n == key, n) for n in numbers)
        return replace(frame("drone-1", numbers[-1]), coded=pictures)

    queue = CodedQueue()
    assert not queue.offer(looked_at(1, 2))
    assert queue.offer(looked_at(4, 5, 6, key=4))
    assert queue.offer(looked_at(7, 8))
    assert not queue.offer(looked_at(9, 11))
    first, second = queue.take(), queue.take()
    assert first is not None
    assert second is not None
    assert [picture.number for picture in first.coded] == [4, 5, 6]
    header, data = opened(coded_tile_from_frame(second, 0.0))
    assert isinstance(header, CodedTileHeader)
    assert (header.key, header.sizes, header.sequence, data) == (False, [1, 1], 8, b"\7\x08")


def test_few_are_under_way_and_an_answer_counts_for_those_before_it() -> None:
    queue = CodedQueue()
    for number in range(12):
        assert queue.offer(coded(number, key=number == 0))
    first = [queue.take() for _ in range(7)]
    assert [event.sequence for event in first if event is not None] == [0, 1, 2, 3, 4, 5]
    queue.shown(99)
    assert queue.take() is None
    queue.shown(3)
    queue.shown(3)
    rest = [queue.take() for _ in range(5)]
    assert [event.sequence for event in rest if event is not None] == [6, 7, 8, 9]


STEP = st.one_of(
    st.sampled_from(["next", "gap", "key", "plain", "damaged", "damaged key", "take"]),
    # Answers come late, out of turn, twice, for what was never sent, or never.
    st.tuples(st.integers(0, 60), st.booleans()),
)


@given(st.lists(STEP, max_size=150))
def test_whatever_comes_every_picture_sent_can_be_decoded(
    steps: list[str | tuple[int, bool]],
) -> None:
    queue, number = CodedQueue(), 0
    sent: list[FrameAnnotated] = []
    under_way: list[int] = []

    def take() -> bool:
        if (out := queue.take()) is None:
            return False
        assert out.coded
        assert not out.damaged
        assert out.coded[0].key or out.coded[0].number == sent[-1].sequence + 1
        sent.append(out)
        under_way.append(out.sequence)
        return True

    for step in steps:
        if isinstance(step, tuple):
            sequence, decoded = step
            queue.shown(sequence, decoded=decoded)
            if sequence in under_way:
                del under_way[: under_way.index(sequence) + 1]
        elif step == "take":
            assert not take() or len(under_way) <= 6
        else:
            number += 2 if step == "gap" else 1
            event = coded(number, key="key" in step)
            if step == "plain":
                event = replace(event, coded=())
            queue.offer(replace(event, damaged="damaged" in step))
    # Whatever was, after answers and a key picture it goes on.
    for sequence in under_way:
        queue.shown(sequence)
    under_way.clear()
    assert queue.offer(coded(number + 1, key=True))
    assert take()
    assert sent[-1].sequence == number + 1


def test_no_more_than_half_a_second_waits() -> None:
    queue = CodedQueue()
    accepted = [queue.offer(coded(number, key=number == 0)) for number in range(30)]
    assert accepted == [True] * 15 + [False] * 15
    assert queue.take() is None
    assert queue.offer(coded(40, key=True))


def test_a_client_that_could_not_decode_gets_no_more_until_the_next_key_picture() -> None:
    queue = CodedQueue()
    for number in range(3):
        assert queue.offer(coded(number, key=number == 0))
    assert queue.take() is not None
    queue.shown(0, decoded=False)
    assert queue.take() is None
    assert not queue.offer(coded(3))
    assert queue.offer(coded(4, key=True))
    # It has heard of a key picture that waits already: that one is not thrown away.
    queue.shown(0, decoded=False)
    assert queue.take() is not None


def test_a_client_that_decodes_gets_jpeg_only_where_there_is_no_chain() -> None:
    outbox = Outbox(10)
    outbox.show(["drone-1"], coded=True)
    outbox.offer(coded(1))
    outbox.offer(coded(1, key=True, drone_id="drone-2"))
    ((header, data),) = taken(outbox)
    assert (type(header), header.sequence, data) == (TileHeader, 1, JPEG)
    outbox.offer(coded(2))
    assert taken(outbox) == []  # The JPEG has not been shown yet.
    outbox.offer(coded(3, key=True))
    outbox.offer(coded(4))
    headers = [header for header, _ in taken(outbox)]
    assert [(type(h), h.sequence) for h in headers] == [(CodedTileHeader, 3), (CodedTileHeader, 4)]
    outbox.shown("drone-1", 1)
    assert taken(outbox) == []  # Overtaken.


def test_who_is_content_with_jpeg_gets_nothing_else() -> None:
    outbox = Outbox(10)
    outbox.show(["drone-1"], coded=True)
    outbox.offer(coded(1, key=True))
    outbox.show(["drone-1"])
    outbox.offer(coded(2))
    assert [type(header) for header, _ in taken(outbox)] == [TileHeader]


def test_a_hidden_drone_begins_anew_and_the_others_go_on() -> None:
    outbox = Outbox(10)
    both = ["drone-1", "drone-2"]
    outbox.show(both, coded=True)
    for drone_id in both:
        outbox.offer(coded(1, key=True, drone_id=drone_id))
    assert len(taken(outbox)) == 2
    outbox.show(["drone-2"], coded=True)
    outbox.show(both, coded=True)
    for drone_id in both:
        outbox.offer(coded(2, drone_id=drone_id))
    kinds = {header.drone_id: type(header) for header, _ in taken(outbox)}
    assert kinds == {"drone-1": TileHeader, "drone-2": CodedTileHeader}


def test_the_header_tells_what_was_seen_and_stays_short() -> None:
    edge = np.arange(0, 960, 8)
    outline = np.stack([edge, edge % 720], axis=1)
    box = Box(np.array([10.25, 20.0, 300.04, 400.0]), 0.87654, touches_edge=False)
    marks = PictureMarks((960, 720), box, (outline,), -0.123456)
    event = replace(coded(7, key=True), marks=marks, note="odd")
    message = coded_tile_from_frame(event, event.captured_s + 0.25)
    header, data = opened(message)
    assert isinstance(header, CodedTileHeader)
    assert (header.sequence, header.age_s, header.key, header.note) == (7, 0.25, True, "odd")
    assert data == b"\0\0\1\7"
    assert header.marks is not None
    assert header.marks.box == [10.2, 20.0, 300.0, 400.0]
    assert header.marks.outlines == [outline.ravel().tolist()]
    assert len(message) < 2048
    with pytest.raises(ValueError, match="no coded form"):
        coded_tile_from_frame(frame(), 0.0)
