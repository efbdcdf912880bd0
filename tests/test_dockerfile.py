"""The Dockerfile, read without an engine: what a container would start, as whom, and from what."""

from __future__ import annotations

import json
import re
import shlex
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).parent.parent


def instructions() -> list[tuple[str, str]]:
    """Return (instruction, arguments) pairs, continued lines joined, comments left out."""
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    pairs = [line.split(maxsplit=1) for line in joined.splitlines() if line.strip()]
    return [(word, rest.strip()) for word, rest in pairs]


def all_of(word: str) -> list[str]:
    """Return the arguments of every such instruction, in order."""
    return [rest for name, rest in instructions() if name == word]


def test_only_known_instructions_in_a_sound_order() -> None:
    names = [name for name, _ in instructions()]
    known = {"FROM", "RUN", "WORKDIR", "ARG", "COPY", "USER", "ENV", "VOLUME", "EXPOSE"}
    assert set(names) <= known | {"HEALTHCHECK", "ENTRYPOINT", "CMD"}
    assert names[0] == "FROM"
    assert names[-2:] == ["ENTRYPOINT", "CMD"]
    assert all(names.count(once) == 1 for once in ("FROM", "USER", "CMD", "HEALTHCHECK"))


def test_by_default_it_serves_simulated_drones() -> None:
    assert json.loads(all_of("ENTRYPOINT")[0]) == ["dronerf"]
    assert json.loads(all_of("CMD")[0]) == ["serve", "--sim", "robot_dog"]


def test_it_does_not_run_as_root_and_may_write_its_runs() -> None:
    (user,) = all_of("USER")
    assert user not in ("root", "0")
    names = [name for name, _ in instructions()]
    made = next(i for i, (n, rest) in enumerate(instructions()) if n == "RUN" and "useradd" in rest)
    assert re.search(rf"useradd .*\b{user}\b", instructions()[made][1])
    assert f"chown {user} runs" in instructions()[made][1]
    assert made < names.index("USER") < names.index("CMD")
    # What is written into a volume's folder after VOLUME is lost.
    assert made < names.index("VOLUME")
    assert all(n != "RUN" for n in names[names.index("USER") :]), "the set-up needs root"


def test_its_settings_are_settings_and_its_paths_fit() -> None:
    environment = dict(pair.split("=", 1) for pair in shlex.split(all_of("ENV")[0]))
    (folder,) = all_of("WORKDIR")
    assert environment["DRONERF_HOST"] == "0.0.0.0"
    assert environment["DRONERF_MAKE_TOKEN"] == "true", "without a token it would refuse to start"
    assert environment["DRONERF_RUNS"] == all_of("VOLUME")[0] == f"{folder}/runs"
    assert environment["PATH"].startswith(f"{folder}/.venv/bin:")
    assert all_of("EXPOSE") == ["8000"]


def test_the_health_check_asks_the_open_path() -> None:
    (check,) = all_of("HEALTHCHECK")
    options, command = check.split(" CMD ")
    assert "--start-period=" in options
    program, flag, code = json.loads(command)
    assert (program, flag) == ("python3", "-c")
    compile(code, "healthcheck", "exec")
    assert "http://127.0.0.1:8000/livez" in code


def test_what_it_copies_exists_and_is_not_ignored() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    copied: list[str] = []
    for rest in all_of("COPY"):
        *sources, _ = rest.split()
        copied += sources
    for source in copied:
        assert (ROOT / source).exists(), source
        assert not any(fnmatch(source, pattern) for pattern in ignored), source
    # The set-up reads these; without one of them `make setup` fails in the image.
    assert {"Makefile", "pyproject.toml", "constraints.txt", "README.md"} <= set(copied)
    assert {"server", "web"} <= set(copied)
    assert {".git", ".venv", "runs", "web/node_modules"} <= set(ignored)


def test_packages_leave_no_lists_behind_and_hold_what_the_renderer_needs() -> None:
    (install,) = [rest for rest in all_of("RUN") if "apt-get install" in rest]
    assert "apt-get update" in install
    assert "--no-install-recommends" in install
    assert "rm -rf /var/lib/apt/lists/*" in install
    packages = install.split("--no-install-recommends")[1].split("&&")[0].split()
    assert {"python3", "python3-venv", "make", "libx11-6"} <= set(packages)
    assert any("make setup" in rest and "TORCH_INDEX" in rest for rest in all_of("RUN"))
