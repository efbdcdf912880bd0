"""Picks and priorities over a real server and a real client."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fake_mission import frame
from served_console import Console
from test_rest import is_problem

from server.api.messages import DisagreementReport, PickReport, PrioritiesReport
from server.api.outbox import Outbox
from server.api.translate import message_from_event
from server.geometry.boxes import Box3
from server.mission.events import (
    ObjectPointedOut,
    PrioritiesChanged,
    PriorityPart,
    ViewsDisagree,
)

pytestmark = pytest.mark.loopback

OBJECT = "/api/v1/drones/drone-1/object"
PRIORITIES = "/api/v1/plans/priorities"
BOX = [0.25, 0.25, 0.75, 0.5]


async def test_a_drawn_box_and_a_click_reach_the_mission(console: Console) -> None:
    console.mission.frames["drone-1"] = frame()
    async with console.client() as client:
        drawn = await client.put(OBJECT, json={"box": BOX})
        clicked = await client.put(OBJECT, json={"point": [0.5, 0.25]})
    assert drawn.json() == {"drone_id": "drone-1", "box": BOX}
    assert clicked.json()["box"] == pytest.approx([0.5, 0.25, 0.6, 0.35])
    assert console.mission.calls == [
        ("point_out", ("drone-1", tuple(BOX))),
        ("point_out", ("drone-1", (0.5, 0.25))),
    ]


async def test_a_box_may_be_drawn_from_any_corner(console: Console) -> None:
    console.mission.frames["drone-1"] = frame()
    left, top, right, bottom = BOX
    async with console.client() as client:
        drawn = await client.put(OBJECT, json={"box": [right, bottom, left, top]})
        part = {"drone_id": "drone-1", "box": [right, top, left, bottom]}
        marked = await client.post(PRIORITIES, json=part)
    assert drawn.json()["box"] == BOX
    assert marked.json()["drawn"] == BOX


async def test_a_pick_is_taken_back(console: Console) -> None:
    async with console.client() as client:
        assert (await client.delete(OBJECT)).status_code == 204
        is_problem(await client.delete("/api/v1/drones/nobody/object"), 404)
    assert console.mission.calls == [("search", "drone-1")]


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"box": BOX, "point": [0.5, 0.5]},
        {"box": [0.1, 0.2, 0.4]},
        {"box": [0.1, 0.2, 0.4, 1.01]},
        {"point": [-0.1, 0.5]},
        {"point": ["left", 0.5]},
        {"point": [False, 0.5]},
        {"box": BOX, "and": "more"},
    ],
)
async def test_what_is_no_place_in_a_picture_is_refused(
    console: Console, body: dict[str, Any]
) -> None:
    console.mission.frames["drone-1"] = frame()
    async with console.client() as client:
        document = is_problem(await client.put(OBJECT, json=body), 422)
    assert document["errors"]
    assert console.mission.calls == []


async def test_a_pick_needs_a_picture_a_drone_and_a_token(console: Console) -> None:
    async with console.client() as client:
        document = is_problem(await client.put(OBJECT, json={"box": BOX}), 409)
        assert "picture" in str(document["detail"])
        is_problem(await client.put("/api/v1/drones/nobody/object", json={"box": BOX}), 404)
    async with console.client(signed_in=False) as stranger:
        is_problem(await stranger.put(OBJECT, json={"box": BOX}), 401)
        is_problem(await stranger.delete(OBJECT), 401)
        is_problem(await stranger.get(PRIORITIES), 401)
        is_problem(
            await stranger.post(PRIORITIES, json={"drone_id": "drone-1", "box": BOX}),
            401,
        )
    assert console.mission.calls == []


async def test_priorities_are_added_listed_and_dropped(console: Console) -> None:
    console.mission.frames["drone-2"] = frame("drone-2")
    wish = {"drone_id": "drone-2", "box": BOX, "weight": 3.0}
    async with console.client() as client:
        made = await client.post(PRIORITIES, json=wish)
        assert made.status_code == 201
        assert made.headers["location"] == f"{PRIORITIES}/part-1"
        await client.post(PRIORITIES, json=wish | {"weight": 2.0})
        listed = (await client.get(PRIORITIES)).json()
        assert [part["weight"] for part in listed] == [3.0, 2.0]
        assert listed[0] == made.json()
        assert listed[0]["centre"] is None
        assert (await client.delete(f"{PRIORITIES}/part-1")).status_code == 204
        is_problem(await client.delete(f"{PRIORITIES}/part-1"), 404)
        assert [p["id"] for p in (await client.get(PRIORITIES)).json()] == ["part-2"]
        assert (await client.delete(PRIORITIES)).status_code == 204
        assert (await client.get(PRIORITIES)).json() == []


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"weight": 0}, 422),
        ({"weight": 21}, 422),
        ({"box": [0.5, 0.5, 0.5, 0.6]}, 409),
        ({"drone_id": "nobody"}, 404),
        ({"drone_id": "drone-3"}, 409),
    ],
)
async def test_priorities_that_cannot_be(
    console: Console, change: dict[str, Any], status: int
) -> None:
    console.mission.frames["drone-2"] = frame("drone-2")
    async with console.client() as client:
        wish = {"drone_id": "drone-2", "box": BOX} | change
        is_problem(await client.post(PRIORITIES, json=wish), status)
        assert (await client.get(PRIORITIES)).json() == []


def test_events_become_messages() -> None:
    picked = message_from_event(ObjectPointedOut("drone-1", (0.1, 0.2, 0.3, 0.4)))
    assert isinstance(picked, PickReport)
    assert picked.box == [0.1, 0.2, 0.3, 0.4]
    dropped = message_from_event(ObjectPointedOut("drone-1", None))
    assert isinstance(dropped, PickReport)
    assert dropped.box is None
    apart = message_from_event(ViewsDisagree(("drone-2",), "It looks elsewhere."))
    assert isinstance(apart, DisagreementReport)
    assert (apart.drone_ids, apart.reason) == (["drone-2"], "It looks elsewhere.")
    box = Box3(np.array([-0.1, -0.2, 0.0]), np.array([0.1, 0.2, 1.0]))
    part = PriorityPart("part-1", "drone-1", (0.1, 0.2, 0.3, 0.4), 2.0, box)
    report = message_from_event(PrioritiesChanged((part,)))
    assert isinstance(report, PrioritiesReport)
    assert report.parts[0].centre == pytest.approx([0.0, 0.0, 0.5])
    assert report.parts[0].size == pytest.approx([0.2, 0.4, 1.0])


def test_only_the_newest_of_each_waits_for_a_slow_client() -> None:
    outbox = Outbox(limit=10)
    for share in (0.1, 0.2):
        outbox.offer(ObjectPointedOut("drone-1", (share, 0.0, 0.5, 0.5)))
        outbox.offer(ObjectPointedOut("drone-2", (share, 0.0, 0.5, 0.5)))
        outbox.offer(ViewsDisagree(("drone-1",), f"{share}"))
        outbox.offer(PrioritiesChanged(()))
    sent = []
    while (message := outbox.take(0.0)) is not None:
        sent.append(message)
    assert [type(message) for message in sent] == [
        PickReport,
        PickReport,
        DisagreementReport,
        PrioritiesReport,
    ]
    assert sent[0].box[0] == 0.2
