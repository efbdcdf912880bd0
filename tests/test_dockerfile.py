"""The Dockerfile, read without an engine: what a container would start, as whom, and from what."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

from bare_root import ignored_names, instructions, is_ignored

ROOT = Path(__file__).parent.parent


def all_of(word: str) -> list[str]:
    """Return the arguments of every such instruction, in order."""
    return [rest for name, rest in instructions() if name == word]


def stages() -> dict[str, list[tuple[str, str]]]:
    """Return the instructions of each stage by its name; the image's own is ``""``."""
    found: dict[str, list[tuple[str, str]]] = {}
    name = ""
    for word, rest in instructions():
        if word == "FROM":
            name = rest.partition(" AS ")[2]
            found[name] = []
        found[name].append((word, rest))
    return found


def test_hadolint_has_nothing_to_say() -> None:
    hadolint = Path(sys.executable).parent / "hadolint"
    found = subprocess.run([hadolint, ROOT / "Dockerfile"], capture_output=True, text=True)
    assert (found.stdout, found.returncode) == ("", 0)


def test_only_known_instructions_in_a_sound_order() -> None:
    names = [name for name, _ in instructions()]
    known = {"FROM", "RUN", "WORKDIR", "ARG", "COPY", "USER", "ENV", "VOLUME", "EXPOSE"}
    assert set(names) <= known | {"HEALTHCHECK", "ENTRYPOINT", "CMD", "STOPSIGNAL"}
    assert names[0] == "FROM"
    assert names[-2:] == ["ENTRYPOINT", "CMD"]
    assert all(names.count(once) == 1 for once in ("USER", "CMD", "HEALTHCHECK"))


def test_stages_build_on_stages_before_them_and_the_image_on_the_bare_one() -> None:
    known = {"debian:bookworm-slim"}
    for name, steps in stages().items():
        assert steps[0][1].partition(" AS ")[0] in known
        for source in re.findall(r"--from=(\S+)", " ".join(rest for _, rest in steps)):
            assert source in known
        known.add(name)
    # No compiler, no Node, no pip's cache in what is shipped.
    assert stages()[""][0] == ("FROM", "base")
    assert not any("apt-get" in rest or "pip" in rest for _, rest in stages()[""])


def test_by_default_it_serves_simulated_drones() -> None:
    assert json.loads(all_of("ENTRYPOINT")[0]) == ["dronerf"]
    assert json.loads(all_of("CMD")[0]) == ["serve", "--sim", "robot_dog"]


def test_it_does_not_run_as_root_and_may_write_its_runs() -> None:
    (user,) = all_of("USER")
    assert user not in ("root", "0")
    image = stages()[""]
    names = [name for name, _ in image]
    made = next(i for i, (n, rest) in enumerate(image) if n == "RUN" and "useradd" in rest)
    assert re.search(rf"useradd .*\b{user}\b", image[made][1])
    assert f"chown {user} runs" in image[made][1]
    assert made < names.index("USER") < names.index("CMD")
    # What is written into a volume's folder after VOLUME is lost.
    assert made < names.index("VOLUME")
    assert all(n != "RUN" for n in names[names.index("USER") :]), "the set-up needs root"


def test_its_settings_are_settings_and_its_paths_fit() -> None:
    environment = dict(pair.split("=", 1) for pair in shlex.split(all_of("ENV")[-1]))
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
    ignored = ignored_names()
    copied: list[str] = []
    for rest in all_of("COPY"):
        if not rest.startswith("--from="):
            *sources, _ = rest.split()
            copied += sources
    for source in copied:
        assert (ROOT / source).exists(), source
        assert not is_ignored(source, ignored), source
    assert {"pyproject.toml", "constraints.txt", "README.md", "server", "web"} <= set(copied)
    assert {".git", ".venv", "runs", "web/node_modules", "web/dist"} <= set(ignored)


def test_what_is_ignored_is_named_from_the_root_or_anywhere() -> None:
    patterns = ["runs", "web/dist", "**/__pycache__"]
    for path in ("runs", "web/dist", "__pycache__", "server/api/__pycache__"):
        assert is_ignored(path, patterns), path
    for path in ("server/runs", "dist", "web", "runs2"):
        assert not is_ignored(path, patterns), path


def test_packages_leave_no_lists_behind_and_hold_what_the_renderer_needs() -> None:
    installs = [rest for rest in all_of("RUN") if "apt-get install" in rest]
    for install in installs:
        assert "apt-get update" in install
        assert "--no-install-recommends" in install
        assert "rm -rf /var/lib/apt/lists/*" in install
    packages = installs[0].split("--no-install-recommends")[1].split("&&")[0].split()
    assert set(packages) == {"python3", "libx11-6"}


def test_the_program_stage_installs_what_is_pinned_and_no_tools() -> None:
    runs = " ".join(rest for word, rest in stages()["program"] if word == "RUN")
    assert "--constraint constraints.txt --editable '.[postgres]'" in runs
    assert "[dev]" not in runs
    assert "TORCH_INDEX" in runs
    assert "licences.py" in runs
