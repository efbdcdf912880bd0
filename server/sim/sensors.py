"""What a simulated Tello's sensors say and where its camera is, from the true state; pure.

Symbols: ``yaw_rad`` is counter-clockwise about +Z, vectors named body are forward, left, up (FLU).
What comes out is in the drone's own units and axes: forward, right, down; centimetres, degrees,
decimetres per second, thousandths of g.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle

Vector = tuple[float, float, float]

GRAVITY_M_S2 = 9.80665

_MILLI_G = 1000.0 / GRAVITY_M_S2
_TOF_NEAREST_CM = 15.0
_TOF_FURTHEST_CM = 800.0
_TOF_NOTHING_NEAR = 10
_TOF_NOTHING_FAR = 6553


@dataclass(frozen=True, slots=True)
class TrueState:
    """What the sensors measure.

    Attributes:
        height_m: Body above the floor, metres.
        yaw_rad: Heading as the drone itself believes it, zero at power-on.
        velocity_body: Speed over the floor, FLU, metres per second.
        acceleration_body: FLU, metres per second squared, gravity left out.
        lean_rad: Nose down and right side down.
        moving: True unless it stands.
        sees_floor: False when the downward camera has nothing to hold on to.
        battery_pct: Charge, percent.
        temperature_c: Main board, degrees Celsius.
        motor_time_s: Seconds the motors have run since power-on.
        baro_zero_m: The barometer's arbitrary zero, metres.
    """

    height_m: float
    yaw_rad: float
    velocity_body: Vector
    acceleration_body: Vector
    lean_rad: tuple[float, float]
    moving: bool
    sees_floor: bool
    battery_pct: float
    temperature_c: float
    motor_time_s: float
    baro_zero_m: float


def readings_of(state: TrueState, noise: Callable[[], float]) -> dict[str, float]:
    """Return the values of one state report, in its order.

    Args:
        state: The truth.
        noise: Draws from the standard normal distribution.
    """
    forward, left, up = state.velocity_body
    if not state.sees_floor:
        forward = left = up = 0.0
    elif state.moving:
        forward += 0.04 * noise()
        left += 0.04 * noise()
        up += 0.04 * noise()
    a_forward, a_left, a_up = state.acceleration_body
    tof_cm = 100.0 * state.height_m + 8.0 + noise()
    if tof_cm < _TOF_NEAREST_CM:
        tof = _TOF_NOTHING_NEAR
    else:
        tof = _TOF_NOTHING_FAR if tof_cm > _TOF_FURTHEST_CM else round(tof_cm)
    return {
        "pitch": round(math.degrees(-state.lean_rad[0]) + 0.3 * noise()),
        "roll": round(math.degrees(state.lean_rad[1]) + 0.3 * noise()),
        "yaw": round(math.degrees(-wrap_angle(state.yaw_rad))),
        "vgx": round(10.0 * forward),
        "vgy": round(-10.0 * left),
        "vgz": round(-10.0 * up),
        "templ": round(state.temperature_c - 3.0),
        "temph": round(state.temperature_c),
        "tof": tof,
        "h": 10 * round(10.0 * state.height_m),
        "bat": math.ceil(state.battery_pct),
        "baro": state.baro_zero_m + state.height_m + 0.1 * noise(),
        "time": int(state.motor_time_s),
        "agx": a_forward * _MILLI_G + 5.0 * noise(),
        "agy": -a_left * _MILLI_G + 5.0 * noise(),
        "agz": -(a_up + GRAVITY_M_S2) * _MILLI_G + 5.0 * noise(),
    }


def camera_from_angles(
    centre: Vector, yaw_rad: float, nose_down_rad: float, right_down_rad: float
) -> NDArray[np.float64]:
    """Return ``T_world_cam`` ``(4, 4)`` of a camera that leans.

    The same as ``camera_pose`` turned about its own axis, written out because a simulation asks
    for it many times a second.

    Args:
        centre: Camera centre, world metres.
        yaw_rad: Heading, counter-clockwise about +Z.
        nose_down_rad: Optical axis below the horizon.
        right_down_rad: Clockwise turn about the optical axis, seen from behind.
    """
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    cn, sn = math.cos(nose_down_rad), math.sin(nose_down_rad)
    cr, sr = math.cos(right_down_rad), math.sin(right_down_rad)
    right = (sy, -cy, 0.0)
    down = (-sn * cy, -sn * sy, -cn)
    ahead = (cn * cy, cn * sy, -sn)
    T = np.eye(4)
    for row in range(3):
        T[row, 0] = cr * right[row] + sr * down[row]
        T[row, 1] = cr * down[row] - sr * right[row]
        T[row, 2] = ahead[row]
        T[row, 3] = centre[row]
    return T
