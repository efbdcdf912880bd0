"""The project around the code: licence, pins, words that must not leak, documents that are true."""

from __future__ import annotations

import ast
import hashlib
import re
import subprocess
import tomllib
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from server.__main__ import main
from server.api.openapi import openapi_document, openapi_text
from server.api.rest_typescript import rest_text
from server.api.typescript import messages_text
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.pose_config import PoseConfig
from server.settings import Settings
from server.swarm.config import SafetyConfig
from server.swarm.failsafes import FailsafeTable
from server.swarm.fleet_file import load_fleet

ROOT = Path(__file__).parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
# Of the published text down to its end of terms, white space folded.
APACHE_2_SHA256 = "09ae9bf1886f530f7338889ef805f37b288ec6adedd1e1e32058921acf05a782"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def tracked_files() -> list[Path]:
    """Return the files git knows of; skips the test where this is no checkout."""
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def names_in(file: Path) -> set[str]:
    """Return functions, classes and methods (as Class.method) defined in a Python file."""
    found: set[str] = set()
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            inner = (ast.FunctionDef, ast.AsyncFunctionDef)
            found |= {f"{node.name}.{n.name}" for n in node.body if isinstance(n, inner)}
    return found


# Licence and pins ---------------------------------------------------------------------------------


def test_the_licence_is_apache_2() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["license"] == "Apache-2.0"
    assert "Apache License" in text.splitlines()[1]
    assert "Version 2.0, January 2004" in text
    body = text.split("END OF TERMS AND CONDITIONS")[0]
    digest = hashlib.sha256(" ".join(body.split()).encode()).hexdigest()
    assert digest == "09ae9bf1886f530f7338889ef805f37b288ec6adedd1e1e32058921acf05a782", (
        "the terms differ from the published ones"
    )


def test_every_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["dependencies"] + project["optional-dependencies"]["dev"]
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
    assert all(re.fullmatch(r"[A-Za-z0-9_.-]+==[A-Za-z0-9.+]+", pin) for pin in pins)
    pinned = {_plain(pin.split("==")[0]) for pin in pins}
    assert len(pinned) == len(pins), "a package is pinned twice"
    assert {_plain(re.split(r"[<>=!~\[]", name)[0]) for name in wanted} <= pinned


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


# What must not be in the repository ---------------------------------------------------------------


def test_no_machine_path_and_no_registry_host_is_named() -> None:
    # Put together here, so that this file does not hold what it forbids.
    paths = [f"/{name}/" for name in ("work", "root", "home", "Users")]
    hosts = ["pypi" + ".org", "pythonhosted" + ".org", "download." + "pytorch", "npmjs" + ".org"]
    allowed = {"Dockerfile": [paths[1]]}  # Root's home inside the image.
    faults: list[str] = []
    for file in tracked_files():
        try:
            text = file.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        for word in (*paths, *hosts):
            if word in allowed.get(file.name, []):
                continue
            # A path inside a URL or inside something else has a name before it.
            if re.search(r"(?<![\w.}*~-])" + re.escape(word), text):
                faults.append(f"{file.relative_to(ROOT)}: {word}")
    assert faults == []


# Code ---------------------------------------------------------------------------------------------


def test_every_package_says_what_it_is() -> None:
    folders = {file.parent for file in (ROOT / "server").rglob("*.py")}
    for folder in folders:
        module = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
        text = ast.get_docstring(module)
        assert text is not None, folder
        assert len(text.split()) > 3, f"{folder}: {text}"
        assert len(module.body) == 1, f"{folder}: a package holds its docstring and nothing else"


def test_generated_files_are_up_to_date() -> None:
    written = (ROOT / "web/src/protocol/messages.gen.ts").read_text(encoding="utf-8")
    assert written == messages_text(), "run `make messages`"
    assert (ROOT / "docs/openapi.json").read_text(encoding="utf-8") == openapi_text(), (
        "run `make openapi`"
    )
    rest = (ROOT / "web/src/protocol/rest.gen.ts").read_text(encoding="utf-8")
    assert rest == rest_text(openapi_document()), "run `make openapi`"


# Documents ----------------------------------------------------------------------------------------


def test_the_readme_tells_of_every_word_of_the_makefile_and_of_no_other() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    phony = re.findall(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[0].split()
    told = re.findall(r"^\| `make ([a-z]+)", README, re.MULTILINE)
    assert sorted(told) == sorted(phony)
    used = set(re.findall(r"^make ([a-z]+)\b", "\n".join(_code(README)), re.MULTILINE))
    assert {"demo", "test", "setup"} <= used <= set(phony)


def test_the_readme_tells_of_every_command(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = _commands(capsys, monkeypatch)
    told = re.findall(r"^\| `([a-z]+)` \|.*\| `dronerf ([a-z]+) ", README, re.MULTILINE)
    assert [name for name, _ in told] == [example for _, example in told] == commands
    used = set(re.findall(r"\bdronerf ([a-z]+)\b", "\n".join(_code(README))))
    assert used <= set(commands)


def _commands(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the commands in the order of the help."""
    monkeypatch.setattr("sys.argv", ["dronerf", "--help"])
    with pytest.raises(SystemExit):
        main()
    return re.findall(r"^    ([a-z]+)(?: |$)", capsys.readouterr().out, re.MULTILINE)


def _code(text: str) -> Iterable[str]:
    """Return everything that is set as code."""
    yield from re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    yield from re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def test_the_fleet_of_the_readme_can_be_loaded(tmp_path: Path) -> None:
    example = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)[0]
    file = tmp_path / "fleet.toml"
    file.write_text(example)
    fleet = load_fleet(file)
    assert [drone.azimuth_deg for drone in fleet.drones] == [0.0, 90.0, 180.0, 270.0]
    assert fleet.drones[3].intrinsics.fx == pytest.approx(918.2)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)", text):
        if "://" not in target:
            assert (document.parent / target).exists(), target


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_named_files_exist(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:server|web|docs|tests)/[\w./-]+)`", text):
        assert (ROOT / name).exists(), name


def test_the_method_names_what_exists() -> None:
    text = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    named = re.findall(r"`([\w/]+\.py):([\w.]+)`", text)
    assert len(named) > 40
    for file, name in named:
        assert name in names_in(ROOT / "server" / file), f"{file}:{name}"


def test_settings_in_documents_exist() -> None:
    named: set[str] = set()
    roots = "mission|planner|vision|safety|pose|field|train"
    for document in DOCUMENTS:
        text = document.read_text(encoding="utf-8")
        named |= set(re.findall(rf"`((?:{roots})\.[\w.]+)`", text))
    assert len(named) > 50
    for name in named:
        _setting(name)


def _setting(name: str) -> Any:
    """Return the class or default behind a dotted setting; fails when there is none."""
    head, *rest = name.split(".")
    roots: dict[str, Any] = {"pose": PoseConfig, "field": FieldConfig, "train": TrainConfig}
    value = roots[head]() if head in roots else Settings.model_fields[head].annotation
    kind: Any = type(value) if head in roots else value
    for part in rest:
        assert is_dataclass(kind), name
        hints = get_type_hints(kind)
        assert part in hints, f"there is no setting {name}"
        kind = hints[part]
    return kind


def test_the_variables_told_of_are_settings() -> None:
    text = (ROOT / "docs/operations.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^\| `DRONERF_([A-Z_]+?)(?:__\.\.\.)?` ", text, re.MULTILINE))
    known = {name.upper() for name in Settings.model_fields} | {"CONFIG"}
    assert told == known


def test_the_table_of_limits_is_the_one_that_flies() -> None:
    text = (ROOT / "docs/safety.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|[^|\n]+\| `safety\.(\w+)` \| ([\d.]+) [^|\n]+\|$", text, re.MULTILINE)
    told = {name: float(value) for name, value in rows}
    assert len(told) == len(rows), "a limit is told twice"
    limits = {item.name for item in fields(SafetyConfig)} - {"failsafes"}
    assert told == {name: getattr(SafetyConfig(), name) for name in limits}


def test_the_table_of_failsafes_is_the_one_that_flies() -> None:
    text = (ROOT / "docs/safety.md").read_text(encoding="utf-8")
    head = re.findall(r"^\| event \| setting \|(.+)\|$", text, re.MULTILINE)
    assert len(head) == 1
    actions = [cell.strip() for cell in head[0].split("|")]
    rows = re.findall(r"^\|[^|\n]+\| `safety\.failsafes\.(\w+)` \|(.+)\|$", text, re.MULTILINE)
    told: set[tuple[str, str, float]] = set()
    for event, cells in rows:
        thresholds = zip(actions, cells.split("|"), strict=True)
        told |= {(event, action, float(cell)) for action, cell in thresholds if cell.strip()}
    assert len(rows) == len(fields(FailsafeTable)), "each event has one row"
    assert told == {(row.event, row.action, row.threshold) for row in FailsafeTable().rows()}


def test_the_readme_tells_who_may_import_whom() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    (layers,) = [one["layers"] for one in contracts["contracts"] if one["type"] == "layers"]
    assert f"`{' > '.join(layers)}`" in README
