"""Planner and training are compiled before a mission needs them, and wholly."""

import asyncio
import json
import signal
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from server.geometry.cameras import TELLO_INTRINSICS
from server.jobs.compile_ahead import compile_ahead
from server.jobs.local import LocalRunner
from server.jobs.plan import PlanInput
from server.jobs.spec import JobSpec
from server.planner.config import PlannerConfig
from tests.nerf.tiny_scene import write_tiny_scene

CORNERS = ([-0.2, -0.4, 0.0], [0.2, 0.4, 0.9])


async def plan_everything(folder: Path) -> None:
    """Plan with all that a mission may ask for."""
    wanted = PlanInput(
        outer=CORNERS,
        boxes=[CORNERS, ([-0.1, -0.1, 0.5], [0.1, 0.1, 0.9])],
        views=4,
        intrinsics=asdict(TELLO_INTRINSICS),
        tilt_rad=0.2,
        drones={"1": (2.0, 0.0, 1.0, 3.1), "2": (-2.0, 0.0, 1.0, 0.0), "3": (0.0, 2.0, 1.0, -1.6)},
        rounds=2,
        pictures=5,
        config=asdict(PlannerConfig()),
        priorities=[(*CORNERS, 3.0)],
        taken=[(1.5, 1.5, 1.2, -2.3)],
        enough=0.5,
    )
    job = await LocalRunner().submit(JobSpec("plan", json.loads(wanted.model_dump_json())), folder)
    async for _ in job.events():
        pass


def compiled(folder: Path) -> set[str]:
    """Return the names of the kernels' files."""
    return {file.name for file in folder.rglob("*.nb?")}


async def train_beside_a_flight(scene: Path, folder: Path) -> None:
    """Train and render as a worker does while pictures come in."""
    program = """
import sys
from pathlib import Path
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.preview import render_preview
from server.nerf.training import Trainer
trainer = Trainer(
    load_dataset(Path(sys.argv[1])), FieldConfig(), TrainConfig(), held_out=[], threads=1
)
trainer.run(steps=40)
render_preview(trainer, 0.3)
"""
    write_tiny_scene(scene, 4)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-P", "-c", program, str(scene), cwd=folder
    )
    assert await process.wait() == 0


@pytest.mark.slow
async def test_a_real_plan_and_a_real_training_find_all_they_need_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels = tmp_path / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(kernels))
    async with compile_ahead() as process:
        assert process is not None
        assert await process.wait() == 0
    ready = compiled(kernels)
    assert ready
    await plan_everything(tmp_path / "job")
    assert compiled(kernels) == ready
    await train_beside_a_flight(tmp_path / "scene", tmp_path)
    assert compiled(kernels) == ready


async def test_it_is_ended_with_whoever_started_it() -> None:
    async with compile_ahead() as process:
        assert process is not None
    assert process.returncode == -signal.SIGKILL


async def test_without_a_process_everything_else_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    async with compile_ahead() as process:
        assert process is None
