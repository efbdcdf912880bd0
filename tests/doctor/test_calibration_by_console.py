"""A console calibrates a simulated drone that shows a board, over UDP and with real video."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from board_pictures import BoardCamera, various_poses
from rig import rig

from server.geometry.cameras import Intrinsics
from server.mission.board_views import GatherConfig
from server.mission.calibrations import Calibrations
from server.mission.events import EventStream
from server.swarm.fleet import Fleet
from server.vision.calibration_board import DEFAULT_BOARD, parse_board

pytestmark = [pytest.mark.loopback, pytest.mark.slow]

CAMERA = Intrinsics(960, 720, 931.0, 927.0, 468.0, 352.0, (-0.035, 0.105, 0.0013, -0.0016, 0.0))


async def test_a_drone_that_stands_is_told_nothing_but_to_go_on_filming() -> None:
    camera = BoardCamera(CAMERA, parse_board(DEFAULT_BOARD))
    poses = various_poses(camera, 14, np.random.default_rng(3))
    pictures = [camera.picture(*pose) for pose in poses]
    async with rig(pictures=pictures, each=14) as made, Fleet(made.fleet) as fleet:
        (drone,) = fleet.drones.values()
        desk = Calibrations(
            fleet.drones, lambda: False, EventStream(), gathering=GatherConfig(12, 60.0, 0.05)
        )
        drone_id = drone.config.id
        async with asyncio.timeout(90.0):
            assert await fleet.connect() == {}
            desk.start(drone_id)
            while desk.record(drone_id).state in ("collecting", "solving"):  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        record = desk.record(drone_id)
        assert record.result is not None, record.reason
        assert record.result.calibration.intrinsics.fx == pytest.approx(CAMERA.fx, rel=0.01)
        await desk.apply(drone_id)
        assert drone.config.intrinsics == record.result.calibration.intrinsics
        # What a drone hears is all that was said to it; whatever ends in ? only asks.
        told = {word.split()[0] for word in made.heard if not word.endswith("?")}
        assert told <= {"command", "streamon", "setbitrate"}
        assert made.drones[0].airframe.phase == "standing"
        await desk.close()
