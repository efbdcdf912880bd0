"""One flight of the table with the fields of its two modes: measured once, kept, read again."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from server.bench.drawn_video import fly_drawn_capture
from server.bench.planner_judge import Judge
from server.bench.poses_flight import FlownCapture, usual_config
from server.bench.poses_pictures import draw_pictures
from server.bench.table.fields import JudgedField, train_and_judge
from server.bench.table.leave_out import left_out
from server.bench.table.modes import Posed, posed_as
from server.bench.table.views import HeldOutViews, draw_views
from server.mission.commands import Mode
from server.sim.scenes.catalogue import load_object
from server.store.atomic import write_atomic

_SURFACE_SAMPLES = 3000
# Test views that are shown side by side: low to high, from all sides.
_SHOWN = (0.05, 0.35, 0.65, 0.95)
_STRIP_WIDTH_PX = 1200
_JPEG = (int(cv2.IMWRITE_JPEG_QUALITY), 85)


@dataclass(frozen=True, slots=True)
class Wanted:
    """One flight and what is made of it.

    Attributes:
        scene: Name or file.
        seed: Of everything random.
        flight: The capture's mode.
        pictures: Stills.
        drones: How many fly.
        steps: Training steps of every field.
        views: Test views.
        modes: Which of the flight's modes.
        without: Part of the method that is left out, empty for none.
    """

    scene: str
    seed: int
    flight: Mode
    pictures: int
    drones: int
    steps: int
    views: int
    modes: tuple[str, ...]
    without: str = ""

    @property
    def name(self) -> str:
        """A name for files and lines."""
        return (
            f"{Path(self.scene).name}-{self.seed}-{self.flight}"
            f"-{self.pictures}x{self.drones}-{self.steps}"
            + (f"-without-{self.without}" if self.without else "")
        )


class Parts:
    """The finished parts of one bench, in the folder ``results/parts`` of its ``out``."""

    def __init__(self, out: Path | None, *, resume: bool, threads: int, commit: str | None) -> None:
        """Build it; without a folder nothing is kept."""
        self._out = out
        self._resume = resume
        self._threads = threads
        self._commit = commit
        self._known: dict[Wanted, dict[str, Any]] = {}
        if out is not None:
            for folder in ("parts", "pictures"):
                (out / "results" / folder).mkdir(parents=True, exist_ok=True)

    def measured(self, wanted: Wanted, *, shown: bool = False) -> dict[str, Any]:
        """Return a flight's part: ``samples`` by mode; none, and why it ``failed``, if it did.

        Args:
            wanted: The flight.
            shown: Whether some renderings are kept to be looked at.
        """
        if wanted not in self._known:
            self._known[wanted] = self._kept(wanted) or self._measured_anew(wanted, shown)
        return self._known[wanted]

    def commits(self) -> dict[str, int]:
        """Return how many parts were measured at which commit."""
        return dict(Counter(str(part["commit"]) for part in self._known.values()))

    def _kept(self, wanted: Wanted) -> dict[str, Any] | None:
        """Return the part of an earlier run, None if there is none or of something else."""
        if not self._resume or self._out is None:
            return None
        file = self._file(self._out, wanted)
        part = json.loads(file.read_text()) if file.exists() else {}
        asked = json.loads(json.dumps(asdict(wanted)))
        return part if part.get("wanted") == asked else None

    def _measured_anew(self, wanted: Wanted, shown: bool) -> dict[str, Any]:
        print(f"table1: {wanted.name}", file=sys.stderr, flush=True)
        about = {"name": wanted.name, "wanted": asdict(wanted), "commit": self._commit}
        part = about | self._measure(wanted, shown)
        if self._out is not None:
            text = json.dumps(part) + "\n"
            write_atomic(self._file(self._out, wanted), text.encode())
        return part

    @staticmethod
    def _file(out: Path, wanted: Wanted) -> Path:
        return out / "results" / "parts" / f"{wanted.name}.json"

    def _measure(self, wanted: Wanted, shown: bool) -> dict[str, Any]:
        with tempfile.TemporaryDirectory(prefix="dronerf-table1-") as folder:
            try:
                flown, seconds = _fly(wanted, Path(folder))
            except RuntimeError as error:
                print(f"table1: {wanted.name}: {error}", file=sys.stderr, flush=True)
                return {"failed": str(error), "samples": {}}
            seen = _surface_seen(flown, wanted)
            views = draw_views(load_object(wanted.scene), wanted.seed, wanted.views)
            samples: dict[str, Any] = {}
            pictures: dict[str, Sequence[NDArray[np.uint8]]] = {"truth": views.images_rgb}
            for mode in wanted.modes:
                sample, pictures[mode] = self._sample(mode, wanted, flown, views, seconds)
                samples[mode] = sample | {"surface_seen": seen}
        if shown and self._out is not None:
            for what, images_rgb in pictures.items():
                cv2.imwrite(str(strip_file(self._out, wanted, what)), _strip(images_rgb), _JPEG)
        return {"samples": samples}

    def _sample(
        self,
        mode: str,
        wanted: Wanted,
        flown: FlownCapture,
        views: HeldOutViews,
        seconds: dict[str, float],
    ) -> tuple[dict[str, Any], list[NDArray[np.uint8]]]:
        """Return a mode's sample and its renderings of the test views, RGB."""
        begun_s = time.monotonic()
        posed = posed_as(mode, flown, wanted.seed, self._threads, wanted.without)
        refine_s = time.monotonic() - begun_s
        judged = train_and_judge(
            posed, views, steps=wanted.steps, seed=wanted.seed, threads=self._threads
        )
        rendered = [(255.0 * rgb).astype(np.uint8) for rgb in judged.shown]
        return _sample_of(posed, judged, flown, seconds | {"refine": refine_s}), rendered


def strip_file(out: Path, wanted: Wanted, what: str) -> Path:
    """Return where a mode's renderings of some test views are, or those views' ``truth``."""
    return out / "results" / "pictures" / f"{wanted.name}-{what}.jpg"


def _strip(images_rgb: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return some of the test views side by side, BGR, a page wide."""
    some = [images_rgb[int(share * len(images_rgb))] for share in _SHOWN]
    beside = np.concatenate(some, axis=1)[:, :, ::-1]
    height = round(beside.shape[0] * _STRIP_WIDTH_PX / beside.shape[1])
    smaller = cv2.resize(beside, (_STRIP_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, np.uint8)


def _fly(wanted: Wanted, folder: Path) -> tuple[FlownCapture, dict[str, float]]:
    begun_s = time.monotonic()
    flown = fly_drawn_capture(
        wanted.scene,
        wanted.seed,
        wanted.pictures,
        folder,
        mode=wanted.flight,
        drones=wanted.drones,
        config=left_out(usual_config(), wanted.without),
    )
    flight_s = time.monotonic() - begun_s
    draw_pictures(flown)
    return flown, {"flight": flight_s, "drawing": time.monotonic() - begun_s - flight_s}


def _surface_seen(flown: FlownCapture, wanted: Wanted) -> float:
    """Return the share of the true surface that the stills show, by true poses and lenses."""
    stills = [
        view for view, sent in zip(flown.truth, flown.sent_to, strict=True) if sent is not None
    ]
    judge = Judge(load_object(wanted.scene), _SURFACE_SAMPLES, wanted.seed)
    sights = judge.look_from([v.T_world_cam for v in stills], [v.lens for v in stills])
    return sights.visibility(list(range(len(stills))))


def _sample_of(
    posed: Posed, judged: JudgedField, flown: FlownCapture, seconds: dict[str, float]
) -> dict[str, Any]:
    seconds = seconds | {"train": judged.train_s}
    return {
        "per_view": judged.per_view(),
        "settled_deg": float(np.mean(judged.settled_deg)),
        "images": len(posed.dataset),
        "images_used": len(posed.used),
        "flight_s": flown.flight_s,
        "wall_s": sum(seconds.values()),
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
    }
