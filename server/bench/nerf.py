"""``dronerf bench nerf``: the field alone, on perfect pictures with true poses.

24 even views of the upper hemisphere, 400x400, white background; 20 other even views held out.
Time spent on evaluation is not counted; compiling is not counted either and stated as
``cold_start_s``. The torch path runs in the same process on the same pictures for a few steps.
With ``--ablations`` each switch of the training is put back in turn instead (``nerf_switches``).
"""

from __future__ import annotations

import resource
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from server.bench.nerf_pictures import FEW_VIEWS, HELD_OUT_VIEWS, TRAINING_VIEWS, bench_dataset
from server.bench.nerf_switches import mean_switches, switches
from server.bench.options import Figures, Options, each_scene
from server.bench.scenes import named_and_shared_scenes
from server.nerf.config import suited_configs
from server.nerf.dataset import Dataset
from server.nerf.preview import render_preview
from server.nerf.training import Trainer

SCENES = named_and_shared_scenes()
QUICK_SCENES = ("robot_dog", "recycle_bin")
_MARKS_S = (10.0, 30.0, 60.0)
_REFERENCE_STEPS = 2


def run(options: Options) -> Figures:
    """Return the figures of every scene, their means, and the largest peak of memory."""
    if options.ablations:
        told = each_scene(
            "nerf-switches",
            options,
            lambda scene: switches(scene, options.seed, options.threads),
        )
        return Figures(told, mean_switches(told))
    parts = each_scene(
        "nerf",
        options,
        lambda scene: measure(scene, options.seed, options.threads, options.out),
    )
    keys = next(iter(parts.values())).keys()
    overall = {
        key: round(float(np.mean([part[key] for part in parts.values()])), 3) for key in keys
    }
    overall["peak_memory_mb"] = max(part["peak_memory_mb"] for part in parts.values())
    return Figures(parts, overall)


def measure(scene: str, seed: int, threads: int, out: Path | None) -> dict[str, Any]:
    """Return the figures of one scene; pictures go to ``out`` when it is given."""
    dataset = bench_dataset(scene)
    held_out = list(range(TRAINING_VIEWS, TRAINING_VIEWS + HELD_OUT_VIEWS))
    begun_s = time.monotonic()
    _trainer(dataset, held_out, seed, threads).run(steps=2)
    result: dict[str, Any] = {"cold_start_s": round(time.monotonic() - begun_s, 2)}
    for mark_s in _MARKS_S:
        # Each mark is a run of its own: the schedule of a run ends with a settled field.
        trainer = _trainer(dataset, held_out, seed, threads)
        trainer.run(seconds=mark_s)
        metrics = trainer.evaluate(held_out).metrics
        result[f"psnr_db_{mark_s:.0f}s"] = round(metrics.psnr_db, 3)
        result["samples_per_s"] = round(trainer.samples_per_s, 1)
        if mark_s == _MARKS_S[-1]:
            result["ssim_60s"] = round(metrics.ssim, 4)
            result["preview_ms"] = _preview_ms(trainer)
            if out is not None:
                _write_comparison(trainer, held_out[:4], out / f"{Path(scene).name}.png")
    few = [index * TRAINING_VIEWS // FEW_VIEWS for index in range(FEW_VIEWS)]
    unseen = [index for index in range(len(dataset)) if index not in few]
    trainer = _trainer(dataset, unseen, seed, threads)
    trainer.run(seconds=_MARKS_S[-1])
    result["psnr_db_8_views"] = round(trainer.evaluate(held_out).metrics.psnr_db, 3)
    reference = _trainer(dataset, held_out, seed, threads, backend="torch")
    reference.run(steps=_REFERENCE_STEPS)
    result["reference_samples_per_s"] = round(reference.samples_per_s, 1)
    result["ratio"] = round(result["samples_per_s"] / reference.samples_per_s, 2)
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result["peak_memory_mb"] = round(peak_kb / 1024.0, 1)
    return result


def _trainer(
    dataset: Dataset, held_out: list[int], seed: int, threads: int, backend: Any = "numba"
) -> Trainer:
    field, train = suited_configs(cut_out=dataset.cut_out)
    return Trainer(
        dataset,
        field,
        train,
        held_out=held_out,
        backend=backend,
        seed=seed,
        threads=threads,
    )


def _preview_ms(trainer: Trainer) -> float:
    times = []
    for turn in (0.1, 0.4, 0.7):
        begun_s = time.monotonic()
        render_preview(trainer, turn)
        times.append(time.monotonic() - begun_s)
    return round(1e3 * float(np.median(times)), 1)


def _write_comparison(trainer: Trainer, indices: list[int], path: Path) -> None:
    """Write truth above rendering for some held-out views."""
    path.parent.mkdir(parents=True, exist_ok=True)
    dataset = trainer.dataset
    shown = [
        np.clip(trainer.render(dataset.intrinsics[i], dataset.T_world_cam[i]).rgb, 0, 1) * 255.0
        for i in indices
    ]
    truth = np.concatenate([dataset.images[i] for i in indices], axis=1)
    sheet = np.concatenate([truth, np.concatenate(shown, axis=1).astype(np.uint8)])
    cv2.imwrite(str(path), sheet[:, :, ::-1])
