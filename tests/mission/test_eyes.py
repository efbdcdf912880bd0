"""A camera eye: which pictures are searched, which are skipped, what the operator points out."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.mission import eyes
from server.mission.events import EventStream, FrameAnnotated, Subscription
from server.mission.eyes import CameraEye
from server.stages import Box, Frame, Region
from server.swarm.config import DroneConfig
from server.swarm.drone import Drone
from server.swarm.pictures import FrameDecoder
from server.swarm.ports import Receiver
from server.vision.config import VisionConfig
from server.vision.region import RegionPrior

CAMERA = TELLO_INTRINSICS.scaled(1 / 6)
SIZE = (CAMERA.height, CAMERA.width, 3)


class NoLink:
    """A link to nowhere."""

    unsent = 0

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        pass

    def send(self, datagram: bytes) -> None:
        pass

    def close(self) -> None:
        pass


class NoDecoder:
    """The test hands the frames over itself."""

    overflows = 0

    async def __aenter__(self) -> NoDecoder:
        return self

    async def __aexit__(self, *exc: object) -> None:
        pass

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        pass


@dataclass
class FakeTracker:
    """Sees a box in every picture; notes what it is told, and waits when it shall be slow."""

    told: list[object] = field(default_factory=list)
    may_go_on: threading.Event = field(default_factory=threading.Event)

    def point_out(self, xyxy_px: NDArray[np.float64] | None) -> None:
        self.told.append(None if xyxy_px is None else xyxy_px.tolist())

    def update(self, frame: Frame, expected: RegionPrior | None) -> tuple[Region, Box]:
        assert self.may_go_on.wait(20.0)
        self.told.append(frame.sequence)
        mask = np.zeros((30, 40), bool)
        mask[10:20, 10:30] = True
        box = Box(np.array([39.5, 39.5, 119.5, 79.5]), 0.9, False)
        return Region(box.centroid_px, 20.0, 9.0, mask, 4.0, 0.9), box


@dataclass
class Watched:
    """An eye at work, and both ends of it."""

    drone: Drone
    eye: CameraEye
    show: Callable[[Frame], None]
    tracker: FakeTracker
    news: Subscription
    running: asyncio.Task[None]

    async def annotated(self) -> FrameAnnotated:
        coming = asyncio.ensure_future(anext(self.news))
        await asyncio.wait([coming, self.running], return_when=asyncio.FIRST_COMPLETED)
        if self.running.done():
            coming.cancel()
            self.running.result()
        event = await coming
        assert isinstance(event, FrameAnnotated)
        return event


@asynccontextmanager
async def watching(
    monkeypatch: pytest.MonkeyPatch, now_s: float = 0.0, slow: bool = False
) -> AsyncIterator[Watched]:
    shows: list[Callable[[Frame], None]] = []

    def decoder(drone_id: str, on_frame: Callable[[Frame], None]) -> FrameDecoder:
        shows.append(on_frame)
        return NoDecoder()

    tracker = FakeTracker()
    if not slow:
        tracker.may_go_on.set()
    monkeypatch.setattr(eyes, "RegionTracker", lambda config, turn: tracker)
    config = DroneConfig(id="d", name="North", colour="#f08020", intrinsics=CAMERA)
    events = EventStream()
    with ThreadPoolExecutor(1) as threads, events.subscribe() as news:
        drone = Drone(config, NoLink(), decoder=decoder)
        eye = CameraEye(drone, VisionConfig(), events, threads, clock=lambda: now_s)
        running = asyncio.create_task(eye.run())
        await asyncio.sleep(0)
        try:
            async with asyncio.timeout(20.0):
                yield Watched(drone, eye, shows[0], tracker, news, running)
        finally:
            tracker.may_go_on.set()
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)


def frame(number: int, *, damaged: bool = False, completed_s: float | None = None) -> Frame:
    image = np.full(SIZE, 90, np.uint8)
    return Frame("d", number, 1.0 + number / 30.0, image, damaged, completed_s)


async def test_every_picture_is_searched_and_annotated_in_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch, now_s=5.0) as watched:
        for number in range(4):
            watched.show(frame(number, completed_s=4.75))
        events = [await watched.annotated() for _ in range(4)]
        sight = watched.eye.sight
        assert watched.eye.annotated is events[-1]
    assert [event.sequence for event in events] == [0, 1, 2, 3]
    assert watched.tracker.told == [0, 1, 2, 3]
    assert [event.captured_s for event in events] == [1.0 + n / 30.0 for n in range(4)]
    assert [event.latency_s for event in events] == [0.25] * 4
    assert [event.skipped for event in events] == [0] * 4
    assert sight is not None
    assert sight.frame.sequence == 3
    assert sight.box is not None
    jpeg = cv2.imdecode(np.frombuffer(events[-1].jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert jpeg is not None
    assert jpeg.shape == (480, 640, 3)


async def test_a_search_that_takes_too_long_skips_pictures_and_counts_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch, slow=True) as watched:
        for number in range(100):
            watched.show(frame(number))
            await asyncio.sleep(0)
        watched.tracker.may_go_on.set()
        events = [await watched.annotated()]
        while events[-1].sequence < 99:
            events.append(await watched.annotated())
    looked_at = [event.sequence for event in events]
    assert looked_at == sorted(set(looked_at))
    assert looked_at[0] == 0, "the one it was busy with"
    assert len(looked_at) < 20, "what waited was bounded"
    # Decoded so far, less what was skipped, is what was looked at: at every moment.
    for count, event in enumerate(events, 1):
        assert event.sequence + 1 - event.skipped == count


async def test_damaged_pictures_are_shown_but_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    async with watching(monkeypatch) as watched:
        watched.show(frame(0, damaged=True))
        event = await watched.annotated()
        assert watched.eye.sight is not None
        assert watched.eye.sight.box is None
    assert event.damaged
    assert event.jpeg
    assert watched.tracker.told == []


async def test_a_picture_of_another_size_than_the_cameras_is_not_searched(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch) as watched:
        watched.show(Frame("d", 0, 1.0, np.zeros((240, 320, 3), np.uint8), False))
        assert (await watched.annotated()).jpeg
        assert watched.eye.sight is not None
        assert watched.eye.sight.box is None
    assert watched.tracker.told == []


async def test_a_camera_calibrated_anew_is_used_from_the_next_picture_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch) as watched:
        watched.drone.calibrate(TELLO_INTRINSICS.scaled(1 / 3))
        watched.show(frame(0))
        assert "calibrated for 320x240" in (await watched.annotated()).note
        watched.drone.calibrate(replace(CAMERA, fx=150.0))
        watched.show(frame(1))
        assert (await watched.annotated()).note == ""
    assert watched.tracker.told == [1]


async def test_what_is_pointed_out_reaches_the_search_once_before_the_next_picture(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch) as watched:
        for number in range(2):
            watched.show(frame(number))
            await watched.annotated()
        watched.eye.point_out(np.array([10.0, 20.0, 60.0, 90.0]))
        for number in range(2, 4):
            watched.show(frame(number))
            await watched.annotated()
        watched.eye.point_out(None)
        watched.show(frame(4))
        await watched.annotated()
    assert watched.tracker.told == [0, 1, [10.0, 20.0, 60.0, 90.0], 2, 3, None, 4]


async def test_of_what_was_pointed_out_between_two_pictures_the_last_counts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with watching(monkeypatch) as watched:
        watched.eye.point_out(np.array([10.0, 20.0, 60.0, 90.0]))
        watched.eye.point_out(np.array([0.0, 0.0, 30.0, 30.0]))
        watched.show(frame(0))
        await watched.annotated()
    assert watched.tracker.told == [[0.0, 0.0, 30.0, 30.0], 0]


@pytest.mark.parametrize(
    "box", [[10.0, 10.0, 10.0, 40.0], [0.0, 0.0, float("nan"), 9.0], [0.0, 1.0, 2.0], []]
)
async def test_what_is_no_box_is_refused_where_it_is_said(
    monkeypatch: pytest.MonkeyPatch, box: list[float]
) -> None:
    async with watching(monkeypatch) as watched:
        with pytest.raises(ValueError, match="xyxy_px"):
            watched.eye.point_out(np.array(box))
        watched.show(frame(0))
        await watched.annotated()
    assert watched.tracker.told == [0]
