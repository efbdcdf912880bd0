"""The script in the README does what it says: a capture from start to mesh, with a shell alone."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from programs import COMMAND, free_port

README = Path(__file__).parents[2] / "README.md"

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(900)]


def script(port: int, runs: Path) -> str:
    """Return the README's script for a short capture on another port."""
    found = re.search(r"## From a script.*?```sh\n(.*?)```", README.read_text(), re.DOTALL)
    assert found is not None
    text = found[1]
    for ours, theirs in (
        ("dronerf serve", f"{' '.join(COMMAND)} serve --port {port} --runs {runs}"),
        ("127.0.0.1:8000", f"127.0.0.1:{port}"),
        ('"pictures": 24', '"pictures": 12'),
        ('"train_seconds": 60', '"train_seconds": 10'),
    ):
        assert ours in text
        text = text.replace(ours, theirs)
    # A reader leaves the console running; it lands its drones when it is told to end.
    return f"set -e\ntrap 'kill $(jobs -p); wait' EXIT\n{text}"


@pytest.mark.skipif(shutil.which("curl") is None, reason="needs curl")
def test_the_script_of_the_readme_flies_a_capture_and_fetches_its_mesh(tmp_path: Path) -> None:
    assert sys.executable in COMMAND
    done = subprocess.run(
        ["bash", "-c", script(free_port(), tmp_path / "runs")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    said = f"{done.stdout}\n{done.stderr[-4000:]}"
    assert done.returncode == 0, said
    assert '"state":"succeeded"' in done.stderr, said
    assert (tmp_path / "mesh.glb").read_bytes()[:4] == b"glTF", said
    answers = [line for line in done.stdout.splitlines() if '"psnr_db"' in line]
    assert answers, said
    metrics = json.loads(answers[0][answers[0].index("{") : answers[0].rindex("}") + 1])
    assert metrics["psnr_db"] > 10.0
