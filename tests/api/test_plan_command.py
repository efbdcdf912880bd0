"""``dronerf plan`` against a console."""

from __future__ import annotations

import argparse
import asyncio
import json

import pytest
from fake_mission import capture_changed, plan_found
from served_console import TOKEN, Console

from server.console_commands import run_plan

pytestmark = pytest.mark.loopback


async def ask(console: Console, *, as_json: bool) -> int:
    arguments = argparse.Namespace(size=None, object=None, url=console.http, json=as_json)
    return await asyncio.to_thread(run_plan, arguments)


async def test_the_newest_plan_is_shown(
    console: Console, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRONERF_TOKEN", TOKEN)
    assert await ask(console, as_json=True) == 1
    assert "no plan yet" in capsys.readouterr().err
    console.mission.events.publish(capture_changed("run-1"))
    console.mission.events.publish(plan_found())
    await asyncio.sleep(0)
    assert await ask(console, as_json=True) == 0
    assert json.loads(capsys.readouterr().out)["capture_id"] == "run-1"
    assert await ask(console, as_json=False) == 0
    assert "8 viewpoints" in capsys.readouterr().out


async def test_a_wrong_token_is_told(
    console: Console, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRONERF_TOKEN", "wrong-" + TOKEN)
    assert await ask(console, as_json=True) == 2
    assert "token" in capsys.readouterr().err
