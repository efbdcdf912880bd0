"""Service and containers, read without an engine: what would start, as whom, with which rights."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
import yaml

from server.swarm.failsafes import FailsafeTable

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    """The services of compose.yaml."""
    return yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]


def test_the_console_waits_for_its_database_and_both_ask_for_one_password(
    services: dict[str, Any],
) -> None:
    console, database = services["console"], services["database"]
    assert console["depends_on"]["database"] == {"condition": "service_healthy"}
    url = console["environment"]["DRONERF_DATABASE_URL"]
    password = database["environment"]["POSTGRES_PASSWORD"]
    user, name = (database["environment"][key] for key in ("POSTGRES_USER", "POSTGRES_DB"))
    # Without a password nothing starts; there is no default one.
    assert password.startswith("${POSTGRES_PASSWORD:?")
    assert url == f"postgresql://{user}:{password}@database/{name}"
    assert f"--dbname {name}" in database["healthcheck"]["test"][1]


def test_the_console_has_no_rights_it_does_not_need(services: dict[str, Any]) -> None:
    console = services["console"]
    assert console["read_only"] is True
    assert console["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in console["security_opt"]
    assert all(port.startswith("127.0.0.1:") for port in console["ports"])
    assert "ports" not in services["database"]
    # All that it writes lies where it may write.
    (volume,) = console["volumes"]
    environment = _environment_of_the_image()
    assert volume.split(":")[1] == environment["DRONERF_RUNS"]
    assert console["tmpfs"][0].startswith("/tmp")
    for name in ("HOME", "NUMBA_CACHE_DIR"):
        assert environment[name].startswith("/tmp")


def test_it_is_given_the_time_to_land(services: dict[str, Any]) -> None:
    assert services["console"]["stop_grace_period"] == "60s"
    unit = _unit()
    assert int(unit["TimeoutStopSec"][0]) >= 60
    # Its children would be stopped before they are wanted no more.
    assert unit["KillMode"] == ["process"]


def test_the_unit_starts_what_setup_makes_and_writes_only_where_it_may() -> None:
    unit = _unit()
    program, *arguments = unit["ExecStart"][0].split()
    assert (program, arguments[0]) == ("/srv/dronerf/.venv/bin/dronerf", "serve")
    environment = dict(pair.split("=", 1) for line in unit["Environment"] for pair in line.split())
    assert environment["DRONERF_RUNS"] == f"/var/lib/{unit['StateDirectory'][0]}"
    assert environment["NUMBA_CACHE_DIR"] == f"/var/cache/{unit['CacheDirectory'][0]}"
    assert unit["AmbientCapabilities"] == unit["CapabilityBoundingSet"] == ["CAP_NET_RAW"]


def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("no systemd-analyze on this machine")
    text = (ROOT / "deploy" / "dronerf.service").read_text()
    unit = tmp_path / "dronerf.service"
    # The program need not be installed here.
    unit.write_text(re.sub(r"(?m)^ExecStart=\S+", "ExecStart=/bin/true", text))
    told = subprocess.run([program, "verify", str(unit)], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    assert "dronerf.service" not in told.stderr


def test_every_package_names_its_licence() -> None:
    command = [sys.executable, ROOT / "deploy" / "licences.py"]
    command += ["--lock", ROOT / "web" / "package-lock.json"]
    told = subprocess.run(command, capture_output=True, text=True)
    assert told.returncode == 0, [line for line in told.stdout.splitlines() if "NONE" in line]
    listed = {line.split()[0].lower() for line in told.stdout.splitlines()}
    needed = json.loads((ROOT / "web" / "package.json").read_text())["dependencies"]
    assert set(needed) <= listed
    assert {"torch", "viser", "fastapi"} <= listed


def _environment_of_the_image() -> dict[str, str]:
    text = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    (line,) = (found for found in text.splitlines() if "DRONERF_RUNS" in found)
    return dict(pair.split("=", 1) for pair in line.removeprefix("ENV ").split())


def _unit() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in (ROOT / "deploy" / "dronerf.service").read_text().splitlines():
        if "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            found.setdefault(name, []).append(value)
    return found


def _pages() -> set[str]:
    text = (ROOT / "docs" / "alarms.md").read_text()
    return {line.removeprefix("### ") for line in text.splitlines() if line.startswith("### ")}


def test_every_failsafe_and_every_alert_has_its_page() -> None:
    rules = yaml.safe_load((ROOT / "deploy" / "alerts.yml").read_text())["groups"][0]["rules"]
    alerts = {rule["alert"] for rule in rules}
    assert {field.name for field in fields(FailsafeTable)} | alerts <= _pages()
    for rule in rules:
        assert rule["annotations"]["page"] == f"docs/alarms.md#{rule['alert'].lower()}"


def test_alerts_watch_what_the_console_tells() -> None:
    told = (ROOT / "server" / "api" / "health.py").read_text()
    text = (ROOT / "deploy" / "alerts.yml").read_text()
    watched = set(re.findall(r"\bdronerf_\w+", text))
    assert watched
    assert {name for name in watched if f'"{name}"' not in told} == set()
