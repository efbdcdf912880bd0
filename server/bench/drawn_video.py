"""A flight whose mission looks at the room itself, drawn picture by picture.

Drawn at single size and not coded: the mission's eyes look at a quarter of it. The pictures that
are kept are drawn again afterwards at twice the size and sent through the drone's video coding
(``server.bench.poses_pictures``), at the same true poses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.bench.poses_flight import FlownCapture, TrueView, fly_capture
from server.mission.commands import Mode
from server.mission.config import FlightConfig
from server.sim.camera import SimulatedCamera, canvas_intrinsics
from server.sim.config import SimConfig
from server.sim.scenes.catalogue import load_object
from server.sim.world import World


def fly_drawn_capture(
    scene: str,
    seed: int,
    pictures: int,
    folder: Path,
    *,
    mode: Mode = "optimized",
    drones: int = 4,
    config: FlightConfig | None = None,
) -> FlownCapture:
    """Fly a capture, as ``poses_flight.fly_capture``, with drawn video: in minutes, not seconds."""
    videos: list[_DrawnVideo] = []

    def make_video(sim: SimConfig) -> _DrawnVideo:
        videos.append(_DrawnVideo(sim))
        return videos[-1]

    try:
        return fly_capture(
            scene,
            seed,
            pictures,
            folder,
            mode=mode,
            drones=drones,
            config=config,
            make_video=make_video,
        )
    finally:
        for video in videos:
            video.close()


class _DrawnVideo:
    """The cameras of all drones of one simulation; a ``Video``."""

    def __init__(self, sim: SimConfig) -> None:
        self._cameras = {
            sim.drone_id(i): SimulatedCamera(sim.camera, sim.seed, i) for i in range(sim.drones)
        }
        self._world = World(
            load_object(sim.scene), intrinsics=canvas_intrinsics(sim.camera), seed=sim.seed
        )

    def picture(self, drone_id: str, view: TrueView, at_s: float) -> NDArray[np.uint8]:
        """Return the picture ``(720, 960, 3)`` BGR that a drone takes."""
        drawn = self._world.render(view.T_world_cam, view.others)
        return self._cameras[drone_id].take(drawn, view.motion, at_s)

    def close(self) -> None:
        """Free the picture buffer."""
        self._world.close()
