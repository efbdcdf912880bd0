"""Where people set the drones down: the same places the pilot believes them at."""

from __future__ import annotations

import numpy as np

from server.geometry.cameras import TELLO_INTRINSICS
from server.mission.commands import StartPlace
from server.planner.ring import facing
from server.swarm.config import DroneConfig


def start_place(drone: DroneConfig, radius_m: float) -> StartPlace:
    """Return the place of ``drone`` on a start circle of ``radius_m``, facing its middle."""
    start = facing(np.zeros(3), float(np.deg2rad(drone.azimuth_deg)), radius_m, 0.0)
    return StartPlace(
        drone_id=drone.id,
        name=drone.label,
        colour=drone.colour,
        address=drone.address,
        serial=drone.serial,
        x_m=float(start.position_world[0]),
        y_m=float(start.position_world[1]),
        yaw_rad=float(start.yaw_rad),
        focal_px=drone.intrinsics.fx,
        tilt_deg=drone.tilt_deg,
        calibrated=drone.intrinsics != TELLO_INTRINSICS,
    )
