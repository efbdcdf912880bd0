"""How a simulated Tello moves and what its sensors say; pure, stepped by the caller.

Symbols: positions are the body's centre in world metres, ``yaw_rad`` is counter-clockwise about
+Z, velocities world metres per second unless the name says body (FLU). Sticks are (right, forward,
up, clockwise), -100..100.

The stick curve is the calibration of a real drone (1 m runs at 20-50, extrapolated above), with a
dead zone below 10 and each drone's own gains. Hover drift is an Ornstein-Uhlenbeck velocity; the
heading walks away unnoticed by the drone's own compass-less yaw. Collisions are not simulated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.axes import wrap_angle
from server.geometry.poses import camera_pose
from server.sim.config import DynamicsConfig

Array = NDArray[np.float64]
Phase = Literal["standing", "taking_off", "flying", "landing", "falling"]
Sticks = tuple[float, float, float, float]

GRAVITY_M_S2 = 9.80665

_STICK = (10.0, 20.0, 30.0, 40.0, 50.0, 70.0, 100.0)
_CURVES = (
    (0.0, 0.099, 0.174, 0.258, 0.362, 0.53, 0.80),  # Right, m/s.
    (0.0, 0.069, 0.128, 0.192, 0.287, 0.41, 0.61),  # Forward, m/s.
    (0.0, 0.042, 0.082, 0.124, 0.178, 0.26, 0.40),  # Up, m/s.
    tuple(math.radians(d) for d in (0.0, 9.1, 16.9, 25.7, 35.1, 53.8, 88.6)),  # Clockwise, rad/s.
)
_LEAN_MAX_RAD = math.radians(3.0)
_LEAN_LAG_S = 0.15
_VERTICAL_DRIFT = 0.3  # Barometer and range finder hold height better than place.


def stick_speed(axis: int, stick: float) -> float:
    """Return the steady speed along ``axis`` (0 right, 1 forward, 2 up, 3 clockwise)."""
    return math.copysign(float(np.interp(abs(stick), _STICK, _CURVES[axis])), stick)


@dataclass(slots=True)
class Manoeuvre:
    """A motion with an end: fly to a place and heading.

    Attributes:
        goal: Body position ``(3,)``, world metres.
        turn_left_rad: Turn still to make, counter-clockwise positive.
        speed_m_s: Speed on the way.
    """

    goal: Array
    turn_left_rad: float
    speed_m_s: float


class Airframe:
    """One drone's body, battery and sensors.

    Attributes:
        position: Body centre ``(3,)``, world metres.
        yaw_rad: True heading.
        velocity: World velocity ``(3,)``, drift included.
        phase: What it is doing.
        sticks: Stick positions in force.
        manoeuvre: Motion under way, None when the sticks fly.
        battery_pct: Charge.
        temperature_c: Board temperature.
        motor_time_s: Seconds the motors have run.
        finished: True for the one step in which a manoeuvre, take-off or landing ended.
    """

    def __init__(
        self, position: Array, yaw_rad: float, config: DynamicsConfig, rng: np.random.Generator
    ) -> None:
        self.position = np.array(position, float)
        self.yaw_rad = yaw_rad
        self.velocity = np.zeros(3)
        self.phase: Phase = "standing"
        self.sticks: Sticks = (0.0, 0.0, 0.0, 0.0)
        self.manoeuvre: Manoeuvre | None = None
        self.battery_pct = config.battery_pct
        self.temperature_c = 45.0
        self.motor_time_s = 0.0
        self.finished = False
        self._config = config
        self._rng = rng
        self._gains = 1.0 + config.gain_sigma * rng.standard_normal(4)
        self._tilt_rad = math.radians(
            config.tilt_deg + config.tilt_sigma_deg * rng.standard_normal()
        )
        self._gyro_bias_rad_s = math.radians(config.gyro_bias_deg_s) * rng.standard_normal()
        self._baro_zero_m = float(rng.uniform(-100.0, 100.0))
        self._power_on_yaw_rad = yaw_rad
        self._unseen_yaw_rad = 0.0
        self._steered = np.zeros(3)  # World velocity without drift.
        self._turn_rad_s = 0.0
        self._drift = np.zeros(3)
        self._acceleration = np.zeros(3)
        self._lean = np.zeros(2)  # Nose-down and right-side-down of the stabilised picture.
        self._shake = np.zeros(3)

    # Orders ----------------------------------------------------------------------------------

    @property
    def motors_on(self) -> bool:
        """True while the propellers turn."""
        return self.phase in ("taking_off", "flying", "landing")

    def take_off(self) -> None:
        """Start climbing to the hover height."""
        self.phase = "taking_off"

    def land(self) -> None:
        """Start sinking."""
        self.phase = "landing"
        self.manoeuvre = None

    def stop(self) -> None:
        """Hover: end any motion, also a take-off or landing that is under way."""
        self.manoeuvre = None
        self.sticks = (0.0, 0.0, 0.0, 0.0)
        if self.phase in ("taking_off", "landing"):
            self.phase = "flying"

    def cut(self) -> None:
        """Motors off: the drone falls."""
        self.manoeuvre = None
        self.phase = "falling" if self.position[2] > 0.0 else "standing"

    def fly(self, forward_m: float, left_m: float, up_m: float, speed_m_s: float) -> None:
        """Fly a body-relative way."""
        offset = _rotation_z(self.yaw_rad) @ np.array([forward_m, left_m, up_m])
        self.manoeuvre = Manoeuvre(self.position + offset, 0.0, speed_m_s)

    def turn(self, left_rad: float) -> None:
        """Turn on the spot, counter-clockwise positive."""
        self.manoeuvre = Manoeuvre(self.position.copy(), left_rad, 0.3)

    # Motion ----------------------------------------------------------------------------------

    def step(self, dt_s: float) -> None:
        """Advance by ``dt_s`` seconds, at most a tenth of a second at once."""
        self.finished = False
        self._wear(dt_s)
        if self.phase == "standing":
            return
        if self.phase == "falling":
            self._fall(dt_s)
            return
        wanted, turn_rad_s = self._wanted()
        follow = 1.0 - math.exp(-dt_s / self._config.lag_s)
        before = self.velocity
        self._steered = self._steered + follow * (wanted - self._steered)
        self._turn_rad_s += follow * (turn_rad_s - self._turn_rad_s)
        self._wander(dt_s)
        self.velocity = self._steered + self._drift
        self._acceleration = (self.velocity - before) / dt_s
        self.position = self.position + self.velocity * dt_s
        self._turn(dt_s)
        self._sway(dt_s)
        self._conclude()

    def _wanted(self) -> tuple[Array, float]:
        """Return the world velocity and counter-clockwise rate that phase and sticks ask for."""
        if self.phase == "taking_off":
            missing_m = self._config.take_off_height_m - self.position[2]
            return np.array([0.0, 0.0, min(self._config.climb_m_s, 1.5 * missing_m + 0.03)]), 0.0
        if self.phase == "landing":
            slow = 0.5 if self.position[2] < 0.3 else 1.0
            return np.array([0.0, 0.0, -slow * self._config.sink_m_s]), 0.0
        if self.manoeuvre is not None:
            return self._wanted_by_manoeuvre(self.manoeuvre)
        right, forward, up, clockwise = (
            self._gains[axis] * stick_speed(axis, self.sticks[axis]) for axis in range(4)
        )
        body = np.array([forward, -right, up])
        if self.position[2] <= 0.1 and up < 0:
            body[2] = 0.0  # The drone does not push itself into the ground.
        return _rotation_z(self.yaw_rad) @ body, -clockwise

    def _wanted_by_manoeuvre(self, manoeuvre: Manoeuvre) -> tuple[Array, float]:
        way = manoeuvre.goal - self.position
        distance_m = float(np.linalg.norm(way))
        speed = min(manoeuvre.speed_m_s, distance_m)
        velocity = way / distance_m * speed if distance_m > 1e-6 else np.zeros(3)
        rate = max(-1.2, min(1.2, 1.5 * manoeuvre.turn_left_rad))
        return velocity, rate

    def _wander(self, dt_s: float) -> None:
        config = self._config
        keep = math.exp(-dt_s / config.drift_tau_s)
        kick = config.drift_sigma_m_s * math.sqrt(1.0 - keep * keep)
        scale = np.array([1.0, 1.0, _VERTICAL_DRIFT])
        self._drift = keep * self._drift + kick * scale * self._rng.standard_normal(3)

    def _turn(self, dt_s: float) -> None:
        config = self._config
        unseen = self._gyro_bias_rad_s * dt_s
        unseen += math.radians(config.yaw_walk_deg) * math.sqrt(dt_s) * self._rng.standard_normal()
        self._unseen_yaw_rad += unseen
        self.yaw_rad = wrap_angle(self.yaw_rad + self._turn_rad_s * dt_s + unseen)
        if self.manoeuvre is not None:
            self.manoeuvre.turn_left_rad -= self._turn_rad_s * dt_s

    def _sway(self, dt_s: float) -> None:
        body = _rotation_z(self.yaw_rad).T @ self._acceleration
        # It leans towards where it accelerates: nose down forwards, right side down rightwards.
        lean = self._config.sway * np.arctan2([body[0], -body[1]], GRAVITY_M_S2)
        lean = np.clip(lean, -_LEAN_MAX_RAD, _LEAN_MAX_RAD)
        self._lean = self._lean + (1.0 - math.exp(-dt_s / _LEAN_LAG_S)) * (lean - self._lean)
        keep = math.exp(-dt_s / 0.2)
        kick = math.radians(self._config.shake_deg) * math.sqrt(1.0 - keep * keep)
        self._shake = keep * self._shake + kick * self._rng.standard_normal(3)

    def _conclude(self) -> None:
        if self.phase == "taking_off" and self.position[2] >= self._config.take_off_height_m - 0.02:
            self.phase = "flying"
            self.finished = True
        elif self.phase == "landing" and self.position[2] <= 0.0:
            self._touch_down()
            self.finished = True
        elif self.manoeuvre is not None:
            near = float(np.linalg.norm(self.manoeuvre.goal - self.position)) < 0.03
            turned = abs(self.manoeuvre.turn_left_rad) < math.radians(1.0)
            # Ending it at speed would let the lag carry the drone past its goal.
            if near and turned and abs(self._turn_rad_s) < math.radians(3.0):
                self.manoeuvre = None
                self.finished = True
        self.position[2] = max(self.position[2], 0.0)

    def _fall(self, dt_s: float) -> None:
        self.velocity = self.velocity + np.array([0.0, 0.0, -GRAVITY_M_S2 * dt_s])
        self.position = self.position + self.velocity * dt_s
        if self.position[2] <= 0.0:
            self._touch_down()

    def _touch_down(self) -> None:
        self.phase = "standing"
        self.position[2] = 0.0
        self.velocity = np.zeros(3)
        self._steered = np.zeros(3)
        self._drift = np.zeros(3)
        self._acceleration = np.zeros(3)
        self._turn_rad_s = 0.0
        self._lean = np.zeros(2)
        self._shake = np.zeros(3)

    def _wear(self, dt_s: float) -> None:
        life_s = self._config.flight_time_s if self.motors_on else self._config.idle_time_s
        self.battery_pct = max(0.0, self.battery_pct - 100.0 * dt_s / life_s)
        # Propellers cool: standing with the video on is what heats the board.
        settled_c = 72.0 if self.motors_on else 85.0
        self.temperature_c += (settled_c - self.temperature_c) * dt_s / 90.0
        if self.motors_on:
            self.motor_time_s += dt_s

    # What it sees and says -------------------------------------------------------------------

    def T_world_cam(self) -> Array:
        """Return the true camera pose ``(4, 4)``, lean and shake included."""
        nose_down = self._tilt_rad + self._lean[0] + self._shake[0]
        forward = np.array([math.cos(self.yaw_rad), math.sin(self.yaw_rad), 0.0])
        centre = self.position + self._config.camera_offset_m * forward
        centre = centre + np.array([0.0, 0.0, self._config.camera_height_m])
        T = camera_pose(centre, self.yaw_rad + self._shake[2], nose_down)
        # Right side down turns the camera clockwise about its own axis, seen from behind.
        T[:3, :3] = T[:3, :3] @ Rotation.from_euler("z", self._lean[1] + self._shake[1]).as_matrix()
        return T

    def readings(self) -> dict[str, float]:
        """Return what the sensors say now, in the drone's units and axes (FRD, cm, dm/s)."""
        noise = self._rng.standard_normal
        turn = _rotation_z(self.yaw_rad).T
        flying = self.phase != "standing"
        forward, left, up = turn @ self.velocity + (0.04 * noise(3) if flying else 0.0)
        a_forward, a_left, a_up = turn @ self._acceleration
        height_m = float(self.position[2])
        tof_cm = 100.0 * height_m + 8.0 + 1.0 * noise()
        believed_yaw = wrap_angle(self.yaw_rad - self._unseen_yaw_rad - self._power_on_yaw_rad)
        milli_g = 1000.0 / GRAVITY_M_S2
        lean = self._lean / max(self._config.sway, 1e-6)
        return {
            "pitch": round(math.degrees(-lean[0]) + 0.3 * noise()),
            "roll": round(math.degrees(lean[1]) + 0.3 * noise()),
            "yaw": round(math.degrees(-believed_yaw)),
            "vgx": round(10.0 * forward),
            "vgy": round(-10.0 * left),
            "vgz": round(-10.0 * up),
            "templ": round(self.temperature_c - 3.0),
            "temph": round(self.temperature_c),
            "tof": 10 if tof_cm < 15.0 else 6553 if tof_cm > 800.0 else round(tof_cm),
            "h": 10 * round(10.0 * height_m),
            "bat": math.ceil(self.battery_pct),
            "baro": self._baro_zero_m + height_m + 0.1 * noise(),
            "time": int(self.motor_time_s),
            "agx": a_forward * milli_g + 5.0 * noise(),
            "agy": -a_left * milli_g + 5.0 * noise(),
            "agz": -(a_up + GRAVITY_M_S2) * milli_g + 5.0 * noise(),
        }


def _rotation_z(yaw_rad: float) -> Array:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
