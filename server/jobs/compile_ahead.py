"""Compiles ahead what a mission needs: ``python -m server.jobs.compile_ahead``.

numba compiles on first use and keeps the machine code on disk. On a machine that has just been
installed that may take longer than a mission waits for its plan, and than its first pictures take
to come; so whoever flies has a small plan made and a small field trained at the start, which nobody
looks at.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.planner.config import AnnealingConfig, PlannerConfig
from server.planner.mission_plan import plan_mission
from server.stages import CameraPose, SeedGeometry

_NICENESS = 10
_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")

logger = logging.getLogger(__name__)


@asynccontextmanager
async def compile_ahead() -> AsyncIterator[asyncio.subprocess.Process | None]:
    """Compile in a process of its own beside what the caller does; it is ended on the way out.

    Nothing is lost when it fails or is cut short: who needs it compiles what is missing. Yields
    None where no process can be had.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            # A file of the folder we stand in must never shadow a module.
            "-P",
            "-m",
            "server.jobs.compile_ahead",
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
            env=os.environ | dict.fromkeys(_THREADS, "1"),
            process_group=0,
        )
    except OSError as error:
        logger.warning("nothing is compiled ahead: %s", error)
        yield None
        return
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        if await process.wait() > 0:
            logger.warning("what a mission needs could not be compiled ahead")


def main() -> None:
    """Plan two pictures for each of two drones around a box, then train a field for a moment."""
    os.nice(_NICENESS)
    box = Box3(np.array([-0.3, -0.2, 0.0]), np.array([0.3, 0.2, 0.5]))
    places = {"1": (np.array([2.0, 0.0, 1.0]), np.pi), "2": (np.array([-2.0, 0.0, 1.0]), 0.0)}
    poses = {
        drone_id: CameraPose(
            drone_id, 0.0, camera_pose(position, yaw_rad, TELLO_TILT_RAD), np.eye(4)
        )
        for drone_id, (position, yaw_rad) in places.items()
    }
    seed = SeedGeometry(box, (box,), views=4)
    # A few moves compile as much as many do.
    config = replace(PlannerConfig(), annealing=AnnealingConfig(swaps=30, prove=False))
    plan_mission(seed, TELLO_INTRINSICS, TELLO_TILT_RAD, poses, 2, config, seed_value=0)
    # By name: who starts this process must not load torch.
    importlib.import_module("server.nerf.warm_up").warm_up(threads=1)


if __name__ == "__main__":
    main()
