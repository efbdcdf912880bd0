"""``dronerf bench regions``: the found boxes against the true silhouettes' boxes.

Every pose is judged by a tracker of its own that sees three pictures of it, 33 ms apart, as a
hovering drone takes them, with what the mission would expect there: a third of the poses before the
seed geometry is known (12 cm, 8 degrees wrong), a third just after (5 cm, 2.5 degrees), a third
later on the way to a viewpoint, some of them high up (20 cm, 6 degrees). The same pictures
without any expectation are reported beside it, and so is ``skimage.feature.blob_log``, whose
largest blob's square stands for a box as the paper has it.

The keys without a suffix are those with an expectation. A missed object counts as an IoU of 0; an
object is detected when its box holds the true box's centre and their IoU is above 0.1.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.feature import blob_log

from server.bench.options import Figures, Options, each_scene
from server.bench.region_course import KINDS, Shot, disturbed, shots
from server.bench.region_sheet import worst_sheet
from server.bench.scenes import named_and_shared_scenes
from server.bench.seed_figures import seed_figures
from server.sim.scenes.catalogue import SCENES as NAMED_SCENES
from server.sim.scenes.catalogue import load_object
from server.stages import Frame
from server.vision.config import RegionConfig
from server.vision.prior import RegionPrior
from server.vision.region import RegionTracker

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


SCENES = named_and_shared_scenes()
QUICK_SCENES = tuple(NAMED_SCENES)

_ROOMS, _QUICK_ROOMS, _POSES = 8, 4, 10
_LOOKS, _FRAME_S = 3, 1.0 / 30.0
_STEADY_FRAMES = 90
_FULL_SIZE_PER_SCENE = 3
_EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0001)
_DETECTED_IOU = 0.1
_SWAY_PX = (14.0, 8.0)
# The search's own scales, working pixels.
_WORK_SCALE, _PEER_SIGMAS = 4, (4, 48)
_TALLIES = (*KINDS, "without_prior", "peer", "peer_full_size")


@dataclass(frozen=True, slots=True)
class _Reduced:
    """A decoded picture whose reduced form is ready, as the decoder hands it to the search."""

    whole_bgr: Image
    reduced: Image

    @property
    def size_px(self) -> tuple[int, int]:
        return self.whole_bgr.shape[1], self.whole_bgr.shape[0]

    def bgr(self) -> Image:
        return self.whole_bgr

    def reduced_bgr(self, width_px: int, height_px: int) -> Image:
        if (height_px, width_px) == self.reduced.shape[:2]:
            return self.reduced
        size = (width_px, height_px)
        small = cv2.resize(self.whole_bgr, size, interpolation=cv2.INTER_AREA)
        return small.astype(np.uint8, copy=False)


@dataclass(slots=True)
class _Tally:
    """What one way of searching gave."""

    ious: list[float] = field(default_factory=list)
    centroid_errors_px: list[float] = field(default_factory=list)
    detected: int = 0
    reports: list[tuple[float, bool]] = field(default_factory=list)
    empty: int = 0
    false_positives: int = 0

    def count(self, truth_px: Array | None, box_px: Array | None, confidence: float) -> float:
        """Count one picture and return its IoU."""
        iou = 0.0 if truth_px is None or box_px is None else box_iou(truth_px, box_px)
        if box_px is not None:
            self.reports.append((confidence, iou >= 0.5))
        if truth_px is None:
            self.empty += 1
            self.false_positives += box_px is not None
            return iou
        self.ious.append(iou)
        if box_px is not None:
            off = (truth_px[:2] + truth_px[2:] - box_px[:2] - box_px[2:]) / 2.0
            self.centroid_errors_px.append(float(np.hypot(*off)))
            centre = (truth_px[:2] + truth_px[2:]) / 2.0
            holds = (box_px[:2] <= centre).all() and (centre <= box_px[2:]).all()
            self.detected += bool(holds and iou > _DETECTED_IOU)
        return iou


def box_iou(a: Array, b: Array) -> float:
    """Return intersection over union of two boxes ``(4,)``."""
    both = float(np.prod(np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0)))
    return both / (float(np.prod(a[2:] - a[:2])) + float(np.prod(b[2:] - b[:2])) - both)


def run(options: Options) -> Figures:
    """Measure every scene."""
    cv2.setNumThreads(1)
    rooms = _QUICK_ROOMS if options.quick else _ROOMS
    scenes = each_scene("regions", options, lambda scene: _measure(scene, rooms, options))
    return Figures(scenes, _overall(list(scenes.values())))


def _measure(scene: str, rooms: int, options: Options) -> dict[str, Any]:
    config = RegionConfig()
    rng = np.random.default_rng((options.seed, 1))
    tallies = {name: _Tally() for name in _TALLIES}
    steady: list[float] = []
    key_s: list[float] = []
    peer_s: list[float] = []
    peer_full_s: list[float] = []
    tiles: list[tuple[float, Shot, Array | None]] = []
    room = -1
    for shot in shots(load_object(scene), options.seed, rooms, _POSES):
        reduced = _reduced(shot.image_bgr, config)
        box, confidence, spent_s = _look(shot, reduced, shot.prior, config)
        key_s.append(spent_s)
        iou = tallies[shot.kind].count(shot.truth_px, box, confidence)
        if shot.truth_px is not None:
            tiles.append((iou, shot, box))
        tallies["without_prior"].count(shot.truth_px, *_look(shot, reduced, None, config)[:2])
        began_s = time.process_time()
        peer_box = _peer(reduced, config.work_scale)
        peer_s.append(time.process_time() - began_s)
        tallies["peer"].count(shot.truth_px, peer_box, 0.0)
        if len(peer_full_s) < _FULL_SIZE_PER_SCENE and shot.truth_px is not None:
            began_s = time.process_time()
            full_size_box = _peer(shot.image_bgr, 1)
            peer_full_s.append(time.process_time() - began_s)
            tallies["peer_full_size"].count(shot.truth_px, full_size_box, 0.0)
        if shot.room != room and shot.truth_px is not None:
            room = shot.room
            steady.append(_steady_s(shot, config, rng))
    if options.out is not None:
        picture = worst_sheet(tiles)
        cv2.imwrite(str(options.out / f"regions-{Path(scene).name}-worst.png"), picture)
    times = {"steady_s": steady, "key_s": key_s, "peer_s": peer_s, "peer_full_s": peer_full_s}
    figures = _scene_figures(tallies, times)
    return {**figures, **seed_figures(scene, options.seed, options.quick)}


def _reduced(image_bgr: Image, config: RegionConfig) -> Image:
    height, width = image_bgr.shape[:2]
    size = (width // config.work_scale, height // config.work_scale)
    return cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def _look(
    shot: Shot, reduced: Image, prior: RegionPrior | None, config: RegionConfig
) -> tuple[Array | None, float, float]:
    """Return box and confidence that a fresh tracker gives after a few pictures.

    Third the CPU seconds of its first picture, which is searched in full.
    """
    tracker = RegionTracker(config)
    found, key_s = None, 0.0
    for k in range(_LOOKS):
        picture = _Reduced(shot.image_bgr, reduced)
        began_s = time.process_time()
        found = tracker.update(Frame("drone", k, k * _FRAME_S, picture, False), prior)
        if k == 0:
            key_s = time.process_time() - began_s
    if found is None:
        return None, 0.0, key_s
    return found[1].xyxy_px, found[1].confidence, key_s


def _steady_s(shot: Shot, config: RegionConfig, rng: np.random.Generator) -> float:
    """Return CPU seconds per picture of a swaying drone at 30 pictures per second."""
    tracker = RegionTracker(config)
    height, width = shot.image_bgr.shape[:2]
    spent_s = 0.0
    for k in range(_STEADY_FRAMES):
        at_s = k * _FRAME_S
        dx, dy = _SWAY_PX[0] * np.sin(2.0 * at_s), _SWAY_PX[1] * np.sin(3.1 * at_s)
        move = np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]])
        moved = cv2.warpAffine(
            shot.image_bgr, move, (width, height), borderMode=cv2.BORDER_REFLECT
        ).astype(np.uint8, copy=False)
        reduced = disturbed(_reduced(moved, config), rng, exposure=False)
        frame = Frame("drone", k, at_s, _Reduced(moved, reduced), False)
        began_s = time.process_time()
        tracker.update(frame, shot.prior)
        spent_s += time.process_time() - began_s
    return spent_s / _STEADY_FRAMES


def _peer(image_bgr: Image, scale: int) -> Array | None:
    """Return the square around the largest of scikit-image's blobs, full-picture pixels."""
    grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY).astype(np.float32) / 255.0
    # It finds bright blobs alone; the object may as well be dark.
    apart = np.abs(grey - np.median(grey))
    low, high = (_WORK_SCALE // scale * sigma for sigma in _PEER_SIGMAS)
    blobs = blob_log(
        apart, min_sigma=low, max_sigma=high, num_sigma=12, log_scale=True, threshold=0.05
    )
    if len(blobs) == 0:
        return None
    y, x, sigma = blobs[np.argmax(blobs[:, 2])]
    radius = math.sqrt(2.0) * sigma
    box = (np.array([x - radius, y - radius, x + radius, y + radius]) + 0.5) * scale - 0.5
    height, width = image_bgr.shape[:2]
    limits = np.array([width, height, width, height]) * scale - 0.5
    return np.clip(box, -0.5, limits)


# Figures ------------------------------------------------------------------------------------------


def _scene_figures(tallies: dict[str, _Tally], times: dict[str, list[float]]) -> dict[str, Any]:
    raw = {
        name: {
            "ious": tally.ious,
            "centroid_errors_px": tally.centroid_errors_px,
            "detected": tally.detected,
            "reports": tally.reports,
            "empty": tally.empty,
            "false_positives": tally.false_positives,
        }
        for name, tally in tallies.items()
    }
    samples = {**raw, "times": times}
    return {**_summary(samples), "samples": samples}


def _overall(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the figures over all scenes, samples pooled."""
    pooled: dict[str, Any] = {}
    for part in parts:
        for name, values in part["samples"].items():
            into = pooled.setdefault(name, {})
            for key, value in values.items():
                into[key] = into[key] + value if key in into else value
    seed_keys = [key for key in parts[0] if key.startswith("seed_")]
    means = {key: round(_mean([part[key] for part in parts]), 4) for key in seed_keys}
    return {**_summary(pooled), **means}


def _summary(samples: dict[str, Any]) -> dict[str, Any]:
    # Lists are joined and numbers added.
    start, seeded, under_way = (samples[kind] for kind in KINDS)
    mission = {key: start[key] + seeded[key] + under_way[key] for key in start}
    figures: dict[str, Any] = {**_judged(mission)}
    figures["ms_per_frame"] = round(1e3 * _mean(samples["times"]["steady_s"]), 3)
    figures["key_ms_per_frame"] = round(1e3 * _mean(samples["times"]["key_s"]), 2)
    figures["peer_iou_mean"] = round(_mean(samples["peer"]["ious"]), 4)
    figures["peer_ms_per_frame"] = round(1e3 * _mean(samples["times"]["peer_s"]), 2)
    figures["peer_full_size_iou_mean"] = round(_mean(samples["peer_full_size"]["ious"]), 4)
    figures["peer_full_size_ms_per_frame"] = round(1e3 * _mean(samples["times"]["peer_full_s"]), 1)
    for size in ("peer", "peer_full_size"):
        ratio = figures[f"{size}_ms_per_frame"] / max(figures["ms_per_frame"], 1e-9)
        figures[f"{size}_time_ratio"] = round(ratio, 1)
    for name in (*KINDS, "without_prior"):
        for key, value in _judged(samples[name]).items():
            if key != "calibration":
                figures[f"{key}_{name}"] = value
    return figures


def _judged(tally: dict[str, Any]) -> dict[str, Any]:
    ious = tally["ious"]
    errors = tally["centroid_errors_px"]
    return {
        "frames": len(ious),
        "detected": round(tally["detected"] / max(len(ious), 1), 4),
        "iou_mean": round(_mean(ious), 4),
        "iou_p10": round(float(np.percentile(ious, 10)), 4) if ious else 0.0,
        "centroid_error_px_p95": round(float(np.percentile(errors, 95)), 2) if errors else 0.0,
        "empty_frames": tally["empty"],
        "false_positives": tally["false_positives"],
        "calibration": _calibration(tally["reports"]),
    }


def _calibration(reports: Iterable[Sequence[Any]]) -> list[dict[str, float]]:
    """Return, for ranges of confidence, what was said and how often the IoU was 0.5 or better."""
    pairs = np.array([(float(said), float(held)) for said, held in reports]).reshape(-1, 2)
    rows = []
    for low, high in itertools.pairwise(_EDGES):
        part = pairs[(pairs[:, 0] >= low) & (pairs[:, 0] < high)]
        if len(part):
            said, held = part.mean(axis=0)
            rows.append({"boxes": len(part), "said": round(said, 3), "held": round(held, 3)})
    return rows


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else 0.0
