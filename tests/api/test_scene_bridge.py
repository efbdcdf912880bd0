"""The 3D scene behind the door: its page, and its socket with the right subprotocol."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import AsyncIterator
from importlib.metadata import version
from pathlib import Path

import pytest
from served_console import Console, serve
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Subprotocol

from server.scene.scene import SceneView

pytestmark = pytest.mark.loopback

VISER = Subprotocol(f"viser-v{version('viser')}")


@pytest.fixture
async def console(tmp_path: Path) -> AsyncIterator[Console]:
    async with SceneView() as scene, serve(tmp_path, scene.port) as console:
        yield console


async def test_the_page_is_the_viewers(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        assert (await client.get("/scene/")).status_code == 401
    async with console.client() as client:
        page = await client.get("/scene/")
        assert page.status_code == 200
        assert page.headers["content-type"].startswith("text/html")
        assert "<title>" in page.text
        # Its script is inlined, so the dashboard's policy would keep the page blank.
        assert "'unsafe-inline'" in page.headers["content-security-policy"]
        assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
        bare = await client.get("/scene")
        assert bare.status_code == 307
        assert bare.headers["location"] == "/scene/"


async def test_the_socket_carries_the_scene(console: Console) -> None:
    async with asyncio.timeout(20):
        async with connect(
            console.socket + "/scene",
            additional_headers=console.headers,
            subprotocols=[VISER],
            compression=None,
            max_size=None,
            proxy=None,
        ) as viewer:
            assert viewer.subprotocol == VISER
            first = await viewer.recv()
            assert isinstance(first, bytes)
            assert len(first) > 20


async def test_a_viewer_of_another_version_is_told_so(console: Console) -> None:
    async with asyncio.timeout(20):
        async with connect(
            console.socket + "/scene",
            additional_headers=console.headers,
            subprotocols=[Subprotocol("viser-v0.0.1")],
            proxy=None,
        ) as viewer:
            await viewer.wait_closed()
            assert viewer.close_code == 1002


@pytest.mark.parametrize("origin", ["http://evil.example", "null"])
async def test_other_pages_cannot_reach_the_scene(console: Console, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        async with connect(
            console.socket + "/scene",
            additional_headers={**console.headers, "Origin": origin},
            subprotocols=[VISER],
            proxy=None,
        ):
            pass
    assert refused.value.response.status_code == 403


async def test_a_dead_scene_is_a_502_and_a_refused_socket(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))  # Bound and not listening: nobody answers there.
        async with serve(tmp_path, probe.getsockname()[1]) as console:
            async with console.client() as client:
                page = await client.get("/scene/")
                stop = await client.post("/api/v1/fleet/hold")
            with pytest.raises(InvalidStatus):
                async with connect(
                    console.socket + "/scene", additional_headers=console.headers, proxy=None
                ):
                    pass
    assert page.status_code == 502
    assert page.headers["content-type"] == "application/problem+json"
    assert stop.status_code == 202
    assert console.stops.calls == [("hold", None)]
    assert [r for r in caplog.records if r.levelno >= logging.ERROR] == []
