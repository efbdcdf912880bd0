"""A console on a real server, with a fake mission behind it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
from fake_jobs import FakeRunner
from fake_mission import FakeMission, FakeStops

from server.api.access import KeyRing
from server.api.config import ApiConfig, WebhookConfig
from server.api.door import Door
from server.api.serving import uvicorn_config
from server.api.web import make_web
from server.jobs.book import JobBook
from server.jobs.unsignalled import UnsignalledServer
from server.mission.busy_captures import BusyCaptures

TOKEN = "correct-horse-battery-staple"


@dataclass
class Console:
    """A served console and what stands behind it."""

    address: str
    mission: FakeMission
    stops: FakeStops
    dist: Path
    ring: KeyRing
    book: JobBook

    @property
    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {TOKEN}"}

    @property
    def http(self) -> str:
        return f"http://{self.address}"

    @property
    def socket(self) -> str:
        return f"ws://{self.address}"

    def client(self, signed_in: bool = True) -> httpx.AsyncClient:
        return httpx.AsyncClient(
            base_url=self.http, headers=self.headers if signed_in else {}, trust_env=False
        )


@asynccontextmanager
async def serve(
    tmp_path: Path,
    scene_port: int | None = None,
    dist: Path | None = None,
    prefix: str = "",
    webhook: WebhookConfig | None = None,
    tls: tuple[Path, Path] | None = None,
) -> AsyncIterator[Console]:
    mission, stops, dist = FakeMission(tmp_path / "runs"), FakeStops(), dist or tmp_path / "dist"
    config = ApiConfig(command_wait_s=0.2, webhook=webhook or WebhookConfig())
    ring = KeyRing(TOKEN, tmp_path / "tokens.json")
    door = Door(ring, prefix=prefix)
    book = JobBook(FakeRunner())
    web = make_web(mission, stops, book, BusyCaptures(), door, scene_port, dist, "0.1.0", config)
    server = UnsignalledServer(uvicorn_config(web, "127.0.0.1", 0, tls))
    serving = asyncio.create_task(server.serve())
    while not server.started:
        if serving.done():
            serving.result()
        await asyncio.sleep(0.01)
    host, port = server.servers[0].sockets[0].getsockname()
    try:
        yield Console(f"{host}:{port}", mission, stops, dist, ring, book)
    finally:
        mission.released.set()
        server.should_exit = True
        await serving


def runner_of(console: Console) -> FakeRunner:
    """Return what the console's jobs were handed to."""
    runner = console.book._runner
    assert isinstance(runner, FakeRunner)
    return runner


async def until(condition: Callable[[], bool]) -> None:
    """Wait for ``condition``; the test's own time limit ends a wait that is in vain."""
    while not condition():  # noqa: ASYNC110 - what is waited for sets no event.
        await asyncio.sleep(0.01)
