"""The reconstruction job: from a run's pictures, or from any dataset, to a judged field.

Stages of a flight: ``live`` (train on what there is while pictures come in), ``refine`` (poses),
``train`` (the field that is judged, held-out pictures unseen), ``evaluate``, ``deliver`` (training
goes on with all pictures), ``results`` (mesh and film). A dataset on disk needs the last four only.
Stopped in any of them, it leaves behind what ``resume`` needs and delivers nothing half done.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel

from server.drafts import whole_file
from server.geometry.boxes import union
from server.jobs.kept_training import KeptTraining
from server.jobs.object_masks import cut_anew
from server.jobs.reports import FieldReports, keep_renderings, tell_share
from server.jobs.results import write_results
from server.jobs.spec import TEST_EVERY, JobSpec, JobStoppedError, Reporting
from server.jobs.worker import Reporter
from server.nerf.config import FieldConfig, TrainConfig, suited_configs
from server.nerf.dataset import Dataset, DatasetError, PosedFile, load_dataset, write_transforms
from server.nerf.flight import read_pictures
from server.nerf.hull import box_of_masks
from server.nerf.pose_config import PoseConfig
from server.nerf.poses import PosedPicture, RefinedPoses, refine_poses
from server.nerf.sightings import write_sightings
from server.nerf.training import StepReport, Trainer
from server.nerf.warm_up import warm_up

_LIVE_PICTURES = 4
_LIVE_SLICE_S = 4.0
# Where in the schedule every slice but the first begins: all levels of the encoding stay open.
_LIVE_PROGRESS = 0.35
_POLL_S = 0.25
# Delivery goes on from the judged field: the last part of the schedule, for a share of its time.
_DELIVER_FROM = 0.7
_DELIVER_SHARE = 0.25
_DELIVER_LEAST_S = 5.0


class ReconstructInput(BaseModel):
    """What is to be reconstructed.

    Attributes:
        source: A run folder that a flight fills, or a finished dataset.
        dataset: The folder.
        out: Folder for the results; the run folder itself when None.
        train_seconds: Training time of the judged field, None when ``steps`` is given.
        steps: Training steps instead.
        downscale: Divide picture sizes by this, None to fit the training size.
        object_only: Cut the object out of the pictures of a dataset by their masks.
        test_every: Pictures 0, n, 2n, ... are held out.
        backend: ``numba`` or ``torch``.
        mode: The capture's mode, None for a dataset.
        results: Also make mesh and film.
        resume: Go on where a reconstruction of the same was cut off.
        tell_known: Tell what is known of the object's surface while a flight is under way.
    """

    source: Literal["flight", "dataset"]
    dataset: Path
    out: Path | None = None
    train_seconds: float | None = None
    steps: int | None = None
    downscale: int | None = None
    object_only: bool = False
    test_every: int = TEST_EVERY
    backend: Literal["numba", "torch"] = "numba"
    mode: str | None = None
    results: bool = True
    resume: bool = False
    tell_known: bool = False


class _Stages:
    """Names the stage at work and keeps its seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begun_s = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(time.monotonic() - begun_s, 2)


def run(spec: JobSpec, reporter: Reporter) -> dict[str, Any]:
    """Reconstruct and return the result object; raises ValueError on bad input."""
    wanted = ReconstructInput.model_validate(spec.parameters)
    stages = _Stages()
    trusted: list[int] | None = None
    if wanted.source == "flight":
        trusted = _refined_before(wanted.dataset) if wanted.resume else None
        if trusted is None:
            if not wanted.resume:
                with stages.stage("live"):
                    _train_live(wanted, spec, reporter)
            with stages.stage("refine"):
                refined = refine_run(wanted.dataset, spec, reporter)
            trusted = [int(index) for index in np.flatnonzero(refined.refined)]
    dataset = load_dataset(
        wanted.dataset, downscale=wanted.downscale, object_only=wanted.object_only
    )
    out = wanted.out or wanted.dataset
    return _judge_and_deliver(dataset, trusted, out, wanted, spec, reporter, stages)


def _judge_and_deliver(
    dataset: Dataset,
    trusted: list[int] | None,
    out: Path,
    wanted: ReconstructInput,
    spec: JobSpec,
    reporter: Reporter,
    stages: _Stages,
) -> dict[str, Any]:
    held_out = list(range(0, len(dataset), wanted.test_every))
    shown = [i for i in range(len(dataset)) if i not in held_out]
    if trusted is not None and len(set(trusted) & set(shown)) >= _LIVE_PICTURES:
        shown = [i for i in shown if i in trusted]
    unseen = [i for i in range(len(dataset)) if i not in shown]
    with stages.stage("compile"):
        # Compiled code is kept, so this takes long only the first time; it is no training.
        _trainer(dataset, unseen, wanted, spec).run(steps=2)
    # Only now is it certain that there is something to train on and judge.
    out.mkdir(parents=True, exist_ok=True)
    kept = KeptTraining(out)
    trainer = kept.load(dataset, spec.threads) if wanted.resume else None
    resumed_at = 0.0 if trainer is None else _done(trainer, wanted)
    if trainer is None:
        trainer = _trainer(dataset, unseen, wanted, spec)
    kept.begin(wanted.model_dump(mode="json"), spec.seed)
    reports = FieldReports(trainer, reporter, out, images=len(shown))
    with stages.stage("train"):
        left_s, left_steps = _left(wanted, resumed_at)
        reports.begin("train", left_s, held_out)

        def on_step(step: StepReport) -> None:
            reports.on_step(step)
            kept.keep(trainer)

        trainer.run(
            left_s,
            left_steps,
            on_step,
            should_stop=reporter.should_stop,
            progress_from=resumed_at,
        )
        kept.keep(trainer, now=True)
    _go_on(reporter)
    samples_per_s = trainer.samples_per_s
    with stages.stage("evaluate"):
        reports.begin("evaluate", None, [])
        evaluation = trainer.evaluate(held_out, on_rendering=keep_renderings(out))
    metrics = evaluation.metrics
    reporter.emit("metrics", metrics=asdict(metrics))
    with stages.stage("deliver"):
        seconds = max(_DELIVER_LEAST_S, _DELIVER_SHARE * stages.seconds["train"])
        trainer.use_pictures(trusted if trusted else list(range(len(dataset))))
        reports.begin("deliver", seconds, [])
        trainer.run(
            seconds,
            None,
            reports.on_step,
            should_stop=reporter.should_stop,
            progress_from=_DELIVER_FROM,
        )
        _go_on(reporter)
        trainer.save(out / "checkpoint.npz")
        reports.show_orbit(width=640, height=480)
    result = {
        "run": str(out),
        "dataset": str(wanted.dataset),
        "mode": wanted.mode,
        "downscale": wanted.downscale,
        "object_only": wanted.object_only,
        "train_seconds": wanted.train_seconds,
        "seed": spec.seed,
        "resumed_at": round(resumed_at, 3),
        **asdict(metrics),
        "samples_per_s": round(samples_per_s, 1),
        "seconds": stages.seconds,
        "pictures": [asdict(score) for score in evaluation.pictures],
    }
    _write_whole(out / "metrics.json", result)
    if wanted.results:
        with stages.stage("results"):
            result["missing"] = write_results(trainer, out, reporter)
        _go_on(reporter)
        _write_whole(out / "metrics.json", result)
    kept.end()
    return result


def _go_on(reporter: Reporting) -> None:
    """Raise JobStoppedError if somebody asked for the end."""
    if reporter.should_stop():
        raise JobStoppedError("stopped; it can go on where it was")


def _done(trainer: Trainer, wanted: ReconstructInput) -> float:
    """Return the share of the wanted training that a resumed trainer has behind it."""
    return trainer.progress if wanted.steps is None else min(1.0, trainer.steps / wanted.steps)


def _left(wanted: ReconstructInput, done: float) -> tuple[float | None, int | None]:
    """Return seconds and steps that are left of the training when the share ``done`` is over."""
    seconds, steps = wanted.train_seconds, wanted.steps
    return (
        None if seconds is None else (1.0 - done) * seconds,
        None if steps is None else round((1.0 - done) * steps),
    )


def _refined_before(folder: Path) -> list[int] | None:
    """Return which pictures' poses were refined already, None if none were."""
    try:
        told = json.loads((folder / "poses.json").read_text())["pictures"]
        return [index for index, picture in enumerate(told) if picture["refined"]]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _write_whole(file: Path, about: dict[str, Any]) -> None:
    with whole_file(file) as stream:
        stream.write(json.dumps(about, indent=1).encode())


def _trainer(
    dataset: Dataset, held_out: list[int], wanted: ReconstructInput, spec: JobSpec
) -> Trainer:
    field, train = suited_configs(cut_out=dataset.cut_out, distances_known=dataset.distances_known)
    return Trainer(
        dataset,
        field,
        train,
        held_out=held_out,
        backend=wanted.backend,
        seed=spec.seed,
        threads=spec.threads,
    )


def _train_live(wanted: ReconstructInput, spec: JobSpec, reporter: Reporter) -> None:
    """Train on the pictures there are, with the flight's poses, until the flight is complete."""
    trainer: Trainer | None = None
    reports: FieldReports | None = None
    begun_s = time.monotonic()
    # One thread: drones are in the air.
    warm_up(threads=1)
    while not _complete(wanted.dataset):
        _go_on(reporter)
        if reporter.orphaned():
            raise JobStoppedError("the console ended before the flight did")
        count = sum(picture.still for picture in read_pictures(wanted.dataset))
        if count < _LIVE_PICTURES:
            time.sleep(_POLL_S)
            continue
        fresh = trainer is None
        if trainer is None or len(trainer.dataset) != count:
            dataset = load_dataset(wanted.dataset, downscale=wanted.downscale or 2)
            if trainer is None:
                trainer = Trainer(
                    dataset, FieldConfig(), TrainConfig(), held_out=[], seed=spec.seed, threads=1
                )
                reports = FieldReports(trainer, reporter, wanted.dataset, images=len(dataset))
                reports.begin("live", None, [], begun_s)
            else:
                trainer.take_in(dataset)
                assert reports is not None
                reports.images = len(dataset)
        assert reports is not None
        trainer.run(
            seconds=_LIVE_SLICE_S,
            on_progress=reports.on_step,
            should_stop=reporter.should_stop,
            progress_from=0.0 if fresh else _LIVE_PROGRESS,
        )
        if wanted.tell_known:
            reports.tell_known(spec.seed)


def refine_run(folder: Path, spec: JobSpec, reporter: Reporting) -> RefinedPoses:
    """Refine the poses of all stills and write them into ``transforms.json`` and ``poses.json``.

    Args:
        folder: A run folder that a flight has filled.
        spec: Threads and seed.
        reporter: Told how far it is; asked whether to stop.

    Returns:
        The refined poses of the stills alone.
    """
    flown = read_pictures(folder)
    before = load_dataset(folder, downscale=1)
    pictures = [
        PosedPicture(
            file=folder / picture.file,
            T_world_cam=picture.T_world_cam,
            sigma_m=picture.sigma_m,
            sigma_rad=picture.sigma_rad,
            still=picture.still,
            drone_id=picture.drone_id,
            at_s=picture.at_s,
            mask_file=None if picture.mask is None else folder / picture.mask,
        )
        for picture in flown
    ]
    tell = tell_share(reporter, "refine", len(pictures))
    listed = [picture for picture in flown if picture.still]
    calibrated = dict(zip((picture.drone_id for picture in listed), before.intrinsics, strict=True))
    poses = refine_poses(
        pictures,
        [calibrated.get(picture.drone_id, before.intrinsics[0]) for picture in flown],
        folder / "jobs" / "poses",
        PoseConfig(threads=spec.threads, seed=spec.seed),
        lambda _what, share: tell(share),
        reporter.should_stop,
    )
    _go_on(reporter)  # What was cut short must not be taken for refined.
    stills = np.array([picture.still for picture in pictures])
    T_world_cam, refined = poses.T_world_cam[stills], poses.refined[stills]
    sigma_m, sigma_rad = poses.sigma_m[stills], poses.sigma_rad[stills]
    cameras = tuple(camera for camera, p in zip(poses.intrinsics, flown, strict=True) if p.still)
    posed = replace(before, T_world_cam=T_world_cam, intrinsics=cameras)
    tell_masks = tell_share(reporter, "masks", len(listed))

    def on_mask(share: float) -> None:
        _go_on(reporter)
        tell_masks(share)

    posed, masks = cut_anew(folder, posed, listed, refined, sigma_m, sigma_rad, on_mask)
    object_box = before.object_box
    if object_box is not None:
        # It was found with the flight's poses, which the refined ones do not agree with entirely.
        found = box_of_masks(posed, object_box)
        # Thin parts are missing from some masks: what either knows of belongs to it.
        object_box = object_box if found is None else union((found, object_box))
    sightings = poses.sightings.of(np.flatnonzero(stills))
    write_sightings(folder, sightings)
    write_transforms(
        folder,
        [
            PosedFile(p.file, T, mask, camera)
            for p, T, mask, camera in zip(listed, T_world_cam, masks, cameras, strict=True)
        ],
        before.intrinsics[0],
        object_box,
        poses.floor_z,
    )
    about = {
        "message": poses.message,
        "reprojection_rms_px": poses.reprojection_rms_px,
        "pictures": [
            {
                "file": p.file,
                "refined": bool(done),
                "sigma_m": round(float(metres), 5),
                "sigma_deg": round(float(np.rad2deg(radians)), 4),
            }
            for p, done, metres, radians in zip(listed, refined, sigma_m, sigma_rad, strict=True)
        ],
    }
    (folder / "poses.json").write_text(json.dumps(about, indent=1))
    reporter.emit(
        "refined", T_world_cam=T_world_cam.tolist(), refined=refined.tolist(), message=poses.message
    )
    return RefinedPoses(
        T_world_cam,
        refined,
        sigma_m,
        sigma_rad,
        cameras,
        poses.reprojection_rms_px,
        sightings,
        poses.floor_z,
        poses.message,
    )


def _complete(folder: Path) -> bool:
    """Return whether the mission has said that no picture follows."""
    try:
        return bool(json.loads((folder / "capture.json").read_text())["complete"])
    except (OSError, ValueError, KeyError) as error:
        raise DatasetError(f"{folder} is no run folder: {error}") from error
