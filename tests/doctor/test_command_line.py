"""``dronerf doctor`` and ``dronerf calibrate`` as they are typed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "server", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("doctor", "--scan", "10.0.0.0/8"), "larger than a /22"),
        (("doctor", "--scan", "8.8.8.0/24"), "not a private network"),
        (("doctor", "--fleet", "missing.toml"), "missing.toml"),
        (("doctor", "--fleet", "a.toml", "--sim"), "not allowed with"),
        (("calibrate",), "--drone ID"),
        (("calibrate", "--pictures", ".", "--board", "chess"), "a board is written like"),
        (("calibrate", "--drone", "red", "--views", "3"), "--views must be at least 10"),
    ],
)
def test_wrong_usage_is_one_line_and_2(
    tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    answer = run(tmp_path, *arguments)
    assert answer.returncode == 2
    assert words in answer.stderr
    assert len(answer.stderr.splitlines()) == 1
    assert answer.stdout == ""


def test_the_machine_alone_as_json(tmp_path: Path) -> None:
    answer = run(tmp_path, "doctor", "--runs", str(tmp_path), "--json")
    report = json.loads(answer.stdout)
    assert answer.returncode == (0 if report["ok"] else 1)
    checks = [finding["check"] for finding in report["findings"]]
    assert {"Python", "packages", "OpenCV", "runs folder", "GPU", "clock"} <= set(checks)
    assert checks[-1] == "drones"
    assert not any(finding["drone_id"] for finding in report["findings"])
    assert list(tmp_path.iterdir()) == []


def test_a_runs_folder_that_cannot_be(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    answer = run(tmp_path, "doctor", "--runs", str(file))
    assert answer.returncode == 1
    assert "is not a folder" in " ".join(answer.stdout.split())
    assert "-> choose another with --runs" in answer.stdout
