"""The README's script flies a capture and fetches its mesh, word for word but for a few numbers."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest
from programs import COMMAND, TOKEN, free_port

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(900)]

README = Path(__file__).parents[2] / "README.md"


def script(port: int, runs: Path) -> str:
    """The README's block for ``curl``, on a free port, with fewer pictures."""
    section = README.read_text().split("## From a script")[1]
    block = re.search(r"```sh\n(.*?)```", section, re.DOTALL)
    assert block is not None
    text = block.group(1)
    for old, new in (
        ("choose-a-long-secret", TOKEN),
        ("dronerf serve", f"{' '.join(COMMAND)} serve --port {port} --runs {runs}"),
        ("127.0.0.1:8000", f"127.0.0.1:{port}"),
        ('"pictures": 24', '"pictures": 8'),
    ):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return f"set -eu\n{text}"


def documents(text: str) -> list[dict[str, Any]]:
    """The JSON objects of a text, which ``curl`` prints without a line's end between them."""
    found, at = [], 0
    while (at := text.find("{", at)) >= 0:
        answer, at = json.JSONDecoder().raw_decode(text, at)
        found.append(answer)
    return found


def test_the_script_of_the_readme_ends_with_a_mesh(tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "DRONERF_TOKEN"}
    with (tmp_path / "out").open("w+") as out, (tmp_path / "err").open("w+") as err:
        # A group of its own: the console that it starts in the background ends with it.
        shell = subprocess.Popen(
            ["bash", "-c", script(free_port(), tmp_path / "runs")],
            cwd=tmp_path,
            env=environment,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        try:
            code = shell.wait(timeout=800.0)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(shell.pid, signal.SIGTERM)
        said, told = (tmp_path / "out").read_text(), (tmp_path / "err").read_text()
    assert '"state":"succeeded"' in told, told[-3000:]
    (about,) = (tmp_path / "runs").glob("*/metrics.json")
    missing = json.loads(about.read_text())["missing"]
    if missing is not None:
        # As the README has it, the script then ends with curl's refusal.
        assert code != 0
        pytest.skip(f"this machine trained too little in a minute: {missing}")
    assert code == 0, told[-3000:]
    assert (tmp_path / "mesh.glb").read_bytes()[:4] == b"glTF"
    (metrics,) = (answer for answer in documents(said) if "psnr_db" in answer)
    assert metrics["psnr_db"] > 10.0
