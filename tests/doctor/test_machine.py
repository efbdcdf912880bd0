"""Checks of the machine, each with values that are right and values that are wrong."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from server.doctor.config import DoctorConfig, LiveConfig
from server.doctor.finding import Finding, exit_code
from server.doctor.firewall import opening_advice
from server.doctor.machine import (
    check_clock,
    check_gpu,
    check_memory,
    check_opencv,
    check_packages,
    check_processors,
    check_python,
    check_runs,
    check_settings,
    check_web,
    check_x11,
)
from server.doctor.readings import run_briefly

CONFIG = DoctorConfig()


def test_a_failure_without_a_remedy_cannot_be_reported() -> None:
    with pytest.raises(ValueError, match="what to do about disk"):
        Finding("disk", "fail", "full")


def test_warnings_and_skips_are_no_failures() -> None:
    good = [Finding("a", "ok", ""), Finding("b", "warn", ""), Finding("c", "skip", "")]
    assert exit_code(good) == 0
    assert exit_code([*good, Finding("d", "fail", "", "mend it")]) == 1


@pytest.mark.parametrize(
    ("version", "status"), [((3, 10), "fail"), ((3, 11), "ok"), ((3, 13), "ok"), ((3, 14), "fail")]
)
def test_python(version: tuple[int, int], status: str) -> None:
    assert check_python(version).status == status


def test_packages() -> None:
    wanted = ["numpy", "viser>=1.1.1", 'pytest ; extra == "dev"']
    assert check_packages(wanted, lambda name: "1.0").status == "ok"
    missing = check_packages(wanted, lambda name: None if name == "viser" else "1.0")
    assert missing.status == "fail"
    assert "viser" in missing.detail
    assert "numpy" not in missing.detail
    assert check_packages(wanted, lambda name: None if name == "pytest" else "1").status == "ok"


def test_opencv_overwritten_by_another_package() -> None:
    headless = {"opencv-python-headless": "5.0.0.93"}
    assert check_opencv(headless, "5.0.0").status == "ok"
    both = check_opencv({**headless, "opencv-python": "4.10.0.84"}, "4.10.0")
    assert both.status == "fail"
    assert "pip uninstall opencv-python;" in both.remedy
    assert check_opencv(headless, "4.10.0").status == "fail"


def test_x11() -> None:
    def missing(name: str) -> object:
        raise OSError(f"{name}: cannot open shared object file")

    assert check_x11(lambda name: object()).status == "ok"
    assert check_x11(missing).status == "warn"


def test_dashboard(tmp_path: Path) -> None:
    assert check_web(tmp_path).remedy == "make web"
    (tmp_path / "index.html").write_text("<html>")
    assert check_web(tmp_path).status == "ok"


def test_a_runs_folder_that_can_be_written_is_left_as_it_was(tmp_path: Path) -> None:
    assert check_runs(tmp_path / "runs" / "new", CONFIG).status in ("ok", "warn")
    assert list(tmp_path.iterdir()) == []


def test_a_runs_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("")
    assert check_runs(tmp_path / "runs", CONFIG).status == "fail"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_runs_folder_without_the_right_to_write(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        assert check_runs(tmp_path, CONFIG).status == "fail"
    finally:
        tmp_path.chmod(0o700)


def test_a_read_only_file_system() -> None:
    # The kernel's own: nobody, not even root, makes a file there.
    found = check_runs(Path("/proc/sys"), CONFIG)
    assert found.status == "fail"
    assert "--runs" in found.remedy


def test_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    found = check_runs(tmp_path, CONFIG)
    assert found.status == "fail"
    assert "No space left" in found.detail
    assert list(tmp_path.iterdir()) == []


def test_a_nearly_full_disk(tmp_path: Path) -> None:
    assert check_runs(tmp_path, DoctorConfig(disk_fail_gb=1e9)).status == "fail"
    assert check_runs(tmp_path, DoctorConfig(disk_warn_gb=1e9)).status == "warn"


@pytest.mark.parametrize(("gb", "status"), [(0.3, "fail"), (1.0, "warn"), (8.0, "ok")])
def test_memory(gb: float, status: str) -> None:
    assert check_memory(gb * 1e9, 16e9, CONFIG).status == status


@pytest.mark.parametrize(
    ("count", "load", "status"), [(1, 0.0, "warn"), (2, 5.0, "warn"), (4, 1.0, "ok")]
)
def test_processors(count: int, load: float, status: str) -> None:
    assert check_processors(count, load).status == status


@pytest.mark.parametrize(
    ("synchronised", "step_s", "status"),
    [(True, 0.0, "ok"), (None, 0.01, "ok"), (False, 0.0, "warn"), (True, -3.0, "warn")],
)
def test_clock(synchronised: bool | None, step_s: float, status: str) -> None:
    assert check_clock(synchronised, step_s, CONFIG).status == status


@pytest.mark.parametrize(
    ("driver", "torch_says", "status"),
    [
        (None, "", "ok"),
        (None, None, "warn"),
        ("RTX", "", "warn"),
        ("RTX", "RTX", "ok"),
        ("RTX", None, "warn"),
    ],
)
def test_gpu(driver: str | None, torch_says: str | None, status: str) -> None:
    assert check_gpu(driver, torch_says).status == status


def test_settings(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if name.startswith("DRONERF_")]:
        monkeypatch.delenv(name)
    assert check_settings(os.environ).status == "ok"
    monkeypatch.setenv("DRONERF_PROT", "8001")
    misspelt = check_settings(os.environ)
    assert misspelt.status == "warn"
    assert misspelt.remedy == "is DRONERF_PORT meant?"
    monkeypatch.setenv("DRONERF_SAFETY__CEILNG_M", "2")
    nested = check_settings(os.environ)
    assert nested.status == "fail"
    assert "DRONERF_SAFETY__CEILNG_M" in nested.detail
    monkeypatch.delenv("DRONERF_SAFETY__CEILNG_M")
    monkeypatch.setenv("DRONERF_PORT", "eighty")
    assert check_settings(os.environ).status == "fail"


@pytest.mark.parametrize(
    ("system", "tools", "words"),
    [
        ("linux", {"ufw", "iptables"}, "sudo ufw allow 8890/udp; sudo ufw allow 11111/udp"),
        ("linux", {"firewall-cmd", "nft"}, "--add-port=8890/udp --add-port=11111/udp"),
        ("linux", {"nft"}, "udp dport '{ 8890,11111 }' accept"),
        ("linux", {"iptables"}, "--dports 8890,11111 -j ACCEPT"),
        ("linux", set(), "8890,11111"),
        ("wsl", {"ufw"}, "networkingMode=mirrored"),
        ("darwin", set(), "Local Network"),
        ("windows", set(), "localport=8890,11111"),
    ],
)
def test_firewall_advice(system: str, tools: set[str], words: str) -> None:
    assert words in opening_advice((8890, 11111), system, tools)


async def test_other_programs_that_are_missing_fail_or_hang_say_nothing() -> None:
    assert await run_briefly("no-such-program-of-ours", limit_s=1.0) is None
    assert await run_briefly(sys.executable, "-c", "raise SystemExit(3)", limit_s=20.0) is None
    hanging = "import time; time.sleep(60)"
    assert await run_briefly(sys.executable, "-c", hanging, limit_s=0.3) is None
    assert await run_briefly(sys.executable, "-c", "print(' hello ')", limit_s=20.0) == "hello"


@pytest.mark.parametrize("name", ["reply_s", "scan_pause_s", "tries"])
def test_config_refuses_nonsense(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        DoctorConfig(**{name: -1})
    with pytest.raises(ValueError, match="views"):
        LiveConfig(views=0)


@pytest.mark.slow
def test_the_doctor_never_loads_torch() -> None:
    code = (
        "import sys, server.doctor.command, server.doctor.calibrate;"
        " sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
