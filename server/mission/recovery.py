"""Trainings that an earlier console left: those that still run are followed, others taken up again.

A worker outlives a console that crashes once its drones are down. The next console adopts it as
if it had started it; where there is none any more, the training goes on from its last kept state
when the operator resumes the capture.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
from collections.abc import Callable, Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from server.jobs.runner import JobFailedError, JobRunner
from server.mission.commands import CaptureRecord, RefusedError
from server.mission.events import CaptureChanged, EventStream, FieldView, Noted
from server.mission.phases import Phase
from server.mission.reconstruction import Reconstruction
from server.store.runs import RunFolder

logger = logging.getLogger(__name__)

_TELL_S = 2.0
# What ended without a field and may have left something to go on from.
_RESUMABLE = ("interrupted", "aborted", "failed")


class Recovery:
    """Brings captures to their end whose mission is gone; lives on the event loop.

    Args:
        runner: Adopts and starts the workers.
        events: Where the news goes.
        keep: Takes every new state before it is told.
    """

    def __init__(
        self, runner: JobRunner, events: EventStream, keep: Callable[[CaptureChanged], None]
    ) -> None:
        self._runner = runner
        self._events = events
        self._keep = keep
        self._work: dict[str, Reconstruction] = {}
        self._tasks: dict[str, asyncio.Task[None]] = {}
        # One at a time takes up work, or a run would get two workers.
        self._taking_up = asyncio.Lock()

    def has(self, capture_id: str) -> bool:
        """Return whether a capture's training goes on here."""
        task = self._tasks.get(capture_id)
        return task is not None and not task.done()

    async def adopt(self, records: Iterable[CaptureRecord]) -> None:
        """Follow the workers that outlived their console, also those that are done by now."""
        async with self._taking_up:
            for record in records:
                if record.status.state == "interrupted":
                    await self._adopt_one(record)

    async def _adopt_one(self, record: CaptureRecord) -> None:
        work = self._reconstruction(record)
        try:
            adopted = await work.adopt()
        except OSError:
            logger.exception("%s cannot be looked into", record.status.run)
            return
        if adopted:
            logger.info("the training of %s goes on", record.status.id)
            self._follow(record, work)

    async def resume(self, record: CaptureRecord) -> None:
        """Go on with the training of a capture that was cut off.

        Raises:
            RefusedError: If there is nothing to go on with, or another one goes on.
        """
        async with self._taking_up:
            self.refuse_while_running()
            await self._resume(record)

    def refuse_while_running(self) -> None:
        """Raise RefusedError while a training goes on: it needs all processors."""
        busy = next((name for name in self._tasks if self.has(name)), None)
        if busy is not None:
            raise RefusedError(f"{busy} is being trained; abort it or wait for its end")

    async def _resume(self, record: CaptureRecord) -> None:
        if record.status.state not in _RESUMABLE:
            raise RefusedError(f"this capture is {record.status.state}")
        work = self._reconstruction(record)
        try:
            if not await work.adopt():
                await work.resume()
        except (OSError, ValueError, JobFailedError) as error:
            raise RefusedError(str(error)) from error
        self._follow(record, work)

    async def view_field(self, capture_id: str, view: FieldView | None) -> None:
        """See previews of a training from ``view``; raises ValueError, see ``Reconstruction``."""
        await self._work[capture_id].view_from(view)

    async def cancel(self, capture_id: str) -> None:
        """Stop a capture's training; it can be resumed."""
        await self._work[capture_id].cancel()
        await self.ended(capture_id)

    async def ended(self, capture_id: str) -> None:
        """Wait until a capture's training, if there is one, is over."""
        if capture_id in self._tasks:
            await asyncio.wait([self._tasks[capture_id]])

    async def close(self) -> None:
        """Stop whatever goes on."""
        for capture_id in [name for name in self._tasks if self.has(name)]:
            await self.cancel(capture_id)

    def _reconstruction(self, record: CaptureRecord) -> Reconstruction:
        run = RunFolder(Path(record.status.run))
        return Reconstruction(record.request, run, self._runner, self._events)

    def _follow(self, record: CaptureRecord, work: Reconstruction) -> None:
        capture_id = record.status.id
        self._work[capture_id] = work
        status = _changed(record.status, "running", Phase.TRAIN, 0.6, work.seconds_total(), None)
        self._publish(status)
        self._tasks[capture_id] = asyncio.create_task(
            self._finish(status, work), name=f"training {capture_id}"
        )

    def _publish(self, status: CaptureChanged) -> None:
        self._keep(status)
        self._events.publish(status)

    async def _finish(self, status: CaptureChanged, work: Reconstruction) -> None:
        run = RunFolder(Path(status.run))
        state = await asyncio.to_thread(run.state) or {}
        await self._write(run, status, state)
        telling = asyncio.create_task(self._tell(status, work), name=f"eta {status.id}")
        try:
            await work.finish(state.get("seconds", {}))
            ended = _changed(status, "succeeded", Phase.DONE, 1.0, 0.0, None)
        except JobFailedError as error:
            word = "interrupted" if work.cancelled else "failed"
            text = f"the reconstruction failed: {error}"
            ended = _changed(status, word, Phase.TRAIN, status.progress, None, text)
        except Exception as error:
            # Whatever happens here, the fleet and its console go on.
            logger.exception("the training of %s cannot be followed", status.id)
            text = f"internal error: {error!r}"
            ended = _changed(status, "failed", Phase.TRAIN, status.progress, None, text)
            await work.cancel()
        finally:
            telling.cancel()
        await self._write(run, ended, state)
        self._publish(ended)
        if ended.state == "succeeded":
            self._events.publish(Noted("info", f"{status.id} was brought to its end."))

    async def _tell(self, status: CaptureChanged, work: Reconstruction) -> None:
        while True:
            left_s = work.seconds_left()
            progress = 1.0 - (1.0 - status.progress) * left_s / work.seconds_total()
            self._publish(_changed(status, "running", Phase.TRAIN, progress, left_s, None))
            await asyncio.sleep(_TELL_S)

    async def _write(self, run: RunFolder, status: CaptureChanged, state: dict[str, Any]) -> None:
        kept = state | {"status": asdict(status) | {"at": status.at.isoformat()}}
        try:
            await asyncio.to_thread(run.write_state, kept)
        except OSError:
            logger.exception("the record of %s could not be written", run.path)


def _changed(
    status: CaptureChanged,
    state: str,
    phase: Phase,
    progress: float,
    eta_s: float | None,
    error: str | None,
) -> CaptureChanged:
    return dataclasses.replace(
        status,
        state=state,
        phase=phase.value,
        progress=progress,
        eta_s=eta_s,
        error=error,
        at=datetime.now(UTC),
    )
