"""The preflight checklist: what is found, what may be overridden, what may not."""

from __future__ import annotations

from pathlib import Path

from server.mission.checklist import Check, check_disk, overridden, problems

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
    check = check_disk(tmp_path / "not" / "there" / "yet")
    assert check.item == "disk"
    assert "GB free" in check.found
