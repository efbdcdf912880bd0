"""The preflight checklist: what is found, what may be overridden, what may not."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from server.mission.checklist import Check, check_disk, overridden, problems
from server.mission.disk_watch import DiskWatch, free_mb

GOOD = Check("link", "drone-1", passed=True, found="answers")
LOW = Check("battery", "drone-2", passed=False, found="battery at 18 %", remedy="Charge it.")
EMPTY = Check("battery", "drone-3", passed=False, found="battery at 9 %", final=True)
FULL_DISK = Check("disk", None, passed=False, found="0.1 GB free")


def test_only_failed_checks_keep_a_capture_on_the_ground() -> None:
    assert problems([GOOD], {}) == []
    assert problems([GOOD, LOW, EMPTY], {}) == [LOW, EMPTY]


def test_an_override_names_an_item_or_one_drones_item() -> None:
    assert LOW.key == "drone-2.battery"
    assert FULL_DISK.key == "disk"
    assert problems([LOW], {"drone-2.battery": "short hop"}) == []
    assert problems([LOW], {"battery": "short hop"}) == []
    assert problems([LOW], {"drone-1.battery": "short hop"}) == [LOW]
    assert problems([FULL_DISK], {"disk": "four pictures only"}) == []


def test_a_final_item_is_never_overridden() -> None:
    assert problems([EMPTY], {"battery": "I insist"}) == [EMPTY]
    assert overridden([EMPTY], {"battery": "I insist"}) == {}


def test_the_reasons_that_counted_are_kept() -> None:
    reasons = {"battery": "short hop", "level": "not needed"}
    assert overridden([GOOD, LOW], reasons) == {"drone-2.battery": "short hop"}


def test_the_disk_is_judged_where_the_runs_will_be(tmp_path: Path) -> None:
    room_mb = free_mb(tmp_path / "not" / "there" / "yet")
    assert room_mb > 0.0
    assert check_disk(2000.0, 1.0).passed
    assert "2.0 GB free" in check_disk(2000.0, 1.0).found
    full = check_disk(100.0, 1.0)
    assert not full.passed
    assert not full.final


def test_a_disk_that_does_not_answer_is_told() -> None:
    check = check_disk(2000.0, 60.0)
    assert not check.passed
    assert "does not answer" in check.found


def test_a_disk_that_hangs_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = threading.Event()

    def hang(folder: Path) -> float:
        answers.wait(30.0)
        return 1.0

    async def story() -> None:
        watch = DiskWatch(tmp_path)
        await watch.measure()
        first_s = watch.measured_s
        monkeypatch.setattr("server.mission.disk_watch.free_mb", hang)
        hanging = asyncio.create_task(watch.measure())
        for _ in range(20):
            await asyncio.sleep(0)  # The loop turns.
        assert not hanging.done()
        assert watch.measured_s == first_s
        answers.set()
        await hanging
        assert watch.free_mb == 1.0

    asyncio.run(story())
