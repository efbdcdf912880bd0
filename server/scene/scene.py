"""The 3D scene: a viser server on loopback that follows the mission's events.

The event loop only sorts events into a ``Mailbox``; one thread decodes, encodes and draws. When it
cannot keep up, what is newer replaces what was waiting. Nothing comes back: the scene has no
command buttons, and a failure in it is logged and goes no further.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType

import rich
import viser

from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    DroneReported,
    Event,
    EventStream,
    FrameAnnotated,
    NoGoChanged,
    PlanFound,
    PlanViewChosen,
    PoseEstimated,
    PosesRefined,
    PreviewRendered,
    PrioritiesChanged,
    SeedFitted,
    Subscription,
    SurfaceSeen,
)
from server.scene.capture_nodes import CaptureLayer
from server.scene.config import SceneConfig
from server.scene.drone_nodes import DroneLayer
from server.scene.mailbox import Mailbox
from server.scene.room_nodes import RoomLayer
from server.scene.shapes import rgb_from_hex

logger = logging.getLogger(__name__)

# Pause between two drawings: faster than the believed poses come (about ten a second).
_PAUSE_S = 0.04
_CAMERA_POSITION = (3.0, -3.0, 2.0)


class Stage:
    """Everything that events draw; call it from one thread."""

    def __init__(self, scene: viser.SceneApi, config: SceneConfig) -> None:
        self._captures = CaptureLayer(scene, config)
        self._drones = DroneLayer(scene, config)
        self._failed: set[type] = set()
        scene.set_up_direction("+z")
        self._room = RoomLayer(scene, config)

    def draw(self, event: Event, now_s: float) -> None:
        """Draw ``event``; a failure is logged, the first time of its kind with its traceback."""
        try:
            self._draw(event, now_s)
        except Exception:
            kind = type(event)
            if kind not in self._failed:
                self._failed.add(kind)
                logger.exception("%s could not be drawn; further ones fail quietly", kind.__name__)
            else:
                logger.debug("%s could not be drawn", kind.__name__, exc_info=True)

    def _draw(self, event: Event, now_s: float) -> None:
        match event:
            case PoseEstimated():
                self._captures.set_colour(event.pose.drone_id, rgb_from_hex(event.colour))
                self._drones.draw_pose(event, now_s)
            case DroneReported():
                self._captures.set_colour(event.drone_id, rgb_from_hex(event.colour))
                self._drones.draw_report(event)
            case FrameAnnotated():
                self._drones.draw_frame(event)
            case SeedFitted():
                self._captures.draw_seed(event)
            case SurfaceSeen():
                self._captures.draw_seen(event)
            case PrioritiesChanged():
                self._captures.draw_priorities(event)
            case NoGoChanged():
                self._room.draw_no_go(event)
            case PlanFound():
                self._captures.draw_plan(event)
            case PlanViewChosen():
                self._captures.choose(event)
            case CaptureTaken():
                self._captures.draw_picture(event)
            case PosesRefined():
                self._captures.move_pictures(event)
            case PreviewRendered():
                self._captures.draw_preview(event)
            case CaptureChanged():
                if self._captures.begin(event.id):
                    self._drones.clear_trails()
            case _:
                pass


class SceneView:
    """The scene's server; an async context manager, or ``start`` and ``stop``.

    Viser asks nobody for a token, so it belongs on loopback, behind the console's bridge.
    """

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, config: SceneConfig | None = None
    ) -> None:
        self._host = host
        self._wanted_port = port
        self._config = config or SceneConfig()
        self._mailbox = Mailbox(self._config.thumbnail_hz)
        self._server: viser.ViserServer | None = None
        self._stage: Stage | None = None
        self._executor: ThreadPoolExecutor | None = None

    @property
    def port(self) -> int:
        """Port the scene listens on.

        Raises:
            RuntimeError: If it was not started.
        """
        if self._server is None:
            raise RuntimeError("the scene was not started")
        return self._server.get_port()

    @property
    def nodes(self) -> viser.SceneApi:
        """The nodes as they stand.

        Raises:
            RuntimeError: If it was not started.
        """
        if self._server is None:
            raise RuntimeError("the scene was not started")
        return self._server.scene

    def start(self) -> None:
        """Open the server and draw the empty scene."""
        # Viser prints its address and its end through rich, whatever ``verbose`` says: standard
        # output belongs to results, and that address is not the one to open.
        rich.reconfigure(quiet=True)
        server = viser.ViserServer(self._host, self._wanted_port, label="DroNeRF", verbose=False)
        # Any client may ask for a public tunnel into this machine; hiding the button is not enough.
        server.request_share_url = _refuse_share_url
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        # The panel holds display switches only; open it would hide most of an embedded scene.
        server.gui.main_panel.minimize()
        server.initial_camera.position = _CAMERA_POSITION
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.initial_camera.up = (0.0, 0.0, 1.0)
        self._server = server
        self._stage = Stage(server.scene, self._config)
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="scene")

    def stop(self) -> None:
        """Finish what is being drawn and close the server."""
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None
        if self._server is not None:
            self._server.stop()
            self._server = None
            self._stage = None

    async def __aenter__(self) -> SceneView:
        await asyncio.to_thread(self.start)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await asyncio.to_thread(self.stop)

    async def follow(self, events: EventStream, standing: Iterable[Event] = ()) -> None:
        """Draw what is ``standing`` and then events, until cancelled.

        It ends early, and logs why, only if it breaks itself.
        """
        work = asyncio.Event()
        for event in standing:
            if self._mailbox.offer(event):
                work.set()
        try:
            with events.subscribe() as subscription:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._collect(subscription, work), name="scene collect")
                    tasks.create_task(self._draw_forever(work), name="scene draw")
        except* Exception:
            logger.exception("the 3D scene stopped following the mission")

    async def _collect(self, subscription: Subscription, work: asyncio.Event) -> None:
        async for event in subscription:
            if self._mailbox.offer(event):
                work.set()

    async def _draw_forever(self, work: asyncio.Event) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await work.wait()
            work.clear()
            batch = self._mailbox.take(time.monotonic())
            if batch:
                if self._executor is None:
                    raise RuntimeError("the scene was stopped")
                await loop.run_in_executor(self._executor, self._draw_batch, batch)
            await asyncio.sleep(_PAUSE_S)

    def _draw_batch(self, batch: Sequence[Event]) -> None:
        server, stage = self._server, self._stage
        if server is None or stage is None:
            return
        now_s = time.monotonic()
        # Video is for those who look now; whoever comes later gets the next pictures.
        watched = bool(server.get_clients())
        with server.atomic():
            for event in batch:
                if watched or not isinstance(event, FrameAnnotated):
                    stage.draw(event, now_s)


def _refuse_share_url(*_: object, **__: object) -> str | None:
    logger.warning("a viewer asked for a public address of the 3D scene; refused")
    return None
