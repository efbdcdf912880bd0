"""The webhook, delivered to a real server."""

from __future__ import annotations

import base64
import hashlib
import hmac
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
from fake_mission import capture_changed
from listener import Listener, listening
from served_console import Console, serve, until

from server.api.config import WebhookConfig

pytestmark = pytest.mark.loopback
SECRET = "between-us"


@asynccontextmanager
async def told(tmp_path: Path, *answers: int) -> AsyncIterator[tuple[Console, Listener]]:
    async with listening(*answers) as listener:
        webhook = WebhookConfig(url=listener.url, secret=SECRET, pause_s=0.01)
        async with serve(tmp_path, webhook=webhook) as console:
            yield console, listener


async def test_the_end_of_a_capture_is_told_and_signed(tmp_path: Path) -> None:
    async with told(tmp_path) as (console, listener):
        for state in ("running", "succeeded", "succeeded"):
            status = capture_changed("run-1", state)
            console.mission.keep(status)
            console.mission.events.publish(status)
        await until(lambda: len(listener.requests) == 1)
    ((headers, body),) = listener.requests
    message = json.loads(body)
    assert message["type"] == "capture.succeeded"
    assert (message["data"]["id"], message["data"]["state"]) == ("run-1", "succeeded")
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    mac = base64.b64encode(hmac.digest(SECRET.encode(), signed, hashlib.sha256)).decode()
    assert headers["webhook-signature"] == f"v1,{mac}"
    assert headers["content-type"] == "application/json"


async def test_what_is_not_taken_is_told_again_under_the_same_id(tmp_path: Path) -> None:
    async with told(tmp_path, 500, 503, 204) as (console, listener):
        status = capture_changed("run-1", "failed")
        console.mission.keep(status)
        console.mission.events.publish(status)
        await until(lambda: len(listener.requests) == 3)
    assert len({headers["webhook-id"] for headers, _ in listener.requests}) == 1
    assert json.loads(listener.requests[-1][1])["type"] == "capture.failed"


async def test_the_end_of_a_job_is_told(tmp_path: Path) -> None:
    async with told(tmp_path) as (console, listener):
        folder = console.mission.runs / "run-1"
        folder.mkdir(parents=True)
        (folder / "transforms.json").write_text("{}")
        console.mission.keep(capture_changed("run-1", "succeeded"))
        async with console.client() as client:
            made = await client.post("/api/v1/reconstructions", json={"capture": "run-1"})
            await client.post(f"{made.headers['location']}/cancel")
        await until(lambda: len(listener.requests) == 1)
    message = json.loads(listener.requests[0][1])
    assert message["type"] == "job.cancelled"
    assert message["data"]["id"] == made.json()["id"]


@pytest.mark.parametrize("bad", [{"url": "ftp://x"}, {"attempts": 0}, {"timeout_s": 0.0}])
def test_bad_webhooks_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="must"):
        WebhookConfig(**bad)  # type: ignore[arg-type]
