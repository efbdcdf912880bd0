"""What waits for one client: slots, order, loss and pictures, without any socket."""

from __future__ import annotations

import json

import pytest
from fake_mission import (
    DRONES,
    JPEG,
    capture_changed,
    drone_report,
    frame,
    picture_taken,
    plan_found,
    seed_fitted,
    surface_seen,
)
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from server.api.messages import DroneReport, Missed, Note, ServerMessage, TileHeader
from server.api.outbox import Outbox
from server.mission.events import Noted


def drain(outbox: Outbox) -> list[object]:
    taken: list[object] = []
    while (message := outbox.take(0.0)) is not None:
        taken.append(message)
    return taken


def header(tile: object) -> TileHeader:
    assert isinstance(tile, bytes)
    length = int.from_bytes(tile[:4], "big")
    return TileHeader.model_validate_json(tile[4 : 4 + length])


def test_every_message_says_what_the_schema_says() -> None:
    outbox = Outbox(100)
    for event in (
        drone_report(),
        capture_changed(),
        picture_taken(),
        seed_fitted(),
        surface_seen(),
        plan_found(),
        Noted("warning", "low battery", "drone-1"),
    ):
        outbox.offer(event)
    adapter: TypeAdapter[object] = TypeAdapter(ServerMessage)
    types = []
    for message in drain(outbox):
        text = message.model_dump_json()  # type: ignore[attr-defined]
        assert "NaN" not in text
        types.append(json.loads(text)["type"])
        if types[-1] != "plan_found":  # Its NaN term travels as null.
            adapter.validate_json(text)
    assert types == [
        "drone_reported",
        "capture_changed",
        "capture_taken",
        "seed_fitted",
        "surface_seen",
        "plan_found",
        "noted",
    ]


def test_state_keeps_its_newest_value_and_the_rest_its_order() -> None:
    outbox = Outbox(100)
    outbox.offer(drone_report("drone-1", 80))
    outbox.offer(Noted("info", "first"))
    outbox.offer(drone_report("drone-2", 70))
    outbox.offer(drone_report("drone-1", 79))
    outbox.offer(Noted("info", "second"))
    taken = drain(outbox)
    assert [m.text for m in taken if isinstance(m, Note)] == ["first", "second"]
    reports = {m.drone_id: m.battery_pct for m in taken if isinstance(m, DroneReport)}
    assert reports == {"drone-1": 79, "drone-2": 70}
    assert len(taken) == 4


def test_a_slow_client_loses_the_oldest_and_is_told() -> None:
    outbox = Outbox(3)
    for number in range(10):
        outbox.offer(Noted("info", str(number)))
    missed, *rest = drain(outbox)
    assert missed == Missed(events=7)
    assert [m.text for m in rest if isinstance(m, Note)] == ["7", "8", "9"]
    assert drain(outbox) == []


def test_what_stands_at_the_beginning_is_never_cut() -> None:
    standing = [Noted("info", str(number)) for number in range(20)]
    outbox = Outbox(2, standing)
    outbox.offer(Noted("info", "new"))
    assert [m.text for m in drain(outbox) if isinstance(m, Note)] == [
        *(str(number) for number in range(20)),
        "new",
    ]


@given(st.lists(st.integers(0, 5), max_size=60), st.integers(1, 8))
def test_nothing_vanishes_uncounted(kinds: list[int], limit: int) -> None:
    """Notes sent plus notes told missing are all notes, when nothing else is offered."""
    outbox = Outbox(limit)
    notes = sent = 0
    for kind in kinds:
        if kind == 0:
            for message in drain(outbox):
                sent += message.events if isinstance(message, Missed) else 1
        else:
            outbox.offer(Noted("info", "text"))
            notes += 1
    for message in drain(outbox):
        sent += message.events if isinstance(message, Missed) else 1
    assert sent == notes


def test_one_picture_of_a_drone_is_on_its_way_and_the_newest_follows() -> None:
    outbox = Outbox(10)
    for sequence in range(5):
        outbox.offer(frame("drone-1", sequence))
    (tile,) = drain(outbox)
    assert header(tile).sequence == 4
    assert isinstance(tile, bytes)
    assert tile.endswith(JPEG)
    outbox.offer(frame("drone-1", 5))
    outbox.offer(frame("drone-1", 6))
    assert drain(outbox) == []
    outbox.shown("drone-1", 3)  # Not the one that is on its way.
    outbox.shown("drone-2", 4)
    assert drain(outbox) == []
    outbox.shown("drone-1", 4)
    (tile,) = drain(outbox)
    assert header(tile).sequence == 6


def test_one_slow_tile_does_not_stop_the_others() -> None:
    outbox = Outbox(10)
    for drone_id in DRONES:
        outbox.offer(frame(drone_id, 0))
    assert len(drain(outbox)) == 4
    for drone_id in DRONES:
        outbox.offer(frame(drone_id, 1))
    outbox.shown("drone-3", 0)
    assert [header(tile).drone_id for tile in drain(outbox)] == ["drone-3"]


def test_hidden_tiles_pause_and_start_afresh() -> None:
    outbox = Outbox(10)
    outbox.offer(frame("drone-1", 0))
    drain(outbox)
    outbox.offer(frame("drone-1", 1))
    outbox.offer(frame("drone-2", 1))
    outbox.show(["drone-2"])
    outbox.offer(frame("drone-1", 2))
    assert [header(tile).drone_id for tile in drain(outbox)] == ["drone-2"]
    outbox.show(["drone-1", "drone-2"])
    outbox.offer(frame("drone-1", 3))
    assert [header(tile).sequence for tile in drain(outbox)] == [3]


def test_messages_and_pictures_take_turns() -> None:
    outbox = Outbox(10)
    for number in range(4):
        outbox.offer(Noted("info", str(number)))
        outbox.offer(frame(DRONES[number], 0))
    kinds = ["tile" if isinstance(message, bytes) else "text" for message in drain(outbox)]
    assert kinds == ["tile", "text"] * 4


@pytest.mark.parametrize(("now_s", "age_s"), [(10.25, 0.25), (9.0, 0.0)])
def test_a_tile_tells_its_age_when_it_is_sent(now_s: float, age_s: float) -> None:
    outbox = Outbox(10)
    event = frame("drone-1", 0)
    object.__setattr__(event, "captured_s", 10.0)
    outbox.offer(event)
    assert header(outbox.take(now_s)).age_s == age_s
