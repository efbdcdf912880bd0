"""Taking a still: which picture is kept, and what is known of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest

from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import camera_pose
from server.mission.capture import Photographer
from server.mission.config import MissionConfig
from server.mission.events import CaptureTaken, EventStream
from server.mission.eyes import Sight
from server.nerf.flight import read_pictures
from server.stages import CameraPose, Frame, Telemetry
from server.store.runs import RunFolder
from server.vision.sharpness import sharpness

PICTURE = np.random.default_rng(0).integers(0, 255, (72, 96, 3), np.uint8)
CAMERA = TELLO_INTRINSICS.scaled(0.1)


@dataclass
class Frames:
    """An eye that sees its next picture each time it is asked, the last one from then on."""

    images: list[tuple[np.ndarray, bool]]
    sequence: int = -1

    @property
    def sight(self) -> Sight:
        self.sequence += 1
        image, damaged = self.images[min(self.sequence, len(self.images) - 1)]
        return Sight(Frame("drone-1", self.sequence, 0.0, image, damaged), None, None)


def photographer(
    run: RunFolder, events: EventStream, *images: tuple[np.ndarray, bool]
) -> Photographer:
    zero = np.zeros(3)
    telemetry = Telemetry("drone-1", 0.0, 0.0, 0.0, 0.0, zero, zero, 0.8, 0.8, 0.0, 90, 60.0, 1.0)
    pose = CameraPose("drone-1", 0.0, camera_pose(np.array([2.0, 0.0, 1.0]), np.pi, 0.2), np.eye(4))
    drone = SimpleNamespace(telemetry=telemetry, config=SimpleNamespace(intrinsics=CAMERA))
    return Photographer(
        run,
        cast("Any", SimpleNamespace(drones={"drone-1": drone})),
        # It is asked twice for what it saw before.
        {"drone-1": cast("Any", Frames([(PICTURE, False), (PICTURE, False), *images]))},
        cast("Any", SimpleNamespace(pose=lambda drone_id, at_s: pose)),
        events,
        MissionConfig(),
    )


@pytest.mark.parametrize("length_px", [1, 9])
async def test_how_sharp_a_picture_is_stays_with_it(tmp_path: Path, length_px: int) -> None:
    image = cv2.blur(PICTURE, (length_px, 1)).astype(np.uint8)
    run, events = RunFolder.create(tmp_path, ""), EventStream()
    with events.subscribe(16) as subscription:
        assert not await photographer(run, events, (image, False)).take_all(["drone-1"], 0, None)
        event = await anext(aiter(subscription))
    assert isinstance(event, CaptureTaken)
    assert event.capture.sharpness == pytest.approx(sharpness(image), abs=0.01)
    (kept,) = read_pictures(run.path)
    assert kept.sharpness == event.capture.sharpness


async def test_damaged_pictures_are_passed_over_and_counted(tmp_path: Path) -> None:
    run, events = RunFolder.create(tmp_path, ""), EventStream()
    torn = np.zeros_like(PICTURE)
    taker = photographer(run, events, (torn, True), (torn, True), (PICTURE, False))
    with events.subscribe(16) as subscription:
        assert not await taker.take_all(["drone-1"], 0, None)
        event = await anext(aiter(subscription))
    assert isinstance(event, CaptureTaken)
    assert event.capture.damaged_before == 2
    assert event.capture.sharpness == pytest.approx(sharpness(PICTURE), abs=0.01)
