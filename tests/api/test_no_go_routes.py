"""No-go volumes over a real server and a real client."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from served_console import Console
from test_rest import is_problem

from server.api.messages import NoGoReport
from server.api.outbox import Outbox
from server.geometry.boxes import Box3
from server.mission.events import NoGoChanged, NoGoVolume

pytestmark = pytest.mark.loopback

NO_GO = "/api/v1/plans/no-go"
AREA = [1.0, -1.0, 2.0, 1.0]


async def test_volumes_are_added_changed_listed_and_dropped(console: Console) -> None:
    async with console.client() as client:
        made = await client.post(NO_GO, json={"area": AREA})
        assert made.status_code == 201
        assert made.headers["location"] == f"{NO_GO}/no-go-1"
        assert made.json() == {"id": "no-go-1", "area": AREA, "configured": False}
        await client.post(NO_GO, json={"area": AREA})
        moved = await client.put(f"{NO_GO}/no-go-2", json={"area": [0, 0, 1, 1]})
        listed = (await client.get(NO_GO)).json()
        assert [each["id"] for each in listed] == ["no-go-1", "no-go-2"]
        assert listed[1] == moved.json()
        assert (await client.delete(f"{NO_GO}/no-go-1")).status_code == 204
        is_problem(await client.delete(f"{NO_GO}/no-go-1"), 404)
        is_problem(await client.put(f"{NO_GO}/no-go-1", json={"area": AREA}), 404)
        assert (await client.delete(NO_GO)).status_code == 204
        assert (await client.get(NO_GO)).json() == []


@pytest.mark.parametrize(
    ("wish", "status"),
    [
        ({}, 422),
        ({"area": AREA[:3]}, 422),
        ({"area": [*AREA, 1.0]}, 422),
        ({"area": ["1", 0, 1, 1]}, 422),
        ({"area": [1e9, 0, 1, 1]}, 422),
        ({"area": AREA, "height": 1.0}, 422),
        ({"area": [0, 0, 0, 1]}, 409),
    ],
)
async def test_what_is_no_volume_is_refused(
    console: Console, wish: dict[str, Any], status: int
) -> None:
    async with console.client() as client:
        is_problem(await client.post(NO_GO, json=wish), status)
        assert (await client.get(NO_GO)).json() == []


async def test_strangers_may_not_change_them(console: Console) -> None:
    async with console.client(signed_in=False) as stranger:
        is_problem(await stranger.post(NO_GO, json={"area": AREA}), 401)
        is_problem(await stranger.delete(NO_GO), 401)


def test_the_newest_state_becomes_one_message() -> None:
    volume = NoGoVolume("no-go-1", Box3(np.array([1.0, -1.0, 0.0]), np.array([2.0, 1.0, 1.5])))
    outbox = Outbox(limit=10)
    outbox.offer(NoGoChanged(()))
    outbox.offer(NoGoChanged((volume,)))
    report = outbox.take(0.0)
    assert isinstance(report, NoGoReport)
    assert outbox.take(0.0) is None
    assert report.volumes[0].area == AREA
