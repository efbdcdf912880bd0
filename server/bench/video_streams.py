"""Video as hovering drones send it, encoded beforehand: a loop of datagrams per picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS
from server.geometry.poses import camera_pose
from server.sim.config import DynamicsConfig, SimConfig
from server.sim.encoder import VideoEncoder
from server.sim.scenes.catalogue import load_object
from server.sim.world import World

# The loop holds an even number of key pictures, one a second: two in a row must differ in their
# number, which alternates.
LOOP_PICTURES = 120
# Pictures before the loop, until the encoder's rate has settled.
_LEAD_IN = 60
# A real drone's: key pictures of 35 kB, others of 10 kB.
BITRATE_KBIT_S = 2500
# A key picture's datagrams begin with this kind of NAL unit.
_SEQUENCE_SET = 7
# Grain of a small camera indoors, grey levels.
_GRAIN = 2.5

Stream = list[list[bytes]]


def hovering_stream(scene: str, index: int, fps: float, seed: int) -> Stream:
    """Return the datagrams of each picture of a loop, which begins with a key picture.

    Args:
        scene: What the drone looks at.
        index: The drone's number in its fleet, from 0.
        fps: Pictures per second.
        seed: Seed of the room, the sway and the grain.
    """
    rng = np.random.default_rng((seed, index))
    world = World(load_object(scene), seed=seed)
    encoder = VideoEncoder(TELLO_INTRINSICS.width, TELLO_INTRINSICS.height, fps, BITRATE_KBIT_S)
    stream: Stream = []
    try:
        for number in range(-_LEAD_IN, LOOP_PICTURES):
            image = _grainy(world.render(_swaying_pose(index, number / LOOP_PICTURES)), rng)
            datagrams = encoder.encode(image, (_LEAD_IN + number) / fps, key=number == 0)
            if number >= 0:
                stream.append(datagrams)
    finally:
        world.close()
    return stream


def next_key(stream: Stream, at: int) -> int:
    """Return the place of the first key picture from ``at`` on, around the loop."""
    places = (place % len(stream) for place in range(at, at + len(stream)))
    return next(place for place in places if stream[place][0][4] & 0x1F == _SEQUENCE_SET)


def _swaying_pose(index: int, turn: float) -> NDArray[np.float64]:
    """Return ``T_world_cam`` of a drone that hovers where it took off; ``turn`` from 0 to 1."""
    config, dynamics = SimConfig(), DynamicsConfig()
    angle = 2.0 * np.pi * (turn + 0.25 * index)
    azimuth = np.deg2rad(config.azimuth_deg(index)) + 0.03 * np.sin(angle)
    radius_m = config.start_radius_m + 0.03 * np.cos(2.0 * angle)
    place = np.array(
        [
            radius_m * np.cos(azimuth),
            radius_m * np.sin(azimuth),
            dynamics.take_off_height_m + 0.03 * np.sin(2.0 * angle),
        ]
    )
    yaw_rad = azimuth + np.pi + 0.04 * np.cos(angle)
    return camera_pose(place, yaw_rad, np.deg2rad(dynamics.tilt_deg))


def _grainy(image_bgr: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    grain = rng.standard_normal(image_bgr.shape[:2], np.float32)[..., None] * np.float32(_GRAIN)
    return np.clip(image_bgr + grain, 0.0, 255.0).astype(np.uint8)
