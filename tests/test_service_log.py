"""One id from the request to the datagram, in lines that programs read."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import logging
import socket
import threading
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from server import service_log
from server.api.request_ids import RequestIds
from server.service_log import json_log
from server.swarm.config import DroneConfig
from server.swarm.link import UdpDroneLink
from server.swarm.ports import PortBoard

logger = logging.getLogger("server.test")


def lines(stream: io.StringIO) -> list[dict[str, Any]]:
    return [json.loads(line) for line in stream.getvalue().splitlines()]


def free_ports() -> list[int]:
    """Return three UDP ports that nobody has."""
    with contextlib.ExitStack() as stack:
        sockets = [
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(3)
        ]
        for sock in sockets:
            sock.bind(("", 0))
        return [sock.getsockname()[1] for sock in sockets]


@pytest.mark.loopback
async def test_a_stop_and_its_repeats_carry_the_id_of_their_request() -> None:
    """The datagram itself is sent by a real link; the repeat by a timer made in the request."""
    web = FastAPI()
    command, state, video = free_ports()
    config = DroneConfig(
        "north",
        address="127.0.9.7",
        command_port=command,
        state_port=state,
        video_port=video,
    )
    link = UdpDroneLink(config, PortBoard())
    repeated = asyncio.Event()

    def repeat() -> None:
        link.send(b"stop")
        repeated.set()

    @web.post("/api/v1/fleet/hold")
    async def hold() -> None:
        link.send(b"rc 0 0 0 0")
        link.send(b"stop")
        asyncio.get_running_loop().call_later(0.01, repeat)

    web.add_middleware(RequestIds)
    await link.open(lambda *_: None, lambda *_: None, lambda *_: None)
    stream = io.StringIO()
    try:
        with json_log(logging.INFO, stream):
            transport = httpx.ASGITransport(web)
            async with httpx.AsyncClient(transport=transport, base_url="http://console") as client:
                answer = await client.post(
                    "/api/v1/fleet/hold?token=secret", headers={"X-Request-ID": "from-the-proxy.7"}
                )
                other = await client.post("/nowhere", headers={"X-Request-ID": 'bad" id\t'})
            await repeated.wait()
    finally:
        link.close()
    assert answer.headers["X-Request-ID"] == "from-the-proxy.7"
    told = lines(stream)
    sent = [line for line in told if line["logger"] == "server.swarm.link"]
    assert [line["message"] for line in sent] == ["sent b'stop'", "sent b'stop'"]
    assert {line["request_id"] for line in sent} == {"from-the-proxy.7"}
    assert {line["drone_id"] for line in sent} == {"north"}
    first, second = (line for line in told if line["logger"] == "server.api.request_ids")
    assert first["message"] == "POST /api/v1/fleet/hold: 200"
    assert first["request_id"] == "from-the-proxy.7"
    assert "secret" not in stream.getvalue()
    assert second["request_id"] == other.headers["X-Request-ID"]
    assert len(second["request_id"]) == 16


def test_a_failure_is_one_line_with_its_traceback() -> None:
    stream = io.StringIO()
    with json_log(logging.INFO, stream):
        try:
            raise ValueError("two\nlines")
        except ValueError:
            logger.exception("it failed: %s", "so", extra={"drone_id": "drone-2"})
    (line,) = lines(stream)
    assert (line["level"], line["message"]) == ("error", "it failed: so")
    assert line["drone_id"] == "drone-2"
    assert line["traceback"].endswith("ValueError: two\nlines")
    assert "request_id" not in line


def test_nobody_waits_for_a_reader_that_does_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_log, "_QUEUE", 3)
    reads = threading.Event()

    class Stuck(io.StringIO):
        def write(self, text: str) -> int:
            reads.wait()
            return super().write(text)

    stream = Stuck()
    with json_log(logging.INFO, stream):
        for number in range(50):
            logger.info("line %d", number)
        reads.set()
        while True:
            logger.info("after")
            if any("dropped" in text for text in stream.getvalue().splitlines()):
                break
    told = lines(stream)
    assert sum(line["message"].startswith("line") for line in told) <= 5
    assert next(line["dropped"] for line in told if "dropped" in line) >= 45


def test_afterwards_the_log_is_as_it_was() -> None:
    root = logging.getLogger()
    before = (root.handlers[:], root.level)
    with json_log(logging.DEBUG, io.StringIO()):
        pass
    assert (root.handlers, root.level) == before
