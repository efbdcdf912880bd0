"""One drone as the pilot knows it: what is believed of it, and what is wanted of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.mission.config import FlightConfig
from server.mission.eyes import Eye, Sight
from server.planner.tracking import BoxTracker, WantedView
from server.stages import Box, CameraPose, Viewpoint
from server.swarm.drone import Drone
from server.vision.localization import PoseFilter, TargetEstimator

Array = NDArray[np.float64]

# A box older than this says nothing about where the drone is now.
_STALE_S = 0.6
# Boxes of less confidence are shown but correct no pose.
_SURE_ENOUGH = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """See the object whole and centred from an azimuth about it."""

    azimuth_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Fly:
    """Be at a viewpoint."""

    viewpoint: Viewpoint


@dataclass(frozen=True, slots=True, eq=False)
class Trim:
    """See the object as the viewpoint wants it seen."""

    viewpoint: Viewpoint
    wanted: WantedView


class Wing:
    """One drone with its beliefs and its goal.

    Attributes:
        drone: The drone.
        eye: What it sees.
        start: Its nominal start place.
        tilt_rad: How far its camera looks down.
        goal: What is wanted of it, None for nothing.
        radius_m: How far out it centres the object.
        tracker: Its PID loops.
        flown: True once it has taken off since it was last set down at its start place.
        filter: What is believed of its pose.
    """

    def __init__(self, drone: Drone, eye: Eye, start: Viewpoint, config: FlightConfig) -> None:
        self.drone = drone
        self.eye = eye
        self.start = start
        self.tilt_rad = float(np.deg2rad(drone.config.tilt_deg))
        self.goal: Centre | Fly | Trim | None = None
        self.radius_m = float(np.hypot(*start.position_world[:2]))
        self.tracker = BoxTracker(config.planner.tracking)
        self.flown = False
        self._config = config
        self._sequence = -1
        self._motor_time_s = 0.0
        self.place_at_start()

    def place_at_start(self) -> None:
        """Believe the drone to stand at its nominal start place."""
        self.filter = PoseFilter(
            self.drone.config.id,
            self.start.position_world,
            self.start.yaw_rad,
            self._config.vision.localization,
            self.drone.config.intrinsics,
            self.tilt_rad,
        )

    def fresh_sight(self, now_s: float) -> Sight | None:
        """Return the newest sight unless it is stale."""
        sight = self.eye.sight
        if sight is None or now_s - sight.frame.captured_s > _STALE_S:
            return None
        return sight

    def fresh_box(self, now_s: float) -> Box | None:
        """Return the box of the newest sight unless that is stale."""
        sight = self.fresh_sight(now_s)
        return None if sight is None else sight.box

    def observe(self, target: TargetEstimator) -> None:
        """Take new telemetry and a new box, and share what they tell about the object."""
        telemetry = self.drone.telemetry
        if telemetry is not None:
            if telemetry.motor_time_s < self._motor_time_s:
                # It was switched off: somebody sets it down at its start place again.
                self.flown = False
            self._motor_time_s = telemetry.motor_time_s
            self.filter.observe_telemetry(telemetry)
        sight = self.eye.sight
        if sight is None or sight.frame.sequence <= self._sequence:
            return
        self._sequence = sight.frame.sequence
        # Near the floor the object fills the picture or hides behind its edge.
        usable = sight.box is not None and sight.box.confidence > _SURE_ENOUGH
        if usable and self.drone.activity in ("flying", "holding"):
            others = target.estimate(excluding=self.drone.config.id)
            assert sight.box is not None
            self.filter.observe_box(sight.box, sight.frame.captured_s, others)
            target.observe(self.drone.config.id, self.filter.target_belief())

    def velocity_world(self, pose: CameraPose) -> Array:
        """Return the reported velocity ``(3,)``, turned into the world by a believed pose."""
        telemetry = self.drone.telemetry
        if telemetry is None:
            return np.zeros(3)
        return turned(telemetry.velocity_m_s, pose.yaw_rad)


def turned(velocity: Array, angle_rad: float) -> Array:
    """Return ``velocity`` ``(3,)`` turned about +Z."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array(
        [c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]]
    )
