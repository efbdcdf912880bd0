"""What the recording of a capture shows, over REST."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from fake_mission import capture_changed
from served_console import Console

from server.api import replays

REEL = {
    "seconds": 2.0,
    "drones": [{"drone_id": "drone-1", "film": "film-0.mp4", "begins_s": 0.5, "way": []}],
    "moments": [{"at_s": 1.0, "kind": "picture", "drone_id": "drone-1", "text": "1"}],
    "object_box": None,
}


async def test_a_replay_that_was_made_is_handed_out(console: Console) -> None:
    folder = console.mission.runs / "run-1/replay"
    folder.mkdir(parents=True)
    (folder / "replay.json").write_text(json.dumps(REEL))
    (folder / "film-0.mp4").write_bytes(b"film")
    console.mission.keep(capture_changed("run-1", "succeeded"))
    async with console.client() as client:
        told = (await client.get("/api/v1/captures/run-1/replay")).json()
        assert told["moments"] == REEL["moments"]
        film = await client.get(told["drones"][0]["film"])
        assert film.content == b"film"


async def test_a_replay_is_made_when_no_capture_is_under_way(console: Console) -> None:
    folder = console.mission.runs / "run-1"
    folder.mkdir(parents=True)
    console.mission.keep(capture_changed("run-1", "succeeded"))
    async with console.client() as client:
        missing = await client.get("/api/v1/captures/run-1/replay")
        assert (missing.status_code, missing.json()["code"]) == (404, "unknown")
        (folder / "recording.mcap").write_bytes(b"no recording")
        console.mission.keep(capture_changed("run-2", "running"))
        refused = await client.get("/api/v1/captures/run-1/replay")
        assert refused.status_code == 409
        assert "under way" in refused.json()["detail"]
        console.mission.keep(capture_changed("run-2", "aborted"))
        progress = await client.get("/api/v1/captures/run-1/replay/progress")
        assert progress.json() == {"share": None}
        assert (await client.get("/api/v1/captures/none/replay/progress")).status_code == 404
        broken = await client.get("/api/v1/captures/run-1/replay")
        assert broken.status_code == 409
        assert "no MCAP file" in broken.json()["detail"]
        assert str(folder) not in broken.json()["detail"]


async def test_who_waits_for_the_films_is_told_how_far_they_are(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = console.mission.runs / "run-1"
    folder.mkdir(parents=True)
    (folder / "recording.mcap").write_bytes(b"recording")
    console.mission.keep(capture_changed("run-1", "succeeded"))
    reached, go_on = threading.Event(), threading.Event()

    def cut(_: Path, run: Path, on_share: Callable[[float], None]) -> None:
        on_share(0.25)
        on_share(0.5)
        reached.set()
        assert go_on.wait(10.0)
        (run / "replay").mkdir()
        (run / "replay/replay.json").write_text(json.dumps(REEL))

    monkeypatch.setattr(replays, "make_reel", cut)
    async with console.client() as client:
        path = "/api/v1/captures/run-1/replay"
        waiting = asyncio.create_task(client.get(path))
        assert await asyncio.to_thread(reached.wait, 10.0)
        assert (await client.get(f"{path}/progress")).json() == {"share": 0.5}
        go_on.set()
        assert (await waiting).status_code == 200
        assert (await client.get(f"{path}/progress")).json() == {"share": None}
