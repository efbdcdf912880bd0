"""The catalogue beside a running console."""

from __future__ import annotations

import asyncio
import dataclasses
import json
from pathlib import Path

import pytest

from server.mission import librarian
from server.mission.events import CaptureChanged, EventStream
from server.mission.librarian import Librarian, at_work
from server.store.catalogue import Catalogue
from server.store.config import RetentionConfig
from server.store.runs import RunFolder


def capture(runs: Path, name: str, state: str) -> CaptureChanged:
    run = RunFolder.create(runs, name)
    status = CaptureChanged(
        run.id, state, "done", 1.0, 0.0, str(run.path), None, "standard", 1, 1, 4, 4
    )
    run.write_state(
        {
            "request": {"mode": "standard", "name": name},
            "started_at": status.at.isoformat(),
            "status": dataclasses.asdict(status) | {"at": status.at.isoformat()},
        }
    )
    return status


class Rig:
    """A librarian, and what it told."""

    def __init__(
        self, runs: Path, url: str | None = None, retention: RetentionConfig | None = None
    ) -> None:
        self.events = EventStream()
        self.gone: asyncio.Queue[str] = asyncio.Queue()
        self.live: frozenset[str] = frozenset()
        self.librarian = Librarian(
            runs,
            url,
            retention or RetentionConfig(),
            self.events,
            lambda: self.live,
            self.gone.put_nowait,
        )


def listed(runs: Path) -> dict[str, str]:
    with Catalogue(runs) as catalogue:
        return {row.id: row.state for row in catalogue.page().rows}


async def until_listed(runs: Path, run_id: str, state: str) -> None:
    async with asyncio.timeout(60.0):
        while (await asyncio.to_thread(listed, runs)).get(run_id) != state:  # noqa: ASYNC110
            await asyncio.sleep(0.05)


async def test_what_ends_is_entered(tmp_path: Path) -> None:
    before = capture(tmp_path, "before", "succeeded")
    rig = Rig(tmp_path)
    async with at_work(rig.librarian):
        await until_listed(tmp_path, before.id, "succeeded")
        new = capture(tmp_path, "new", "running")
        rig.events.publish(new)
        path = tmp_path / new.id / "capture.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {}).replace("running", "failed"))
        rig.events.publish(dataclasses.replace(new, state="failed"))
        await until_listed(tmp_path, new.id, "failed")


async def test_the_oldest_go_when_the_quota_is_reached_but_none_in_work(tmp_path: Path) -> None:
    old = capture(tmp_path, "a", "succeeded")
    busy = capture(tmp_path, "b", "succeeded")
    rig = Rig(tmp_path, retention=RetentionConfig(quota_bytes=0))
    rig.live = frozenset({busy.id})
    async with at_work(rig.librarian):
        assert await asyncio.wait_for(rig.gone.get(), 60.0) == old.id
    assert not (tmp_path / old.id).exists()
    assert (tmp_path / busy.id).exists()


async def test_a_database_that_is_away_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(librarian, "_AGAIN_S", 0.01)
    status = capture(tmp_path, "a", "succeeded")
    away = tmp_path / "away"
    rig = Rig(tmp_path, f"sqlite:///{away}/catalogue.sqlite")
    async with at_work(rig.librarian):
        async with asyncio.timeout(60.0):
            while "not up to date" not in caplog.text:  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        away.mkdir()
        async with asyncio.timeout(60.0):
            while not await asyncio.to_thread(_has, tmp_path, rig, status.id):  # noqa: ASYNC110
                await asyncio.sleep(0.05)


def _has(runs: Path, rig: Rig, run_id: str) -> bool:
    with Catalogue(runs, f"sqlite:///{runs}/away/catalogue.sqlite") as catalogue:
        return catalogue.get(run_id) is not None
