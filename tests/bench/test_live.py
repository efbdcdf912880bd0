"""How soon a field was there, as a run's own files tell."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest

from server.bench.live import live_figures
from server.nerf.flight import FlightPicture, append_picture


def write_run(folder: Path, told: list[dict[str, object]]) -> Path:
    """Write a run of five stills, a second apart from the clock's zero on, and what was told."""
    for number in range(5):
        append_picture(
            folder,
            FlightPicture(
                f"{number}.jpg", None, True, "drone-1", float(number), 0, np.eye(4), 0.1, 0.1
            ),
        )
    # A key frame on the way back is no picture.
    append_picture(
        folder, FlightPicture("key.jpg", None, False, "drone-1", 9.0, 1, np.eye(4), 0.1, 0.1)
    )
    of_day_s = time.time() - time.monotonic()
    events = folder / "jobs" / "reconstruct" / "events.jsonl"
    events.parent.mkdir(parents=True)
    lines = [json.dumps(event | {"at_s": event["at_s"] + of_day_s}) for event in told]  # type: ignore[operator]
    events.write_text("\n".join(lines) + "\n")
    return folder


def progressed(at_s: float, stage: str, held_out_db: float | None = None) -> dict[str, object]:
    return {"event": "progressed", "at_s": at_s, "stage": stage, "held_out_psnr_db": held_out_db}


def test_times_count_from_the_pictures(tmp_path: Path) -> None:
    told = [
        progressed(4.0, "live"),
        {"event": "preview", "at_s": 5.5},
        {"event": "preview", "at_s": 9.5},
        progressed(10.0, "refine"),
        {"event": "refined", "at_s": 31.0},
        progressed(32.0, "train"),
        progressed(33.0, "train", 10.0),
        progressed(40.0, "train", 18.5),
        progressed(48.0, "train", 19.0),
        progressed(60.0, "train", 20.0),
        progressed(61.0, "deliver", 25.0),
    ]
    figures = live_figures(write_run(tmp_path, told))
    assert figures["first_preview_s"] == pytest.approx(2.5, abs=0.02)
    assert figures["landing_s"] == pytest.approx(6.0, abs=0.02)
    assert figures["refine_s"] == pytest.approx(21.0, abs=0.02)
    assert figures["psnr_90_s"] == pytest.approx(36.0, abs=0.02)
    assert figures["train_end_psnr_db"] == 20.0


def test_a_worker_that_told_too_little_is_not_judged(tmp_path: Path) -> None:
    run = write_run(tmp_path, [progressed(4.0, "live"), progressed(10.0, "refine")])
    with pytest.raises(RuntimeError, match="too little"):
        live_figures(run)
