"""A client that a generator makes of the committed OpenAPI document flies a whole capture."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

import pytest
from programs import TOKEN, Peer, console

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(1200)]

OPENAPI = Path(__file__).parents[2] / "docs" / "openapi.json"
GENERATOR = "openapi-python-client==0.29.1"

# Written as a user of the generated package would: only its own names, no paths.
SCRIPT = """
import json, sys, time
from console_client import AuthenticatedClient
from console_client.api.captures import get_capture, get_capture_metrics, list_captures
from console_client.api.captures import pause_capture, resume_capture, start_capture
from console_client.api.drones import list_drones
from console_client.api.results import get_artifact, list_artifacts
from console_client.api.safety import get_preflight
from console_client.models import CaptureSpec

client = AuthenticatedClient(base_url=sys.argv[1], token=sys.argv[2])
told = {}
until = time.monotonic() + 60.0
while not all(check.passed for check in get_preflight.sync(client=client)):
    assert time.monotonic() < until, get_preflight.sync(client=client)
    time.sleep(0.5)
told["drones"] = [drone.name for drone in list_drones.sync(client=client)]
wish = CaptureSpec(name="by a generated client", pictures=8, train_seconds=6)
capture = start_capture.sync(client=client, body=wish)
told["state"] = capture.state
paused = False
while capture.state in ("queued", "running", "paused"):
    time.sleep(1.0)
    capture = get_capture.sync(capture.id, client=client)
    if capture.phase == "fly" and not paused:
        paused = True
        told["paused"] = pause_capture.sync(capture.id, client=client).state
        told["resumed"] = resume_capture.sync(capture.id, client=client).state
told["end"], told["images"], told["error"] = capture.state, capture.images, capture.error
told["metrics"] = get_capture_metrics.sync(capture.id, client=client).to_dict()
told["listed"] = [each.id for each in list_captures.sync(client=client)] == [capture.id]
files = list_artifacts.sync(client=client, capture=capture.id)
told["files"] = {file.path: file.size_bytes for file in files}
picture = get_artifact.sync_detailed(capture.id, "images/0000.jpg", client=client)
told["picture"] = [picture.status_code.value, picture.content[:2].hex(), len(picture.content)]
print(json.dumps(told))
"""


def test_a_generated_client_flies_a_capture(peer: Peer, tmp_path: Path) -> None:
    python = peer(GENERATOR, whole=True)
    config = tmp_path / "generator.yaml"
    config.write_text(
        "project_name_override: console-client\npackage_name_override: console_client\n"
    )
    made = tmp_path / "console-client"
    options = ["--output-path", str(made), "--config", str(config)]
    command = [str(python), "-m", "openapi_python_client", "generate", "--path", str(OPENAPI)]
    generated = subprocess.run(
        [*command, *options],
        # It tidies what it made with a program beside it.
        env=os.environ | {"PATH": f"{python.parent}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = generated.stdout + generated.stderr
    assert generated.returncode == 0, said[-4000:]
    # It knows no pictures and no sheets to print, and leaves those answers out.
    unread = re.findall(r"^WARNING parsing GET /api/v1/drones/{drone_id}/(\S+)", said, re.MULTILINE)
    sheets = [f"calibration/{name}" for name in ("board.pdf", "board.png", "coverage.png")]
    assert sorted(unread) == [*sheets, "frame.jpg"], said
    assert said.count("WARNING parsing") == len(unread), said
    simulated = ("--sim", "recycle_bin", "--seed", "1")
    with console(tmp_path / "runs", *simulated) as address:
        done = subprocess.run(
            [str(python), "-c", SCRIPT, address, TOKEN],
            cwd=made,
            capture_output=True,
            text=True,
            timeout=1000.0,
            check=False,
        )
    assert done.returncode == 0, done.stderr[-4000:]
    told = json.loads(done.stdout)
    assert len(told["drones"]) == 4
    assert told["state"] in ("queued", "running")
    assert (told["paused"], told["resumed"]) == ("paused", "running")
    assert (told["end"], told["error"]) == ("succeeded", None)
    assert told["images"] == 8
    assert told["metrics"]["images"] == 8
    assert told["metrics"]["psnr_db"] > 10.0
    assert told["listed"]
    assert {"capture.json", "transforms.json", "recording.mcap"} <= set(told["files"])
    status, magic, size = told["picture"]
    assert (status, magic) == (200, "ffd8")
    assert size == told["files"]["images/0000.jpg"]
