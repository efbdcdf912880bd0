"""``dronerf bench poses``: how well cameras are known in flight, and after it.

Every flight is a whole capture in virtual time, flown by the mission that flies real drones, whose
eyes look at the default room drawn picture by picture (``drawn_video``); three of each scene of
ours, one of each other mesh. Its kept pictures are then drawn again at twice the size at the true
poses, taken by each drone's own imperfect camera, and sent through its video coding
(``poses_pictures``). The keys with ``flight`` judge what the mission believed, those without what
``server.nerf.poses`` makes of the pictures. Errors are those of the stills after the similarity
that fits best (BARF's protocol); ``scale_error`` is what the refined scale is wrong by.

The three PSNR come from fields trained for the same number of steps on the same pictures
(``poses_fields``); those with true poses also know the true lenses. They and ``from_noise``, which
take the longest, are of the first flight of each scene of ours.

``from_noise_*`` is the refinement of the same pictures when every camera, each on its own, is
believed 8 degrees and 15 cm wrong. ``peer_*`` is plain pycolmap on the stills alone.
``sigma_ratio_*`` is the root mean square of the errors over what the result says about itself: 1 is
honest.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.bench.drawn_video import fly_drawn_capture
from server.bench.options import Figures, Options, each_scene, kept_part
from server.bench.poses_fields import psnr_with
from server.bench.poses_figures import percentiles, pose_errors
from server.bench.poses_flight import FlownCapture
from server.bench.poses_peer import plain_poses
from server.bench.poses_photographs import photograph_figures
from server.bench.poses_pictures import draw_pictures
from server.bench.scenes import named_and_shared_scenes
from server.nerf.flight import read_pictures
from server.nerf.pose_config import PoseConfig
from server.nerf.poses import PosedPicture, RefinedPoses, refine_poses
from server.sim.scenes.catalogue import SCENES as NAMED

Array = NDArray[np.float64]

SCENES = named_and_shared_scenes()
QUICK_SCENES = ("robot_dog", "guitar")
_FLIGHTS = 3
_STEPS, _QUICK_STEPS = 1200, 400
_PICTURES = 24
_NOISE_RAD, _NOISE_M = np.deg2rad(8.0), 0.15
_PERCENTILES = {
    "flight_rotation_deg": (3, 50, 95),
    "flight_translation_m": (4, 50, 95),
    "rotation_deg": (3, 50, 95),
    "translation_m": (4, 50, 95),
    "from_noise_rotation_deg": (3, 50, 95),
    "from_noise_translation_m": (4, 50, 95),
    "peer_rotation_deg": (3, 50),
    "peer_translation_m": (4, 50),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """A capture with its truth, arrays over all pictures."""

    capture: FlownCapture
    pictures: list[PosedPicture]
    T_true: Array
    still: NDArray[np.bool_]


def run(options: Options) -> Figures:
    """Measure every scene, and the photographs of the test data where there are any."""
    cv2.setNumThreads(1)
    scenes = each_scene("poses", options, lambda scene: _measure(scene, options))
    overall = _summary([sample for part in scenes.values() for sample in part["samples"]])
    photographs = photograph_figures(options.seed, options.threads)
    if photographs is not None:
        overall["photographs"] = photographs
    return Figures(scenes, overall)


def _measure(scene: str, options: Options) -> dict[str, Any]:
    flights = _FLIGHTS if scene in NAMED and not options.quick else 1
    samples = [
        kept_part(
            f"poses-{Path(scene).name}-{options.seed}-flight-{k}",
            options,
            lambda k=k: _measure_flight(scene, k, options),
        )
        for k in range(flights)
    ]
    return {**_summary(samples), "samples": samples}


def _measure_flight(scene: str, number: int, options: Options) -> dict[str, Any]:
    """Return the figures and errors of a scene's first flight, or of a further one."""
    seed = options.seed + number
    with tempfile.TemporaryDirectory(prefix="dronerf-poses-") as name:
        try:
            capture = fly_drawn_capture(scene, seed, _PICTURES, Path(name))
        except RuntimeError as error:
            print(f"poses: {scene}: {error}", file=sys.stderr, flush=True)
            return {"seed": seed, "failed": str(error)}
        draw_pictures(capture)
        judged = _judged(capture)
        begun_s, begun_cpu_s = time.monotonic(), time.process_time()
        refined = _refined(judged.pictures, capture, options)
        seconds, cpu_seconds = time.monotonic() - begun_s, time.process_time() - begun_cpu_s
        sample: dict[str, Any] = {
            "seed": seed,
            "pictures": len(judged.pictures),
            "stills": int(judged.still.sum()),
            "refined": int((refined.refined & judged.still).sum()),
            "message": refined.message,
            "seconds": round(seconds, 1),
            "cpu_seconds": round(cpu_seconds, 1),
        }
        sample |= _errors_of(judged, refined)
        sample |= _peer(judged, options)
        if number == 0 and scene in NAMED:
            sample |= _from_noise(judged, options)
            sample |= _fields(judged, refined, options)
    return sample


def _judged(capture: FlownCapture) -> _Judged:
    flown = read_pictures(capture.run)
    pictures = [
        PosedPicture(
            file=capture.run / p.file,
            T_world_cam=p.T_world_cam,
            sigma_m=p.sigma_m,
            sigma_rad=p.sigma_rad,
            still=p.still,
            drone_id=p.drone_id,
            at_s=p.at_s,
            mask_file=None if p.mask is None else capture.run / p.mask,
        )
        for p in flown
    ]
    T_true = np.stack([view.T_world_cam for view in capture.truth])
    return _Judged(capture, pictures, T_true, np.array([p.still for p in flown], bool))


def _refined(pictures: list[PosedPicture], capture: FlownCapture, options: Options) -> RefinedPoses:
    return refine_poses(
        pictures,
        capture.sim.camera.calibrated,
        capture.run / "jobs" / "poses",
        PoseConfig(threads=options.threads, seed=options.seed),
        lambda _step, _share: None,
        lambda: False,
    )


def _errors_of(judged: _Judged, refined: RefinedPoses) -> dict[str, Any]:
    """Return the errors of the stills, in flight and refined."""
    still, T_true = judged.still, judged.T_true[judged.still]
    believed = np.stack([p.T_world_cam for p in judged.pictures])[still]
    flight = pose_errors(believed, T_true)
    after = pose_errors(refined.T_world_cam[still], T_true)
    # A standard deviation per axis speaks of a third of the squared distance.
    ratio_m = after.translation_m / np.sqrt(3.0) / refined.sigma_m[still]
    ratio_rad = np.deg2rad(after.rotation_deg) / np.sqrt(3.0) / refined.sigma_rad[still]
    return {
        "flight_rotation_deg": flight.rotation_deg.tolist(),
        "flight_translation_m": flight.translation_m.tolist(),
        "rotation_deg": after.rotation_deg.tolist(),
        "translation_m": after.translation_m.tolist(),
        "flight_scale_error": round(flight.scale_error, 5),
        "scale_error": round(after.scale_error, 5),
        "sigma_ratio_translation": round(float(np.sqrt((ratio_m**2).mean())), 3),
        "sigma_ratio_rotation": round(float(np.sqrt((ratio_rad**2).mean())), 3),
    }


def _from_noise(judged: _Judged, options: Options) -> dict[str, Any]:
    """Return the refined errors of beliefs that are random about the truth."""
    if options.quick:
        return {}
    rng = np.random.default_rng([options.seed, 9])
    noisy = [
        replace(picture, T_world_cam=_disturbed(T, rng), sigma_m=_NOISE_M, sigma_rad=_NOISE_RAD)
        for picture, T in zip(judged.pictures, judged.T_true, strict=True)
    ]
    refined = _refined(noisy, judged.capture, options)
    errors = pose_errors(refined.T_world_cam[judged.still], judged.T_true[judged.still])
    return {
        "from_noise_rotation_deg": errors.rotation_deg.tolist(),
        "from_noise_translation_m": errors.translation_m.tolist(),
    }


def _disturbed(T_world_cam: Array, rng: np.random.Generator) -> Array:
    """Return a pose turned and moved by the noise's length into random directions."""
    turn, move = rng.normal(size=(2, 3))
    out = T_world_cam.copy()
    R = Rotation.from_rotvec(turn / np.linalg.norm(turn) * _NOISE_RAD).as_matrix()
    out[:3, :3] = R @ out[:3, :3]
    out[:3, 3] += move / np.linalg.norm(move) * _NOISE_M
    return out


def _peer(judged: _Judged, options: Options) -> dict[str, Any]:
    files = [p.file for p in judged.pictures if p.still]
    begun_s = time.process_time()
    poses = plain_poses(files, judged.capture.sim.camera.calibrated, options.threads)
    figures: dict[str, Any] = {
        "peer_registered": len(poses.indices),
        "peer_cpu_seconds": round(time.process_time() - begun_s, 1),
        "peer_rotation_deg": [],
        "peer_translation_m": [],
    }
    if len(poses.indices) >= 3:
        errors = pose_errors(poses.T_model_cam, judged.T_true[judged.still][poses.indices])
        figures["peer_rotation_deg"] = errors.rotation_deg.tolist()
        figures["peer_translation_m"] = errors.translation_m.tolist()
    return figures


def _fields(judged: _Judged, refined: RefinedPoses, options: Options) -> dict[str, Any]:
    """Return the PSNR of fields with true, in-flight and refined poses."""
    still = np.flatnonzero(judged.still)
    T_true = judged.T_true[still]
    believed = np.stack([judged.pictures[i].T_world_cam for i in still])
    lenses = tuple(judged.capture.truth[i].lens for i in still)
    steps = _QUICK_STEPS if options.quick else _STEPS
    cases = {
        "true_poses": (T_true, lenses),
        "flight": (believed, None),
        "refined": (refined.T_world_cam[still], tuple(refined.intrinsics[i] for i in still)),
    }
    return {
        f"psnr_db_{name}": round(
            psnr_with(judged.capture.run, T, cameras, T_true, steps, options.seed, options.threads),
            3,
        )
        for name, (T, cameras) in cases.items()
    }


# Figures ------------------------------------------------------------------------------------------


def _summary(samples: list[dict[str, Any]]) -> dict[str, Any]:
    """Return percentiles over all stills of the flights that took pictures, means of the rest."""
    figures: dict[str, Any] = {"flights": len(samples)}
    samples = [sample for sample in samples if "failed" not in sample]
    figures["failed_flights"] = figures["flights"] - len(samples)
    if not samples:
        return figures
    for name, (digits, *shares) in _PERCENTILES.items():
        values = [value for sample in samples for value in sample.get(name, [])]
        figures |= percentiles(name, values, digits, *shares)
    for name in ("stills", "refined", "peer_registered"):
        figures[name] = sum(sample[name] for sample in samples)
    # Not every flight has every figure.
    for name in dict.fromkeys(name for sample in samples for name in sample):
        values = [sample[name] for sample in samples if name in sample]
        if name not in figures and all(isinstance(value, float) for value in values):
            figures[name] = round(float(np.mean(values)), 5)
    figures["sigma_ratio_worst"] = max(
        max(sample["sigma_ratio_translation"], sample["sigma_ratio_rotation"]) for sample in samples
    )
    return figures
