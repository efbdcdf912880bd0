"""``dronerf train``, ``render`` and ``export``: fields from a shell.

Each is a job of the worker program, so that nothing here waits for torch to load.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from server.app import StartError, check_runs, job_place, job_runner
from server.jobs.local import LocalRunner
from server.jobs.runner import JobFailedError, JobRunner
from server.jobs.spec import TEST_EVERY, JobSpec, Kind
from server.jobs.unfinished import unfinished
from server.settings import Settings, load_settings
from server.store.runs import run_id
from server.terminal import AddCommand, TrainingBar, count, metrics_table, seconds, seed

_FORMATS = ("glb", "ply", "points", "colmap", "transforms")


def add_field_commands(commands: Any, add: AddCommand) -> None:
    """Add ``train``, ``render`` and ``export`` to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "train", run_train, "train on any folder with transforms.json")
    part.add_argument("dataset", type=Path, help="folder with transforms.json")
    part.add_argument(
        "--resume",
        action="store_true",
        help="the folder is a run whose capture or training was cut off: go on there, as it was"
        " started; other options have no effect",
    )
    length = part.add_mutually_exclusive_group()
    length.add_argument("--seconds", type=seconds, help="training time (60)")
    length.add_argument("--steps", type=count, help="training steps instead")
    part.add_argument("--downscale", type=count, help="divide picture sizes by this")
    part.add_argument(
        "--object-only",
        action="store_true",
        help="learn only what the masks show; pictures transparent around it need no flag",
    )
    part.add_argument(
        "--test-every", type=count, default=TEST_EVERY, help=f"hold out every n-th ({TEST_EVERY})"
    )
    part.add_argument(
        "--backend",
        choices=("numba", "torch"),
        default="numba",
        help="fast kernels, or the slow definition they are checked against (numba)",
    )
    part.add_argument(
        "--field-only",
        action="store_true",
        help="only the field and its figures: no mesh.glb, no orbit.mp4",
    )
    part.add_argument("--seed", type=seed, default=0, help="seed of everything random (0)")
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")

    part = add(commands, "render", run_render, "a film once round the object of a finished run")
    part.add_argument("run", type=Path, help="the run folder")
    part.add_argument("--out", type=Path, help="the film (orbit.mp4 in the run folder)")
    part.add_argument("--seconds", type=seconds, default=4.0, help="its length (4)")
    part.add_argument("--fps", type=count, default=15, help="pictures per second (15)")
    part.add_argument(
        "--room", action="store_true", help="all that there is, not the object alone before white"
    )
    part.add_argument("--size", type=_size, default=(400, 300), help="WIDTHxHEIGHT (400x300)")
    part.add_argument(
        "--pictures",
        type=Path,
        metavar="FOLDER",
        help="no film: each photograph beside what the field shows from there",
    )
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")

    part = add(commands, "export", run_export, "a finished run as other programs open it")
    part.add_argument("run", type=Path, help="the run folder")
    part.add_argument(
        "--format",
        choices=_FORMATS,
        default="glb",
        help="glb, ply: the object's mesh with colours; points: its surface as points; colmap: a"
        " model with cameras, poses and points; transforms: pictures and transforms.json (glb)",
    )
    part.add_argument("--out", type=Path, help="file or folder (in the run folder, named by kind)")
    part.add_argument("--cells", type=_cells, default=160, help="fineness of the mesh (160)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_train(arguments: argparse.Namespace) -> int:
    """Train a field on a folder with transforms.json and judge it on held-out pictures."""
    settings = load_settings(runs=arguments.runs)
    check_runs(settings.runs)
    if arguments.resume:
        try:
            parameters, started_with = unfinished(arguments.dataset.resolve())
        except ValueError as error:
            raise StartError(str(error)) from error
        return asyncio.run(_train(parameters, arguments, started_with, settings))
    if arguments.seconds is None and arguments.steps is None:
        arguments.seconds = 60.0
    # A sweep begins several in the same second.
    name = f"train {arguments.dataset.name}" + (f" seed {arguments.seed}" if arguments.seed else "")
    parameters = {
        "source": "dataset",
        "dataset": str(arguments.dataset.resolve()),
        # The worker makes this folder once the dataset has turned out to be readable.
        "out": str(settings.runs.resolve() / run_id(name)),
        "train_seconds": arguments.seconds,
        "steps": arguments.steps,
        "downscale": arguments.downscale,
        "object_only": arguments.object_only,
        "test_every": arguments.test_every,
        "backend": arguments.backend,
        "results": not arguments.field_only,
    }
    return asyncio.run(_train(parameters, arguments, arguments.seed, settings))


def run_render(arguments: argparse.Namespace) -> int:
    """Film the field of a run, or show it beside its pictures."""
    width, height = arguments.size
    parameters = {
        "run": str(arguments.run.resolve()),
        "film": None if arguments.out is None else str(arguments.out.resolve()),
        "pictures": None if arguments.pictures is None else str(arguments.pictures.resolve()),
        "room": arguments.room,
        "seconds": arguments.seconds,
        "fps": arguments.fps,
        "width": width,
        "height": height,
    }
    return asyncio.run(_work("render", parameters, arguments, LocalRunner()))


def run_export(arguments: argparse.Namespace) -> int:
    """Write a run in a format of other programs."""
    parameters = {
        "run": str(arguments.run.resolve()),
        "format": arguments.format,
        "out": None if arguments.out is None else str(arguments.out.resolve()),
        "cells": arguments.cells,
    }
    return asyncio.run(_work("export", parameters, arguments, LocalRunner()))


async def _train(
    parameters: dict[str, Any], arguments: argparse.Namespace, seed: int, settings: Settings
) -> int:
    """Train where the settings say, this machine or a cluster."""
    place = job_place(settings)
    async with job_runner(settings) as runner:
        return await _work("reconstruct", parameters, arguments, runner, seed=seed, place=place)


async def _work(
    kind: Kind,
    parameters: dict[str, Any],
    arguments: argparse.Namespace,
    runner: JobRunner,
    *,
    seed: int = 0,
    place: Path | None = None,
) -> int:
    """Have a job done, show its progress, print its result; return the exit code."""
    spec = JobSpec(kind, parameters, seed=seed, threads=os.cpu_count() or 1, niceness=0)
    started_s = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=".dronerf-job-", dir=place) as folder:
        job = await runner.submit(spec, Path(folder))
        bar = TrainingBar()
        done: dict[str, Any] = {}
        try:
            async for event in job.events():
                bar.show(event)
                done = event
        except JobFailedError as error:
            bar.close()
            print(f"dronerf: {error}", file=sys.stderr)
            return 2 if error.bad_input else 1
        finally:
            await job.cancel()
        bar.close()
    result = {key: value for key, value in done.items() if key not in ("event", "at_s")}
    result["wall_s"] = round(time.monotonic() - started_s, 1)
    if arguments.json:
        print(json.dumps(result))
    else:
        print(metrics_table(result) if kind == "reconstruct" else result["file"])
    return 0


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, as 640x480")
    return int(width), int(height)


def _cells(text: str) -> int:
    if not text.isdecimal() or not 16 <= int(text) <= 512:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 16 to 512")
    return int(text)
