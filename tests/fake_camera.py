"""A drone as a calibration knows it: a camera that shows what it is told to."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from board_pictures import BoardCamera, various_poses
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import Frame
from server.swarm.config import DroneConfig
from server.swarm.errors import DroneError
from server.swarm.flight_watch import Activity
from server.vision.calibration_board import DEFAULT_BOARD, parse_board

# Half a Tello's picture: boards are found as well, and drawn in a quarter of the time.
LENS = Intrinsics(480, 360, 465.0, 463.0, 234.0, 176.0, (-0.035, 0.105, 0.0013, -0.0016, 0.0))


class FakeCamera:
    """Shows its pictures over and over, each of them several times as a still hand would."""

    def __init__(self, drone_id: str = "drone-1") -> None:
        self.config = DroneConfig(id=drone_id)
        self.activity: Activity = "ground"
        self.airborne = False
        self.video_wanted = True
        self.videos: list[bool] = []
        self.pictures: Sequence[NDArray[np.uint8]] = ()
        self.each = 3
        self.sequence = 0
        self.gone = False
        self.frame_s = 0.004

    def set_video(self, on: bool) -> None:
        self.video_wanted = on
        self.videos.append(on)

    def calibrate(self, intrinsics: Intrinsics) -> None:
        self.config = replace(self.config, intrinsics=intrinsics)

    async def next_frame(self, after: int) -> Frame:
        if self.gone:
            raise DroneError(f"{self.config.id}: closed")
        while not self.pictures or not self.video_wanted:  # noqa: ASYNC110 - Nothing tells.
            await asyncio.sleep(self.frame_s)
        await asyncio.sleep(self.frame_s)
        picture = self.pictures[self.sequence // self.each % len(self.pictures)]
        self.sequence += 1
        now_s = asyncio.get_running_loop().time()
        return Frame(self.config.id, self.sequence, now_s, picture, damaged=False)


def board_shown(count: int = 14, seed: int = 3) -> list[NDArray[np.uint8]]:
    """Return pictures of the board as somebody careful would show it to ``LENS``."""
    camera = BoardCamera(LENS, parse_board(DEFAULT_BOARD))
    poses = various_poses(camera, count, np.random.default_rng(seed))
    return [camera.picture(*pose) for pose in poses]
