"""The event stream over a real websocket."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from fake_mission import (
    DRONES,
    JPEG,
    capture_changed,
    drone_report,
    failsafe_fired,
    frame,
    picture_taken,
    plan_found,
    seed_fitted,
)
from served_console import Console, until
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from server.mission.events import Noted

pytestmark = pytest.mark.loopback


@asynccontextmanager
async def listening(console: Console) -> AsyncIterator[ClientConnection]:
    url = console.socket + "/api/v1/stream"
    async with asyncio.timeout(20):
        async with connect(url, additional_headers=console.headers, proxy=None) as socket:
            yield socket


async def text(socket: ClientConnection) -> dict[str, object]:
    """Return the next JSON message."""
    message = await socket.recv()
    assert isinstance(message, str)
    return json.loads(message)


async def texts_until(socket: ClientConnection, kind: str) -> list[dict[str, object]]:
    messages = []
    while not messages or messages[-1]["type"] != kind:
        messages.append(await text(socket))
    return messages


async def tile(socket: ClientConnection) -> tuple[dict[str, object], bytes]:
    """Return header and JPEG of the next message, which must be a picture."""
    message = await socket.recv()
    assert isinstance(message, bytes)
    length = int.from_bytes(message[:4], "big")
    return json.loads(message[4 : 4 + length]), message[4 + length :]


async def settled(socket: ClientConnection) -> list[dict[str, object]]:
    """Return what a newcomer is told; the drones' reports come last."""
    messages: list[dict[str, object]] = []
    while len([m for m in messages if m["type"] == "drone_reported"]) < len(DRONES):
        messages.append(await text(socket))
    return messages


async def test_a_newcomer_sees_the_present_state(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "succeeded"))
    running = capture_changed("run-2")
    console.mission.keep(running)
    console.mission.events.publish(running)
    pictures = [picture_taken(index) for index in range(3)]
    for picture in pictures:
        console.mission.events.publish(picture)
    console.mission.events.publish(Noted("info", "hello"))
    console.mission.kept = [seed_fitted(), plan_found(), pictures[-1]]
    await asyncio.sleep(0)
    async with listening(console) as socket:
        messages = await settled(socket)
    kinds = [message["type"] for message in messages]
    assert kinds.count("noted") == 1
    assert [m["id"] for m in messages if m["type"] == "capture_changed"] == ["run-1", "run-2"]
    assert sorted(m["index"] for m in messages if m["type"] == "capture_taken") == [0, 1, 2]  # type: ignore[type-var]
    assert {"seed_fitted", "plan_found"} <= set(kinds)
    assert [m["drone_id"] for m in messages if m["type"] == "drone_reported"] == list(DRONES)


async def test_events_follow_as_they_happen(console: Console) -> None:
    async with listening(console) as socket:
        await settled(socket)
        console.mission.events.publish(Noted("warning", "wind", "drone-2"))
        note = await text(socket)
        assert note["type"] == "noted"
        assert (note["level"], note["text"], note["drone_id"]) == ("warning", "wind", "drone-2")
        console.mission.events.publish(picture_taken(5))
        picture = await text(socket)
        assert str(picture["thumbnail"]).startswith("data:image/jpeg;base64,/9j/")


async def test_failsafes_that_fired_are_told_now_and_to_newcomers(console: Console) -> None:
    earlier = failsafe_fired("drone-1", "battery_pct", "land", 14.0, 15.0, "battery at 14 %")
    console.mission.kept = [earlier]
    async with listening(console) as socket:
        (told,) = [m for m in await settled(socket) if m["type"] == "failsafe_fired"]
        assert (told["drone_id"], told["action"], told["value"]) == ("drone-1", "land", 14.0)
        assert told["at"] == earlier.at.isoformat()
        console.mission.events.publish(failsafe_fired(value=float("nan"), text="no picture"))
        news = await text(socket)
    assert (news["event"], news["threshold"], news["text"]) == ("video_age_s", 4.0, "no picture")
    assert news["value"] is None  # Not a number is not JSON.


async def test_several_failsafes_of_one_moment_all_arrive(console: Console) -> None:
    async with listening(console) as socket:
        await settled(socket)
        for drone_id in DRONES:
            console.mission.events.publish(failsafe_fired(drone_id, "operator_silence_s"))
        told = [(await text(socket))["drone_id"] for _ in DRONES]
    assert told == list(DRONES)


async def test_heartbeats_reach_the_mission_and_watching_does_not(console: Console) -> None:
    async with listening(console) as viewer, listening(console) as operator:
        await settled(viewer)
        await viewer.send(json.dumps({"type": "show_tiles", "drone_ids": []}))
        for _ in range(3):
            await operator.send(json.dumps({"type": "heartbeat"}))
        await until(lambda: len(console.mission.operator) >= 3)
        # Closing takes no leave: the silence that follows is the failsafe's business.
        await operator.close()
        await viewer.send(json.dumps({"type": "release_command"}))
        await until(lambda: len(console.mission.operator) >= 4)
    assert console.mission.operator == ["here", "here", "here", "left"]


async def test_one_picture_is_on_its_way_until_it_was_shown(console: Console) -> None:
    async with listening(console) as socket:
        await settled(socket)
        publish = console.mission.events.publish
        publish(frame("drone-1", 0))
        header, jpeg = await tile(socket)
        assert (header["drone_id"], header["sequence"]) == ("drone-1", 0)
        assert jpeg == JPEG
        for sequence in range(1, 40):
            publish(frame("drone-1", sequence))
        # Nothing of drone 1 comes before the acknowledgement: the note overtakes it.
        publish(Noted("info", "marker"))
        assert (await text(socket))["text"] == "marker"
        await socket.send(json.dumps({"type": "tile_shown", "drone_id": "drone-1", "sequence": 0}))
        header, _ = await tile(socket)
        assert header["sequence"] == 39


async def test_only_shown_tiles_are_sent(console: Console) -> None:
    async with listening(console) as socket:
        await settled(socket)
        publish = console.mission.events.publish
        publish(frame("drone-3", 0))
        await tile(socket)
        publish(frame("drone-3", 1))
        await socket.send(json.dumps({"type": "show_tiles", "drone_ids": ["drone-3"]}))
        await socket.send(json.dumps({"type": "tile_shown", "drone_id": "drone-3", "sequence": 0}))
        await tile(socket)  # The acknowledgement was read, so what came before it was, too.
        await socket.send(json.dumps({"type": "tile_shown", "drone_id": "drone-3", "sequence": 1}))
        for drone_id in DRONES:
            publish(frame(drone_id, 2))
        header, _ = await tile(socket)
        assert (header["drone_id"], header["sequence"]) == ("drone-3", 2)
        publish(Noted("info", "end"))
        assert (await text(socket))["text"] == "end"


async def test_a_client_that_does_not_read_loses_the_oldest_and_is_told(console: Console) -> None:
    total = 3000
    async with listening(console) as socket:
        await settled(socket)
        padding = "x" * 4000
        for number in range(total):
            console.mission.events.publish(Noted("info", f"{number} {padding}"))
            if number % 100 == 99:
                await asyncio.sleep(0)
        console.mission.events.publish(drone_report("drone-1", 42))
        seen, missed = [], 0
        while True:
            message = await text(socket)
            if message["type"] == "missed":
                missed += int(str(message["events"]))
            elif message["type"] == "noted":
                seen.append(int(str(message["text"]).split()[0]))
            elif message.get("battery_pct") == 42:
                break
    assert missed > 0
    assert seen == sorted(seen)
    assert seen[-1] == total - 1
    assert len(seen) + missed == total


async def test_a_slow_client_does_not_slow_the_others(console: Console) -> None:
    async with listening(console) as slow, listening(console) as quick:
        await settled(slow)
        await settled(quick)
        for number in range(200):
            console.mission.events.publish(frame("drone-1", number))
            header, _ = await tile(quick)
            assert header["sequence"] == number
            await quick.send(
                json.dumps({"type": "tile_shown", "drone_id": "drone-1", "sequence": number})
            )
        header, _ = await tile(slow)
        assert header["sequence"] == 0


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("", 1008),
        ("{", 1008),
        ("[]", 1008),
        ("null", 1008),
        ('{"type": "fly"}', 1008),
        ('{"type": "tile_shown", "drone_id": "drone-1"}', 1008),
        ('{"type": "tile_shown", "drone_id": "drone-1", "sequence": 1, "more": 2}', 1008),
        ('{"type": "show_tiles", "drone_ids": "drone-1"}', 1008),
        ('{"type": "heartbeat", "drone_id": "drone-1"}', 1008),
        ('{"type": "release_command", "now": true}', 1008),
        ("[" * 5000, 1008),
        (b"\x00\x01", 1003),
    ],
)
async def test_malformed_messages_close_the_socket_and_nothing_else(
    console: Console, message: str | bytes, code: int, caplog: pytest.LogCaptureFixture
) -> None:
    async with listening(console) as socket:
        await socket.send(message)
        await socket.wait_closed()
        assert socket.close_code == code
    assert [r for r in caplog.records if r.levelno >= logging.WARNING] == []
    async with listening(console) as socket:
        await settled(socket)


async def test_clients_that_leave_are_forgotten(
    console: Console, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(3):
        async with listening(console) as socket:
            await settled(socket)
            console.mission.events.publish(frame("drone-1", 0))
    async with listening(console) as socket:
        socket.transport.abort()
    async with console.client() as client, asyncio.timeout(10):
        while "dronerf_stream_clients 0" not in (await client.get("/metrics")).text:
            console.mission.events.publish(Noted("info", "anyone there?"))
            await asyncio.sleep(0.01)
    assert [r for r in caplog.records if r.levelno >= logging.WARNING] == []


async def test_a_broken_event_ends_one_client_with_1011(
    console: Console, caplog: pytest.LogCaptureFixture
) -> None:
    async with listening(console) as socket:
        await settled(socket)
        console.mission.events.publish(capture_changed(state="dancing"))
        with pytest.raises(ConnectionClosed) as closed:
            await socket.recv()
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1011
    assert "the event stream of a client failed" in caplog.text
