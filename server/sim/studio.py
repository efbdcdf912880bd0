"""The worker thread that renders and encodes what the simulated cameras see."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import IO, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from server.sim.camera import STILL, SimulatedCamera
from server.sim.config import SimConfig
from server.sim.drone import SimulatedDrone
from server.sim.encoder import VideoEncoder

_LOG = logging.getLogger(__name__)

_REPORT_PERIOD_S = 5.0
_NOBODY_LOOKS_S = 0.02


class PictureSource(Protocol):
    """What the simulator needs of a world."""

    def render(
        self,
        T_world_cam: NDArray[np.float64],
        other_drones: Sequence[tuple[NDArray[np.float64], float]] = (),
    ) -> NDArray[np.uint8]:
        """Return the BGR picture ``(720, 960, 3)`` of an OpenCV camera pose ``(4, 4)``."""
        ...

    def close(self) -> None:
        """Release what it holds."""
        ...


WorldMaker = Callable[[SimConfig], PictureSource]


@dataclass(frozen=True, slots=True)
class _Form:
    """The form of one drone's video.

    Attributes:
        size_px: Width and height.
        fps: Pictures per second that were asked for; how many come is the machine's affair.
        bitrate_kbit_s: Upper bound of its rate, kbit/s.
        looks_down: True for the grey pictures of the downward camera.
    """

    size_px: tuple[int, int]
    fps: float
    bitrate_kbit_s: int
    looks_down: bool

    @classmethod
    def wanted_by(cls, drone: SimulatedDrone, config: SimConfig) -> _Form:
        """Return the form that a drone's client has asked for, within the simulator's bounds."""
        settings = drone.sdk.settings
        bitrate = min(config.bitrate_kbit_s, settings.bitrate_kbit_s or config.bitrate_kbit_s)
        return cls(settings.size_px, settings.fps, bitrate, settings.looks_down)


class _Encoding:
    """A drone's camera and an encoder, with the form of its pictures."""

    def __init__(self, form: _Form, camera: SimulatedCamera) -> None:
        self.form = form
        self.camera = camera
        self._encoder = VideoEncoder(*form.size_px, form.fps, form.bitrate_kbit_s)

    def encode(self, image_bgr: NDArray[np.uint8], at_s: float, key: bool) -> list[bytes]:
        """Return the datagrams of one rendered picture."""
        width, height = self.form.size_px
        if image_bgr.shape[:2] != (height, width):
            small = cv2.resize(image_bgr, (width, height), interpolation=cv2.INTER_AREA)
            image_bgr = small.astype(np.uint8, copy=False)
        if self.form.looks_down:
            grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
            image_bgr = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
        return self._encoder.encode(image_bgr, at_s, key)


class Studio:
    """The worker thread: renders and encodes, drone after drone.

    The world is made, used and closed in this thread alone. The loop owns the drones; the thread
    only reads their poses, which are replaced as whole arrays, and hands datagrams back.
    """

    def __init__(
        self, config: SimConfig, drones: Sequence[SimulatedDrone], maker: WorldMaker
    ) -> None:
        self._config = config
        self._drones = drones
        self._maker = maker
        self._loop = asyncio.get_running_loop()
        self._ready: asyncio.Future[None] = self._loop.create_future()
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._closing = threading.Event()
        self._sent = dict.fromkeys((drone.drone_id for drone in drones), 0)
        self._cameras = {
            drone.drone_id: SimulatedCamera(config.camera, config.seed, index)
            for index, drone in enumerate(drones)
        }
        self._thread = threading.Thread(target=self._run, name="studio", daemon=True)

    async def start(self) -> None:
        """Make the world; raises what its making raises."""
        self._thread.start()
        await self._ready

    async def ended(self) -> None:
        """Wait for the thread's end; raises what it failed of."""
        await asyncio.shield(self._ended)

    async def stop(self) -> None:
        """End the thread."""
        self._closing.set()
        await asyncio.to_thread(self._thread.join, 10.0)

    def _run(self) -> None:
        future = self._ready
        try:
            world = self._maker(self._config)
            try:
                self._settle(self._ready, None)
                future = self._ended
                with contextlib.ExitStack() as stack:
                    truth = self._config.truth_file
                    file = stack.enter_context(truth.open("a")) if truth is not None else None
                    self._work(world, file)
            finally:
                world.close()
            self._settle(self._ended, None)
        except Exception as error:  # noqa: BLE001  # Whatever it is, the loop must hear of it.
            self._settle(future, error)

    def _settle(self, future: asyncio.Future[None], error: Exception | None) -> None:
        def settle() -> None:
            if future.done():
                return
            if error is None:
                future.set_result(None)
            else:
                future.set_exception(error)

        with contextlib.suppress(RuntimeError):  # The loop has ended already.
            self._loop.call_soon_threadsafe(settle)

    def _work(self, world: PictureSource, truth: IO[str] | None) -> None:
        encoders: dict[str, _Encoding] = {}
        due_s = dict.fromkeys(self._sent, 0.0)
        report_s = time.monotonic() + _REPORT_PERIOD_S
        while not self._closing.is_set():
            now_s = time.monotonic()
            if now_s >= report_s:
                self._report()
                report_s = now_s + _REPORT_PERIOD_S
            # Whoever has waited longest comes first: round-robin that skips dark cameras.
            waiting = [drone for drone in self._drones if drone.wants_pictures]
            drone = min(waiting, key=lambda drone: due_s[drone.drone_id], default=None)
            if drone is None or due_s[drone.drone_id] > now_s:
                wait_s = _NOBODY_LOOKS_S if drone is None else due_s[drone.drone_id] - now_s
                self._closing.wait(min(wait_s, _NOBODY_LOOKS_S))
                continue
            due_s[drone.drone_id] = max(due_s[drone.drone_id] + 1.0 / self._fps(drone), now_s)
            form = _Form.wanted_by(drone, self._config)
            encoding = encoders.get(drone.drone_id)
            if encoding is None or encoding.form != form:
                encoders[drone.drone_id] = encoding = _Encoding(form, self._cameras[drone.drone_id])
            self._shoot(drone, world, encoding, truth)

    def _fps(self, drone: SimulatedDrone) -> float:
        return min(self._config.fps_cap, drone.sdk.settings.fps)

    def _shoot(
        self,
        drone: SimulatedDrone,
        world: PictureSource,
        encoding: _Encoding,
        truth: IO[str] | None,
    ) -> None:
        at_s = time.monotonic()
        airframe = drone.airframe
        down = encoding.form.looks_down
        T_world_cam = airframe.T_world_down_cam() if down else airframe.T_world_cam()
        yaw_rad = airframe.yaw_rad
        others = [
            (other.airframe.position, other.airframe.yaw_rad)
            for other in self._drones
            if other is not drone
        ]
        motion = STILL if down else airframe.camera_motion()
        image_bgr = encoding.camera.take(world.render(T_world_cam, others), motion, at_s)
        key = drone.sdk.key_picture_due
        drone.sdk.key_picture_due = False
        datagrams = encoding.encode(image_bgr, at_s, key)
        if truth is not None:
            entry = {
                "t_monotonic": at_s,
                "drone_id": drone.drone_id,
                "position": T_world_cam[:3, 3].tolist(),
                "yaw": yaw_rad,
                "T_world_cam": T_world_cam.tolist(),
            }
            truth.write(json.dumps(entry) + "\n")
            truth.flush()
        self._sent[drone.drone_id] += 1
        with contextlib.suppress(RuntimeError):  # The loop has ended already.
            self._loop.call_soon_threadsafe(drone.send_video, datagrams)

    def _report(self) -> None:
        rates = {name: round(count / _REPORT_PERIOD_S, 1) for name, count in self._sent.items()}
        if any(rates.values()):
            _LOG.info("%s", json.dumps({"pictures_per_s": rates}))
        self._sent = dict.fromkeys(self._sent, 0)
