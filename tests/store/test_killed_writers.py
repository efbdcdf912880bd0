"""Thirty writers of captures, each killed at a random moment: nothing is lost or unreadable."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from killed_writer import jpeg

from server.nerf.flight import read_pictures
from server.store.catalogue import Catalogue
from server.store.runs import RunFolder

KILLS = 30


@pytest.mark.slow
def test_what_was_told_to_be_on_disk_is_there_after_a_kill(tmp_path: Path) -> None:
    moments, pictures = random.Random(7), 0
    # What the kernel was given outlives the process; power cuts are in test_crashes.
    with subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name("killed_writer.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    ) as writer:
        assert writer.stdin is not None
        assert writer.stdout is not None
        for number in range(KILLS):
            writer.stdin.write(f"{tmp_path} kill-{number}\n")
            _, pid, _ = writer.stdout.readline().split()
            time.sleep(moments.uniform(0.0, 0.3))
            os.kill(int(pid), signal.SIGKILL)
            told = _told(writer)
            pictures += len(told)
            _check(tmp_path, f"kill-{number}", told)
        writer.stdin.close()
    with Catalogue(tmp_path) as catalogue:
        found = catalogue.rescan()
        readable = [run for run in tmp_path.glob("*/capture.json") if run.stat().st_size]
        assert found.runs == len(readable)
    assert pictures > KILLS, "it was killed before it had written anything"


def _told(writer: subprocess.Popen[str]) -> dict[int, str]:
    """Return the pictures by number that the child told of before it was killed."""
    assert writer.stdout is not None
    told: dict[int, str] = {}
    for line in writer.stdout:
        run, index, name = line.split()
        if run == "ended":
            break
        told[int(index)] = name
    return told


def _check(runs: Path, name: str, told: dict[int, str]) -> None:
    folders = list(runs.glob(f"*-{name}"))
    if not folders:
        assert told == {}
        return
    (folder,) = folders
    run = RunFolder(folder)
    for index, file in told.items():
        assert (folder / file).read_bytes() == jpeg(index)
    listed = {picture.file for picture in read_pictures(folder)}
    assert set(told.values()) <= listed
    # What is there under its name is whole, told or not.
    for picture in [*folder.glob("images/*.jpg"), *folder.glob("keyframes/*.jpg")]:
        assert cv2.imdecode(np.fromfile(picture, np.uint8), cv2.IMREAD_COLOR) is not None
    if told:
        state = run.state()
        assert state is not None
        assert state["status"]["images"] >= max(told)
        frames = json.loads((folder / "transforms.json").read_text())["frames"]
        stills = {file for file in told.values() if file.startswith("images/")}
        assert stills <= {frame["file_path"] for frame in frames}
