"""How a simulated Tello moves; pure, stepped by the caller.

Symbols: positions are the body's centre in world metres, ``yaw_rad`` is counter-clockwise about
+Z, velocities world metres per second unless the name says body (FLU). Sticks are (right, forward,
up, clockwise), -100..100. Vectors are tuples of floats inside, because thousands of hours are
flown in steps of 20 ms; the surface gives arrays.

Each drone has stick gains of its own, drifts, and turns unnoticed by its own compass-less yaw; the
velocity it reports has a scale of its own and lags. Collisions are not simulated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle
from server.sim.camera import CameraMotion
from server.sim.config import DynamicsConfig
from server.sim.manoeuvres import Flip, Manoeuvre
from server.sim.sensors import GRAVITY_M_S2, TrueState, Vector, camera_from_angles, readings_of
from server.sim.sticks import stick_speed
from server.sim.whims import Whims

Array = NDArray[np.float64]
Phase = Literal["standing", "taking_off", "flying", "landing", "falling"]
Sticks = tuple[float, float, float, float]

_NOWHERE: Vector = (0.0, 0.0, 0.0)
_CENTRED: Sticks = (0.0, 0.0, 0.0, 0.0)
_LEAN_MAX_RAD = math.radians(3.0)
_LEAN_LAG_S = 0.15
_PRETENCE_S = 4.0  # A take-off that is confirmed but does not happen takes as long as one.


class Airframe:
    """One drone's body, battery and sensors.

    Attributes:
        yaw_rad: True heading.
        phase: What it is doing.
        sticks: Stick positions in force.
        manoeuvre: Motion under way, None when the sticks fly.
        battery_pct: Charge.
        temperature_c: Board temperature.
        motor_time_s: Seconds the motors have run since power-on.
        finished: True for the one step in which a manoeuvre, take-off or landing ended.
        spinning: True while the motors idle on the ground to cool the board.
        whims: What it does unasked.
        sees_floor: False when its downward camera has nothing to hold on to.
        heat_c: Temperature something holds the board at; None: its own.
        stays_down: When True a take-off ends as usual, without leaving the ground.
    """

    def __init__(
        self,
        position: Array | Sequence[float],
        yaw_rad: float,
        config: DynamicsConfig,
        rng: np.random.Generator,
    ) -> None:
        self._at = _vector(position)
        self.yaw_rad = yaw_rad
        self._moving = _NOWHERE
        self.phase: Phase = "standing"
        self.sticks: Sticks = _CENTRED
        self.manoeuvre: Manoeuvre | Flip | None = None
        self.battery_pct = config.battery_pct
        self.temperature_c = 45.0
        self.finished = False
        self.spinning = False
        self.sees_floor = True
        self.heat_c: float | None = None
        self.stays_down = False
        self._config = config
        self._rng = rng
        self._gains = [1.0 + config.gain_sigma * float(n) for n in rng.standard_normal(4)]
        self._tilt_rad = math.radians(
            config.tilt_deg + config.tilt_sigma_deg * rng.standard_normal()
        )
        self._speed_scale = 1.0 + config.speed_scale_sigma * float(rng.standard_normal())
        self.whims = Whims(config, rng)
        self._dt_s = 0.0
        self._pretence_s = 0.0
        self.power_on()
        self._stand()

    # Surface ---------------------------------------------------------------------------------

    @property
    def position(self) -> Array:
        """Body centre ``(3,)``, world metres; a copy, so assign a whole new one to move it."""
        return _frozen(self._at)

    @position.setter
    def position(self, position: Array | Sequence[float]) -> None:
        self._at = _vector(position)

    @property
    def velocity(self) -> Array:
        """World velocity ``(3,)`` over the floor, drift and wind included, metres per second."""
        return _frozen(self._moving)

    @property
    def height_m(self) -> float:
        """Height of the body above the floor, metres."""
        return self._at[2]

    @property
    def motors_on(self) -> bool:
        """True while the propellers carry it."""
        return self.phase in ("taking_off", "flying", "landing")

    # Orders ----------------------------------------------------------------------------------

    def power_on(self) -> None:
        """Forget what a restart forgets: its own heading, the motor clock, the barometer's zero."""
        self.motor_time_s = 0.0
        self._baro_zero_m = float(self._rng.uniform(-100.0, 100.0))
        self._power_on_yaw_rad = self.yaw_rad
        self._unseen_yaw_rad = 0.0
        self.sticks = _CENTRED

    def take_off(self) -> None:
        """Start climbing to the hover height."""
        self.spinning = False
        if self.stays_down:
            self._pretence_s = _PRETENCE_S
        else:
            self.phase = "taking_off"

    def land(self) -> None:
        """Start sinking."""
        self.phase = "landing"
        self.manoeuvre = None

    def stop(self) -> None:
        """Hover: end any motion, also a take-off or landing that is under way."""
        self.manoeuvre = None
        self.sticks = _CENTRED
        self._pretence_s = 0.0
        if self.phase in ("taking_off", "landing"):
            self.phase = "flying"

    def cut(self) -> None:
        """Motors off: the drone falls."""
        self.manoeuvre = None
        self.spinning = False
        self._pretence_s = 0.0
        self.phase = "falling" if self._at[2] > 0.0 else "standing"

    def fly(self, forward_m: float, left_m: float, up_m: float, speed_m_s: float) -> None:
        """Fly a body-relative way."""
        goal = self._from_body((forward_m, left_m, up_m))
        self.manoeuvre = Manoeuvre.straight(self._at, goal, speed_m_s)

    def fly_arc(self, via_body: Vector, end_body: Vector, speed_m_s: float) -> None:
        """Fly the arc through two body-relative points, metres; ValueError if there is none."""
        via, end = self._from_body(via_body), self._from_body(end_body)
        self.manoeuvre = Manoeuvre.arc(self._at, via, end, speed_m_s)

    def turn(self, left_rad: float) -> None:
        """Turn on the spot, counter-clockwise positive."""
        self.manoeuvre = Manoeuvre.turn(self._at, left_rad)

    def flip(self, direction: str) -> None:
        """Turn over once towards ``direction``: l, r, f or b."""
        self.manoeuvre = Flip(direction)

    # Motion ----------------------------------------------------------------------------------

    def step(self, dt_s: float) -> None:
        """Advance by ``dt_s`` seconds, at most a tenth of a second at once."""
        self.finished = False
        if dt_s != self._dt_s:
            self._dt_s = dt_s
            self._follow = 1.0 - math.exp(-dt_s / self._config.lag_s)
            self._lean_follow = 1.0 - math.exp(-dt_s / _LEAN_LAG_S)
            lag_s = self._config.speed_lag_s
            self._measure = 1.0 - math.exp(-dt_s / lag_s) if lag_s > 0.0 else 1.0
        self._wear(dt_s)
        if self.phase == "standing":
            if self._pretence_s > 0.0:
                self._pretence_s -= dt_s
                self.finished = self._pretence_s <= 0.0
            return
        if self.phase == "falling":
            self._fall(dt_s)
            return
        (wx, wy, wz), turn_rad_s = self._wanted(dt_s)
        follow = self._follow
        sx, sy, sz = self._steered
        self._steered = sx, sy, sz = (
            sx + follow * (wx - sx),
            sy + follow * (wy - sy),
            sz + follow * (wz - sz),
        )
        self._turn_rad_s += follow * (turn_rad_s - self._turn_rad_s)
        ux, uy, uz = self.whims.velocity(dt_s, self.sees_floor)
        before = self._moving
        self._moving = vx, vy, vz = sx + ux, sy + uy, sz + uz
        self._acceleration = (
            (vx - before[0]) / dt_s,
            (vy - before[1]) / dt_s,
            (vz - before[2]) / dt_s,
        )
        felt, measured = self._felt, self._measure
        self._felt = (
            felt[0] + measured * (vx - felt[0]),
            felt[1] + measured * (vy - felt[1]),
            felt[2] + measured * (vz - felt[2]),
        )
        x, y, z = self._at
        self._at = x + vx * dt_s, y + vy * dt_s, z + vz * dt_s
        self._turn(dt_s)
        self._sway(dt_s)
        self._conclude()

    def _wanted(self, dt_s: float) -> tuple[Vector, float]:
        """Return the world velocity and counter-clockwise rate that phase and sticks ask for."""
        height_m = self._at[2]
        if self.phase == "taking_off":
            missing_m = self._config.take_off_height_m - height_m
            return (0.0, 0.0, min(self._config.climb_m_s, 1.5 * missing_m + 0.03)), 0.0
        if self.phase == "landing":
            slow = 0.5 if height_m < 0.3 else 1.0
            return (0.0, 0.0, -slow * self._config.sink_m_s), 0.0
        if self.manoeuvre is not None:
            return self.manoeuvre.wanted(self._at, dt_s)
        if self.sticks == _CENTRED:
            return _NOWHERE, 0.0
        dead_zone = self._config.dead_zone
        right, forward, up, clockwise = (
            self._gains[axis] * stick_speed(axis, self.sticks[axis], dead_zone) for axis in range(4)
        )
        if height_m <= 0.1 and up < 0:
            up = 0.0  # The drone does not push itself into the ground.
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (c * forward + s * right, s * forward - c * right, up), -clockwise

    def _turn(self, dt_s: float) -> None:
        unseen = self.whims.turn_rad(dt_s)
        self._unseen_yaw_rad += unseen
        turned = self._turn_rad_s * dt_s
        self._heading_rad_s = self._turn_rad_s + unseen / dt_s
        self.yaw_rad = wrap_angle(self.yaw_rad + turned + unseen)
        if self.manoeuvre is not None:
            self.manoeuvre.turned(turned)

    def _sway(self, dt_s: float) -> None:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ax, ay, _ = self._acceleration
        # It leans towards where it accelerates: nose down forwards, right side down rightwards.
        pitch = self._config.sway * math.atan((c * ax + s * ay) / GRAVITY_M_S2)
        roll = self._config.sway * math.atan((s * ax - c * ay) / GRAVITY_M_S2)
        pitch = max(-_LEAN_MAX_RAD, min(_LEAN_MAX_RAD, pitch))
        roll = max(-_LEAN_MAX_RAD, min(_LEAN_MAX_RAD, roll))
        follow = self._lean_follow
        p, r = self._lean
        before = self.whims.shake
        self._lean = lean = p + follow * (pitch - p), r + follow * (roll - r)
        self.whims.shake_on()
        shake = self.whims.shake
        self._swaying_rad_s = (
            (lean[0] - p + shake[0] - before[0]) / dt_s,
            (lean[1] - r + shake[1] - before[1]) / dt_s,
            (shake[2] - before[2]) / dt_s,
        )

    def _conclude(self) -> None:
        height_m = self._at[2]
        if self.phase == "taking_off" and height_m >= self._config.take_off_height_m - 0.02:
            self.phase = "flying"
            self.finished = True
        elif self.phase == "landing" and height_m <= 0.0:
            self._touch_down()
            self.finished = True
        elif self.manoeuvre is not None and self.manoeuvre.over(self._at, self._turn_rad_s):
            self.manoeuvre = None
            self.finished = True
        if self._at[2] < 0.0:
            self._at = self._at[0], self._at[1], 0.0

    def _fall(self, dt_s: float) -> None:
        vx, vy, vz = self._moving
        x, y, z = self._at
        vz -= GRAVITY_M_S2 * dt_s
        self._moving = self._felt = vx, vy, vz
        self._at = x + vx * dt_s, y + vy * dt_s, z + vz * dt_s
        if self._at[2] <= 0.0:
            self._touch_down()

    def _touch_down(self) -> None:
        self.phase = "standing"
        self._at = self._at[0], self._at[1], 0.0
        self._stand()

    def _stand(self) -> None:
        self._moving = self._felt = self._steered = self._acceleration = _NOWHERE
        self._turn_rad_s = self._heading_rad_s = 0.0
        self._swaying_rad_s = _NOWHERE
        self._lean = (0.0, 0.0)  # Nose-down and right-side-down of the stabilised picture.
        self.whims.calm()

    def _wear(self, dt_s: float) -> None:
        in_use = self.spinning or self.phase in ("taking_off", "flying", "landing")
        life_s = self._config.flight_time_s if in_use else self._config.idle_time_s
        self.battery_pct = max(0.0, self.battery_pct - 100.0 * dt_s / life_s)
        # Propellers cool: standing with the video on is what heats the board.
        settled_c = 72.0 if in_use else 85.0
        self.temperature_c += (settled_c - self.temperature_c) * dt_s / 90.0
        if self.heat_c is not None:
            self.temperature_c = self.heat_c
        if in_use:
            self.motor_time_s += dt_s

    # What it sees and says -------------------------------------------------------------------

    def T_world_cam(self) -> Array:
        """Return the true camera pose ``(4, 4)``, lean, shake and flips included."""
        config = self._config
        x, y, z = self._at
        ahead = config.camera_offset_m
        centre = (
            x + ahead * math.cos(self.yaw_rad),
            y + ahead * math.sin(self.yaw_rad),
            z + config.camera_height_m,
        )
        shake = self.whims.shake
        over = self.manoeuvre.lean_rad() if isinstance(self.manoeuvre, Flip) else (0.0, 0.0)
        nose_down = self._tilt_rad + self._lean[0] + shake[0] + over[0]
        right_down = self._lean[1] + shake[1] + over[1]
        return camera_from_angles(centre, self.yaw_rad + shake[2], nose_down, right_down)

    def T_world_down_cam(self) -> Array:
        """Return the pose ``(4, 4)`` of the camera that looks at the floor, nose side up."""
        return camera_from_angles(self._at, self.yaw_rad, math.pi / 2, 0.0)

    def camera_motion(self) -> CameraMotion:
        """Return how the camera moves; flips, which no picture is taken in, are left out."""
        R_cam_world = self.T_world_cam()[:3, :3].T
        nose_down, right_down, left = self._swaying_rad_s
        up = R_cam_world[:, 2] * (self._heading_rad_s + left)
        # The camera's axes point right, down and ahead.
        angular = up + np.array([-nose_down, 0.0, right_down])
        return CameraMotion(angular, R_cam_world @ np.array(self._moving))

    def readings(self) -> dict[str, float]:
        """Return what the sensors say now, in the drone's units and axes (FRD, cm, dm/s)."""
        sway = max(self._config.sway, 1e-6)
        state = TrueState(
            height_m=self._at[2],
            yaw_rad=self.yaw_rad - self._unseen_yaw_rad - self._power_on_yaw_rad,
            velocity_body=self._to_body(_scaled(self._felt, self._speed_scale)),
            acceleration_body=self._to_body(self._acceleration),
            lean_rad=(self._lean[0] / sway, self._lean[1] / sway),
            moving=self.phase != "standing",
            sees_floor=self.sees_floor,
            battery_pct=self.battery_pct,
            temperature_c=self.temperature_c,
            motor_time_s=self.motor_time_s,
            baro_zero_m=self._baro_zero_m,
        )
        return readings_of(state, self.whims.normal)

    def _to_body(self, world: Vector) -> Vector:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return c * world[0] + s * world[1], c * world[1] - s * world[0], world[2]

    def _from_body(self, way: Vector) -> Vector:
        """Return the world point a body-relative way (FLU) leads to."""
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        x, y, z = self._at
        return x + c * way[0] - s * way[1], y + s * way[0] + c * way[1], z + way[2]


def _vector(values: Array | Sequence[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _scaled(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def _frozen(vector: Vector) -> Array:
    """Return an array that cannot be written to: writing would move nothing."""
    array = np.array(vector)
    array.flags.writeable = False
    return array
