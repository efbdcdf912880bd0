"""Follows the worker that turns a run's pictures into a field, and passes its news on.

The worker gets ready while drones fly to their first places and trains on the pictures there are;
once the flight is complete it refines the poses, trains the field that is judged, and then the one
delivered.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from server.geometry.cameras import Intrinsics
from server.jobs.plan import KnownPlaces
from server.jobs.runner import Job, JobFailedError, JobRunner
from server.jobs.spec import TEST_EVERY, JobSpec
from server.jobs.unfinished import unfinished
from server.jobs.wanted_view import want_view
from server.mission.commands import CaptureRequest
from server.mission.events import (
    EventStream,
    FieldView,
    MetricsMeasured,
    Noted,
    PosesRefined,
    PreviewRendered,
    TrainingProgressed,
)
from server.nerf.orbit_view import OrbitView
from server.stages import Metrics
from server.store.atomic import write_atomic
from server.store.runs import RunFolder

logger = logging.getLogger(__name__)

# What refinement, evaluation, delivery, mesh and film take on two cores beside the training itself.
_BESIDE_TRAINING_S = 105.0
_LIVE_NICENESS = 10


class Reconstruction:
    """The reconstruction of one run.

    Attributes:
        cancelled: True once somebody wanted its end.
        known: What the field last told of the object's surface, None before or if nobody asked.

    Args:
        request: What was asked for.
        run: The run.
        runner: Starts the worker.
        events: Where its news goes.
        ask_known: Have it tell, in flight, what it knows of the object's surface.
    """

    def __init__(
        self,
        request: CaptureRequest,
        run: RunFolder,
        runner: JobRunner,
        events: EventStream,
        *,
        ask_known: bool = False,
    ) -> None:
        self._request = request
        self._run = run
        self._runner = runner
        self._events = events
        self._job: Job | None = None
        self._following: asyncio.Task[dict[str, Any]] | None = None
        self._finishing_since_s: float | None = None
        self._viewing = asyncio.Lock()
        self._ask_known = ask_known
        self.cancelled = False
        self.known: KnownPlaces | None = None

    def seconds_total(self) -> float:
        """Return how long the work after the flight is expected to take."""
        return self._request.train_seconds + _BESIDE_TRAINING_S

    def seconds_left(self) -> float:
        """Return how much of it is expected to be left."""
        if self._finishing_since_s is None:
            return self.seconds_total()
        gone_s = asyncio.get_running_loop().time() - self._finishing_since_s
        return max(1.0, self.seconds_total() - gone_s)

    async def start(self) -> None:
        """Start the worker unless it has been started."""
        await self._submit(
            {
                "source": "flight",
                "dataset": str(self._run.path.resolve()),
                "train_seconds": self._request.train_seconds,
                "test_every": TEST_EVERY,
                "mode": self._request.mode,
                "tell_known": self._ask_known,
            },
            self._request.seed,
        )

    async def resume(self) -> None:
        """Start a worker that goes on where the last one was cut off.

        Raises:
            ValueError: If nothing was cut off.
        """
        parameters, seed = await asyncio.to_thread(unfinished, self._run.path.resolve())
        await self._submit(parameters, seed)

    async def adopt(self) -> bool:
        """Follow the worker that an earlier console left; returns whether there is one."""
        job = await self._runner.adopt(self._folder)
        if job is not None:
            self._begin_to_follow(job)
        return job is not None

    @property
    def _folder(self) -> Path:
        return self._run.path / "jobs" / "reconstruct"

    async def _submit(self, parameters: dict[str, Any], seed: int) -> None:
        if self._following is not None:
            return
        spec = JobSpec(
            "reconstruct",
            parameters,
            seed=seed,
            threads=os.cpu_count() or 1,
            niceness=_LIVE_NICENESS,
            attached=False,
        )
        self._begin_to_follow(await self._runner.submit(spec, self._folder))

    def _begin_to_follow(self, job: Job) -> None:
        self._job = job
        self._following = asyncio.create_task(self._follow(job), name="reconstruction")
        self._following.add_done_callback(self._warn_of_failure)

    async def finish(self, flight_seconds: Mapping[str, float]) -> None:
        """Wait for the end and complete ``metrics.json`` with the flight's seconds.

        Raises:
            JobFailedError: If the worker failed.
        """
        assert self._following is not None
        self._finishing_since_s = asyncio.get_running_loop().time()
        result = await self._following
        seconds = {key: round(value, 1) for key, value in flight_seconds.items()}
        result["seconds"] = seconds | result["seconds"]
        write_atomic(self._run.path / "metrics.json", json.dumps(result, indent=1).encode())

    async def view_from(self, view: FieldView | None) -> None:
        """Have previews rendered from ``view``, None: from the orbit.

        Raises:
            ValueError: If no worker is at work, or nothing can be seen from there.
        """
        if self._following is None or self._following.done():
            raise ValueError("its field is not being trained")
        wanted = (
            None if view is None else OrbitView(view.azimuth_rad, view.elevation_rad, view.distance)
        )
        async with self._viewing:  # The newest wish is also the last one written.
            await asyncio.to_thread(want_view, self._folder, wanted)

    async def cancel(self) -> None:
        """End the worker if it runs."""
        self.cancelled = True
        if self._job is not None:
            await self._job.cancel()
        if self._following is not None:
            await asyncio.wait([self._following])

    def _warn_of_failure(self, task: asyncio.Task[dict[str, Any]]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            self.known = None  # It learns nothing more.
        if isinstance(error, JobFailedError) and not self.cancelled:
            self._events.publish(
                Noted("error", f"The reconstruction failed ({error}); all pictures are kept.")
            )

    async def _follow(self, job: Job) -> dict[str, Any]:
        result: dict[str, Any] = {}
        async for event in job.events():
            match event.pop("event"):
                case "progressed":
                    event.pop("at_s")
                    self._events.publish(TrainingProgressed(**event))
                case "preview":
                    self._publish_preview(event)
                case "refined":
                    self._publish_poses(event)
                case "known":
                    self._take_known(event)
                case "metrics":
                    self._events.publish(MetricsMeasured(Metrics(**event["metrics"])))
                case "done":
                    event.pop("at_s")
                    result = event
        return result

    def _take_known(self, event: dict[str, Any]) -> None:
        try:
            self.known = KnownPlaces.model_validate(event)
        except ValidationError:
            logger.exception("what the field knows cannot be read")

    def _publish_preview(self, event: dict[str, Any]) -> None:
        if "view" not in event:
            return  # A worker of an earlier version is not worth less for that.
        self._events.publish(
            PreviewRendered(
                (self._run.path / event["file"]).read_bytes(),
                np.array(event["T_world_cam"]),
                Intrinsics(**event["intrinsics"]),
                FieldView(**event["view"]),
            )
        )

    def _publish_poses(self, event: dict[str, Any]) -> None:
        refined = np.array(event["refined"], bool)
        self._events.publish(PosesRefined(np.array(event["T_world_cam"]), refined))
        level = "info" if refined.all() else "warning"
        self._events.publish(Noted(level, event["message"]))
