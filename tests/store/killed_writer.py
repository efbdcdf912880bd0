"""Writes runs until it is killed; run as a child process by the tests.

For each line ``RUNS NAME`` on stdin a process of its own tells its number, begins a run, and tells
every picture as soon as the store says that it is on disk.
"""

from __future__ import annotations

import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from server.geometry.cameras import TELLO_INTRINSICS
from server.nerf.flight import FlightPicture
from server.stages import CameraPose, Capture
from server.store.runs import RunFolder

POSE = CameraPose("drone-1", 0.0, np.eye(4), 0.01 * np.eye(4))


def jpeg(index: int) -> bytes:
    """Return a picture that is unlike every other."""
    image = np.full((90, 120, 3), index % 250, np.uint8)
    image[: index % 90, : index // 90 + 1] = 255
    return cv2.imencode(".jpg", image)[1].tobytes()


def add(run: RunFolder, index: int) -> str:
    """Add one picture, every third a still of the dataset; return its name."""
    if index % 3:
        name = f"keyframes/{index:05}.jpg"
        picture = FlightPicture(name, None, False, "drone-1", 1.0 + index, 0, np.eye(4), 0.1, 0.05)
        run.add_keyframe(picture, jpeg(index))
        return name
    name = f"images/{index:05}.jpg"
    nothing = cast("Any", None)
    still = Capture(index, 0, POSE, TELLO_INTRINSICS, nothing, nothing, name, datetime.now(UTC))
    run.add_still(still, jpeg(index), None, None)
    return name


def write(runs: Path, name: str) -> None:
    """Write a run without end."""
    run = RunFolder.create(runs, name)
    index = 0
    while True:
        now = datetime.now(UTC).isoformat()
        run.write_state(
            {
                "request": {"mode": "standard", "name": name},
                "started_at": now,
                "status": {"state": "running", "at": now, "images": index},
            }
        )
        run.log([{"event": "noted", "index": index}])
        told = add(run, index)
        os.write(1, f"{run.id} {index} {told}\n".encode())
        index += 1


def main() -> None:
    """Have one run after the other written, each by a process of its own."""
    for line in sys.stdin:
        folder, name = line.split()
        child = os.fork()
        if child == 0:
            os.write(1, f"pid {os.getpid()} -\n".encode())
            write(Path(folder), name)
        os.waitpid(child, 0)
        os.write(1, b"ended - -\n")


if __name__ == "__main__":
    main()
