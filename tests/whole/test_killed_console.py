"""A console killed at random moments of captures and trainings: nothing told is lost or unreadable.

``DRONERF_KILLS=30`` kills it thirty times, and says of each with ``--log-cli-level=INFO`` when it
was and what came of it.
"""

from __future__ import annotations

import json
import logging
import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from programs import COMMAND, TOKEN, free_port

from server.nerf.flight import read_pictures
from server.recording.reading import Recording

logger = logging.getLogger(__name__)

KILLS = int(os.environ.get("DRONERF_KILLS", "2"))
# From the order to the end of the training it takes about so long.
LONGEST_S = 80.0
PICTURES = 4
WISH = {"pictures": PICTURES, "train_seconds": 5, "seed": 1}
OVER = ("succeeded", "failed", "aborted", "interrupted")

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(600 * (KILLS + 1))]


@dataclass(frozen=True, slots=True)
class Cut:
    """What the console had told when it was killed."""

    id: str
    phase: str
    images: int
    state: str


@contextmanager
def mortal_console(runs: Path) -> Iterator[tuple[httpx.Client, subprocess.Popen[bytes]]]:
    """Run ``dronerf serve`` with simulated drones; whoever kills it leaves its workers alive."""
    port = free_port()
    process = subprocess.Popen(
        [*COMMAND, "serve", "--sim", "recycle_bin", "--port", str(port), "--runs", str(runs)],
        env=os.environ | {"DRONERF_TOKEN": TOKEN},
    )
    headers = {"Authorization": f"Bearer {TOKEN}"}
    try:
        with httpx.Client(
            base_url=f"http://127.0.0.1:{port}", headers=headers, timeout=30.0
        ) as client:
            deadline_s = time.monotonic() + 120.0
            while True:
                assert process.poll() is None, "the console ended"
                assert time.monotonic() < deadline_s, "the console does not answer"
                try:
                    if client.get("/readyz").status_code == 200:
                        break
                except httpx.TransportError:
                    pass
                time.sleep(0.2)
            yield client, process
    finally:
        if process.poll() is None:
            process.terminate()
        process.wait(60.0)


def test_a_console_is_killed_at_random_moments(tmp_path: Path) -> None:
    moments, cut = random.Random(11), None
    phases: set[str] = set()
    for number in range(KILLS):
        with mortal_console(tmp_path) as (client, process):
            if cut is not None:
                nothing_is_lost(client, tmp_path, cut, to_the_end=number % 5 == 0)
            cut = told_until_killed(client, process, moments.uniform(0.0, LONGEST_S))
            phases.add(cut.phase)
    with mortal_console(tmp_path) as (client, _):
        assert cut is not None
        nothing_is_lost(client, tmp_path, cut, to_the_end=True)
        listed = client.get("/api/v1/captures").json()
        assert len(listed) == KILLS
    if KILLS >= 10:
        assert len(phases) > 3, f"killed in {phases} alone"


def told_until_killed(
    client: httpx.Client, process: subprocess.Popen[bytes], after_s: float
) -> Cut:
    """Start a capture, kill the console so long after, and return what it told last."""
    answer = client.post("/api/v1/captures", json=WISH)
    assert answer.status_code < 300, answer.text
    kill_s = time.monotonic() + after_s
    told: dict[str, Any] = answer.json()
    path = answer.headers["location"]
    while time.monotonic() < kill_s and told["state"] not in OVER:
        time.sleep(0.1)
        told = client.get(path).json()
    os.kill(process.pid, signal.SIGKILL)
    process.wait(10.0)
    cut = Cut(told["id"], told["phase"], told["images"], told["state"])
    logger.info("killed after %.0f s: %s", after_s, cut)
    return cut


def nothing_is_lost(client: httpx.Client, runs: Path, cut: Cut, *, to_the_end: bool) -> None:
    """Check everything on disk, and bring the capture to its end, or to another one."""
    folder = runs / cut.id
    assert is_readable(folder) >= cut.images
    told = client.get(f"/api/v1/captures/{cut.id}").json()
    assert told["images"] >= cut.images
    if not to_the_end:
        if told["state"] == "interrupted":
            resumed = client.post(f"/api/v1/captures/{cut.id}/resume")
            assert resumed.status_code in (200, 409), resumed.text
        client.post(f"/api/v1/captures/{cut.id}/abort")
        told = until_over(client, cut.id)
        assert is_readable(folder) >= cut.images
        logger.info("then %s with %d pictures: %s", told["state"], told["images"], told["error"])
        return
    told = until_over(client, cut.id)
    if told["state"] == "interrupted":
        resumed = client.post(f"/api/v1/captures/{cut.id}/resume")
        if resumed.status_code == 409:
            assert resumed.json()["detail"]
            assert cut.images < PICTURES, resumed.text
        else:
            assert resumed.status_code == 200, resumed.text
            told = until_over(client, cut.id)
    if cut.images == PICTURES:
        assert told["state"] == "succeeded", told
    else:
        # With less than all of its views there may be no field; then it says why.
        assert told["state"] == "succeeded" or told["error"], told
    is_readable(folder)
    logger.info("then %s with %d pictures: %s", told["state"], told["images"], told["error"])


def until_over(client: httpx.Client, capture_id: str) -> dict[str, Any]:
    deadline_s = time.monotonic() + 300.0
    while True:
        told: dict[str, Any] = client.get(f"/api/v1/captures/{capture_id}").json()
        if told["state"] in OVER:
            return told
        assert time.monotonic() < deadline_s, told
        time.sleep(0.5)


def is_readable(folder: Path) -> int:
    """Read whatever the folder has; returns how many pictures of the dataset are listed."""
    for file in folder.glob("*.json"):
        json.loads(file.read_text())
    for picture in [*folder.glob("images/*.jpg"), *folder.glob("keyframes/*.jpg")]:
        data = np.fromfile(picture, np.uint8)
        # One that is cut off can be decoded, too: whole ones have an end.
        assert data[-2:].tobytes() == b"\xff\xd9", picture
        assert cv2.imdecode(data, cv2.IMREAD_COLOR) is not None, picture
    recording = folder / "recording.mcap"
    # A chunk is a megabyte; one that was killed before its first has none to be read.
    if recording.exists() and recording.stat().st_size > 2_000_000:
        assert sum(1 for _ in Recording(recording).messages()) > 0
    if not (folder / "pictures.jsonl").exists():
        return 0
    stills = [picture for picture in read_pictures(folder) if picture.still]
    for still in stills:
        for name in (still.file, still.mask):
            assert name is None or (folder / name).stat().st_size > 0
    return len(stills)
