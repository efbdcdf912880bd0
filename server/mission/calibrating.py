"""One camera's calibration while it goes on: views of a board are collected, then solved.

It looks at the pictures that come anyway and sends nothing that moves a drone. Boards are found and
the camera is solved in a thread of its own, one picture at a time, a few pictures a second: on the
event loop, where stops are carried out, nothing waits for it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Protocol

import cv2

from server.mission.board_views import GatherConfig, gather_views
from server.mission.calibration_record import (
    CalibrationResult,
    CalibrationState,
    Ending,
)
from server.stages import Frame
from server.store.fleet_edit import intrinsics_toml
from server.swarm.config import DroneConfig
from server.swarm.errors import DroneError
from server.swarm.flight_watch import Activity
from server.vision.calibration import CalibrationRefusedError, Lack, calibrate
from server.vision.calibration_board import BoardFinder
from server.vision.calibration_views import Hint, Picked, PickProgress, ViewPicker
from server.vision.coverage_picture import coverage_png

logger = logging.getLogger(__name__)

_FRAME_WAIT_S = 1.0


class CameraDrone(Protocol):
    """What a calibration needs of a drone."""

    @property
    def config(self) -> DroneConfig:
        """Who it is."""
        ...

    @property
    def activity(self) -> Activity:
        """What it is doing."""
        ...

    @property
    def airborne(self) -> bool:
        """True while it may be in the air."""
        ...

    @property
    def video_wanted(self) -> bool:
        """False while the video is off on purpose."""
        ...

    def set_video(self, on: bool) -> None:
        """Turn the video on or off."""
        ...

    async def next_frame(self, after: int) -> Frame:
        """Return the newest picture whose sequence exceeds ``after``."""
        ...


class EndedError(Exception):
    """A calibration cannot go on; the text is for people.

    Attributes:
        ending: Why, in a word.
    """

    def __init__(self, ending: Ending, text: str) -> None:
        super().__init__(text)
        self.ending: Ending = ending


class Calibrating:
    """Collects views of one camera and solves them.

    Attributes:
        state: How far it is.
        hint: What to do next, None while no picture comes.
        lack: What the views lack, when it was refused.
        ending: Why it ended without a result.
        reason: The same for people.
        result: The camera, once it is solved.
        picker: Has the views.
        progress: What the views are worth so far.
        config: When it ends by itself.
    """

    def __init__(
        self,
        drone: CameraDrone,
        finder: BoardFinder,
        picker: ViewPicker,
        config: GatherConfig,
        refuse: Callable[[], None],
        spent_s: float = 0.0,
    ) -> None:
        """Build it; inside a running event loop.

        Args:
            drone: Whose camera.
            finder: Finds the board.
            picker: Chooses views; it may have some already.
            config: When it ends by itself, and how fast it goes.
            refuse: Raises EndedError when it must not go on.
            spent_s: How long those views took.
        """
        self.state: CalibrationState = "collecting"
        self.hint: Hint | None = None
        self.lack: Lack | None = None
        self.ending: Ending | None = None
        self.reason = ""
        self.result: CalibrationResult | None = None
        self.picker = picker
        self.progress: PickProgress = picker.progress()
        self.config = config
        self._drone = drone
        self._finder = finder
        self._refuse = refuse
        self._loop = asyncio.get_running_loop()
        self._begun_s = self._loop.time()
        self._spent_before_s = spent_s
        self._spent_s: float | None = None
        self._sequence = -1
        self._stop = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._turned_on = False

    @property
    def spent_s(self) -> float:
        """How long views were collected, seconds."""
        if self._spent_s is not None:
            return self._spent_s
        return self._spent_before_s + self._loop.time() - self._begun_s

    @property
    def over(self) -> bool:
        """True once nothing goes on any more."""
        return self.state not in ("collecting", "solving")

    def begin(self) -> None:
        """Begin; it ends by itself."""
        if not self._drone.video_wanted:
            self._drone.set_video(True)
            self._turned_on = True
        name = f"calibration of {self._drone.config.id}"
        self._task = asyncio.create_task(self._run(), name=name)

    def finish(self) -> None:
        """Collect no more and solve what there is."""
        self._stop.set()

    def end(self, ending: Ending, reason: str) -> None:
        """End it now without a result; one that is over stays as it is."""
        if self.over or self._task is None:
            return
        self._note_end(EndedError(ending, reason))
        # At once: whoever flies this drone next finds its video off, and turns it on.
        self._give_video_back()
        self._task.cancel()

    async def ended(self) -> None:
        """Wait until its task is gone."""
        if self._task is not None:
            await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        threads = ThreadPoolExecutor(
            1, thread_name_prefix="calibration", initializer=cv2.setNumThreads, initargs=(1,)
        )
        try:
            await self._work(threads)
        except EndedError as error:
            self._note_end(error)
        except CalibrationRefusedError as error:
            self.state, self.lack, self.reason = "refused", error.lack, str(error)
        except DroneError as error:
            self._note_end(EndedError("offline", str(error)))
        except Exception:
            logger.exception("%s: its calibration failed", self._drone.config.id)
            self._note_end(EndedError("failed", "it failed; the console's log says why"))
        finally:
            self._note_over()
            threads.shutdown(wait=False, cancel_futures=True)
            self._give_video_back()

    async def _work(self, threads: ThreadPoolExecutor) -> None:
        await gather_views(
            self._next_frame,
            self._finder,
            self.picker,
            self.config,
            self._take,
            self._stop,
            threads,
        )
        self.state = "solving"
        self._note_over()
        self.result = await self._loop.run_in_executor(threads, self._solve)
        self.state = "solved"

    async def _next_frame(self) -> Frame | None:
        """Return the next whole picture, None when none comes for a while."""
        self._refuse()
        try:
            async with asyncio.timeout(_FRAME_WAIT_S):
                frame = await self._drone.next_frame(self._sequence)
        except TimeoutError:
            self.hint = None
            return None
        self._refuse()
        self._sequence = frame.sequence
        # The newest picture of a video that was off is an old one.
        return None if frame.damaged or frame.captured_s < self._begun_s else frame

    def _take(self, picked: Picked) -> None:
        self.hint = picked.hint
        if picked.view is not None:
            self.progress = self.picker.progress()

    def _solve(self) -> CalibrationResult:
        """Return the camera of the views; runs in the thread."""
        views = list(self.picker.views)
        found = calibrate(views)
        remark = (
            f"Calibrated with {self._finder.board.name}, {len(found.views)} views,"
            f" {found.mean_px:.2f} px."
        )
        toml = intrinsics_toml(self._drone.config.id, found.intrinsics, remark)
        return CalibrationResult(found, remark, toml, coverage_png(found, views))

    def _give_video_back(self) -> None:
        """Turn the video off again if it was; never in the air."""
        if self._turned_on and not self._drone.airborne:
            self._drone.set_video(False)
        self._turned_on = False

    def _note_end(self, error: EndedError) -> None:
        self.state, self.ending, self.reason = "ended", error.ending, str(error)
        self._note_over()

    def _note_over(self) -> None:
        self.hint = None
        self._spent_s = self.spent_s
