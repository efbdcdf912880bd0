"""The README's script, run as it stands there but for its port and its size."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from programs import COMMAND, TOKEN, free_port

pytestmark = [
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not installed"),
]

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def script(runs: Path, port: int) -> str:
    """Return the example with a token, a port and a folder of ours, and a small capture."""
    found = re.search(r"## From a script\n.*?```sh\n(.*?)```", README, re.DOTALL)
    assert found is not None
    text = found[1]
    serve = f"{shlex.join(COMMAND)} serve --port {port} --runs {shlex.quote(str(runs))}"
    for told, ours in {
        "choose-a-long-secret": TOKEN,
        "dronerf serve": serve,
        "127.0.0.1:8000": f"127.0.0.1:{port}",
        '"pictures": 24, "train_seconds": 60': '"pictures": 12, "train_seconds": 20',
    }.items():
        assert told in text
        text = text.replace(told, ours)
    return f"set -e -o pipefail\n{text}"


def test_the_script_fetches_a_mesh(tmp_path: Path) -> None:
    told, followed = tmp_path / "told.txt", tmp_path / "followed.txt"
    with told.open("w") as out, followed.open("w") as err:
        # The console goes on in the background when the script is through.
        process = subprocess.Popen(
            ["bash", "-c", script(tmp_path / "runs", free_port())],
            cwd=tmp_path,
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        try:
            assert process.wait(800.0) == 0, followed.read_text()[-3000:]
        finally:
            os.killpg(process.pid, signal.SIGTERM)
    assert '"state":"succeeded"' in followed.read_text()
    assert '"psnr_db":' in told.read_text()
    assert (tmp_path / "mesh.glb").read_bytes()[:4] == b"glTF"
