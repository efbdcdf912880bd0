"""Fine-tuning on the box, the paper's PID, and the straight flight to a viewpoint.

The box of the object is compared with where and how large the viewpoint wants it. Sideways error
moves the drone sideways (roll), vertical error moves it up or down (throttle), size moves it
forward or back (pitch), and equation 4 turns it (yaw).

Symbols: picture x to the right and y down; body forward, left, up; yaw counter-clockwise. A
bearing beta is the angle of the box's centre left of the optical axis; d is the wanted distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle
from server.geometry.cameras import Intrinsics
from server.planner.config import PidGains, TrackingConfig
from server.planner.errors import PlanError
from server.stages import HOVER, Box, CameraPose, SeedGeometry, Setpoint, Viewpoint

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class WantedView:
    """How the picture shall look from a viewpoint.

    Attributes:
        xyxy_px: Wanted box ``(4,)`` of the object, pixels; it may reach beyond the picture.
        normal_world: n_box of equation 4, horizontal unit vector ``(3,)`` from the box's centroid
            towards the viewpoint.
        bearing_rad: Bearing of the box's centroid left of straight ahead, when all is right.
        distance_m: Horizontal distance from the viewpoint to the object's centre.
        focal_px: Focal length that turns pixels into angles.
        principal_px: Principal point ``(2,)``.
    """

    xyxy_px: Array
    normal_world: Array
    bearing_rad: float
    distance_m: float
    focal_px: float
    principal_px: Array


def expected_box(
    seed: SeedGeometry, viewpoint: Viewpoint, intrinsics: Intrinsics, tilt_rad: float
) -> Array:
    """Return the box ``(4,)`` left, top, right, bottom, pixels, that ``seed`` has from a viewpoint.

    Raises:
        PlanError: If part of the object is beside or behind the camera.
    """
    corners = np.concatenate([box.corners for box in (seed.boxes or (seed.outer,))])
    pixels, depths = intrinsics.project(corners, viewpoint.T_world_cam(tilt_rad))
    if (depths <= 0.05).any():
        raise PlanError("the object is not wholly in front of the viewpoint")
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def wanted_view(
    seed: SeedGeometry, viewpoint: Viewpoint, intrinsics: Intrinsics, tilt_rad: float
) -> WantedView:
    """Return how the object shall look from ``viewpoint``; raises like ``expected_box``."""
    xyxy = expected_box(seed, viewpoint, intrinsics, tilt_rad)
    distance = float(np.hypot(*(viewpoint.position_world - seed.outer.centre)[:2]))
    if distance < 1e-6:
        raise PlanError("the viewpoint is straight above the object")
    principal = np.array([intrinsics.cx, intrinsics.cy])
    bearing = float(np.arctan2(principal[0] - (xyxy[0] + xyxy[2]) / 2.0, intrinsics.fx))
    sight = viewpoint.yaw_rad + bearing
    return WantedView(
        xyxy_px=xyxy,
        normal_world=-np.array([np.cos(sight), np.sin(sight), 0.0]),
        bearing_rad=bearing,
        distance_m=distance,
        focal_px=intrinsics.fx,
        principal_px=principal,
    )


class BoxTracker:
    """The four PID loops of one drone.

    ``update`` is called at the rate of its boxes; the state is the integrals and the last errors.
    """

    def __init__(self, config: TrackingConfig) -> None:
        self._config = config
        self._axes = {
            "roll": _Pid(config.roll, config.derivative_time_s, config.speed_max_m_s),
            "pitch": _Pid(config.pitch, config.derivative_time_s, config.speed_max_m_s),
            "throttle": _Pid(config.throttle, config.derivative_time_s, config.speed_max_m_s),
            "yaw": _Pid(config.yaw, config.derivative_time_s, config.yaw_rate_max_rad_s),
        }

    def reset(self) -> None:
        """Forget integrals and last errors, as before a new viewpoint."""
        for axis in self._axes.values():
            axis.reset()

    def update(
        self, box: Box | None, pose: CameraPose, wanted: WantedView, dt_s: float
    ) -> Setpoint:
        """Return what the drone shall do.

        Args:
            box: Newest box, or None when the object was not found or the box is stale.
            pose: Believed pose; equation 4 needs its heading.
            wanted: What the viewpoint wants to see.
            dt_s: Time since the last update.

        Returns:
            A setpoint; hover without a box.

        Raises:
            ValueError: If ``dt_s`` is not positive.
        """
        if dt_s <= 0:
            raise ValueError("dt_s must be positive")
        if box is None or (box.size_px <= 0).any():
            self.reset()
            return HOVER
        errors = box_errors(box, pose, wanted, self._config.heading_share)
        left = self._axes["roll"].update(errors.left_m, dt_s)
        forward = self._axes["pitch"].update(errors.forward_m, dt_s)
        up = self._axes["throttle"].update(errors.up_m, dt_s)
        turning = self._axes["yaw"].update(errors.yaw_rad, dt_s)
        velocity = np.array([forward, left, up])
        speed = float(np.linalg.norm(velocity))
        if speed > self._config.speed_max_m_s:
            velocity *= self._config.speed_max_m_s / speed
        return Setpoint(velocity, turning)


@dataclass(frozen=True, slots=True)
class BoxErrors:
    """How far the drone seems to be from its viewpoint; it shall move by these.

    Attributes:
        forward_m: From the apparent size; 0 when the box touches the picture's edge.
        left_m: From the centroid's x.
        up_m: From the centroid's y.
        yaw_rad: From equation 4, counter-clockwise.
    """

    forward_m: float
    left_m: float
    up_m: float
    yaw_rad: float


def box_errors(box: Box, pose: CameraPose, wanted: WantedView, heading_share: float) -> BoxErrors:
    """Return the errors of the four axes.

    Equation 4 is the cosine of the angle between the box's normal and the direction from the
    object to the camera, which here comes from heading and bearing of the box alone, without the
    believed position; its sign is that of the turn between the two. A drone that stands too far to
    the right sees the object too far left, and the angle is positive.
    """
    wanted_centre = (wanted.xyxy_px[:2] + wanted.xyxy_px[2:]) / 2.0
    right_px, down_px = box.centroid_px - wanted_centre
    metres_per_px = wanted.distance_m / wanted.focal_px
    bearing = float(np.arctan2(wanted.principal_px[0] - box.centroid_px[0], wanted.focal_px))
    sight = pose.yaw_rad + bearing
    to_camera = -np.array([np.cos(sight), np.sin(sight)])
    normal = wanted.normal_world[:2]
    around = float(
        np.arctan2(normal[0] * to_camera[1] - normal[1] * to_camera[0], normal @ to_camera)
    )
    wanted_size = wanted.xyxy_px[2:] - wanted.xyxy_px[:2]
    ratio = float(np.sqrt(np.prod(wanted_size) / np.prod(box.size_px)))
    forward = 0.0 if box.touches_edge else wanted.distance_m * (ratio - 1.0)
    # Heading too far to the left shows the object too far right: bearing falls short of wanted.
    heading = around - wrap_angle(bearing - wanted.bearing_rad)
    yaw_rad = heading_share * heading + (1.0 - heading_share) * around
    return BoxErrors(
        forward_m=forward,
        left_m=-float(right_px) * metres_per_px,
        up_m=-float(down_px) * metres_per_px,
        yaw_rad=-wrap_angle(yaw_rad),
    )


def fly_to(pose: CameraPose, viewpoint: Viewpoint, config: TrackingConfig) -> tuple[Array, float]:
    """Return velocity ``(3,)``, world m/s, and yaw rate, rad/s, straight towards a viewpoint."""
    offset = viewpoint.position_world - pose.position_world
    distance = float(np.linalg.norm(offset))
    speed = min(config.travel_speed_m_s, config.travel_gain * distance)
    velocity = offset * (speed / distance) if distance > 1e-9 else np.zeros(3)
    return velocity, yaw_rate_to(pose.yaw_rad, viewpoint.yaw_rad, config)


def yaw_rate_to(yaw_rad: float, wanted_rad: float, config: TrackingConfig) -> float:
    """Return the yaw rate in rad/s that turns the shorter way from one heading to another."""
    rate = config.yaw.p * wrap_angle(wanted_rad - yaw_rad)
    return min(max(rate, -config.yaw_rate_max_rad_s), config.yaw_rate_max_rad_s)


class _Pid:
    """One axis: error in, rate out; the derivative is taken of the filtered error."""

    def __init__(self, gains: PidGains, derivative_time_s: float, limit: float) -> None:
        self._gains = gains
        self._derivative_time_s = derivative_time_s
        self._limit = limit
        self.reset()

    def reset(self) -> None:
        self._integral = 0.0
        self._filtered: float | None = None

    def update(self, error: float, dt_s: float) -> float:
        gains = self._gains
        slope = 0.0
        if self._filtered is None:
            self._filtered = error
        else:
            blend = dt_s / (self._derivative_time_s + dt_s)
            change = blend * (error - self._filtered)
            self._filtered += change
            slope = change / dt_s
        self._integral += gains.i * error * dt_s
        self._integral = float(np.clip(self._integral, -gains.integral_limit, gains.integral_limit))
        output = gains.p * error + self._integral + gains.d * slope
        return float(np.clip(output, -self._limit, self._limit))
