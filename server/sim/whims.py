"""What a drone does unasked: hover drift, wind, gusts, an unnoticed turn, the camera's shake; pure.

Drift is an Ornstein-Uhlenbeck velocity, as is the shake of the camera's attitude; the heading walks
away at random and by each drone's constant bias. Gusts come at random, as rare events do, blow for
a while and are felt like wind. Vectors are world metres per second.
"""

from __future__ import annotations

import math

import numpy as np

from server.sim.config import DynamicsConfig
from server.sim.sensors import Vector

_NOWHERE: Vector = (0.0, 0.0, 0.0)
_SHAKE_LAG_S = 0.2
_WIND_LAG_S = 0.3
_VERTICAL_DRIFT = 0.3  # Barometer and range finder hold height better than place.
_BLIND_DRIFT = 4.0  # How much more it wanders where its downward camera sees nothing.
_NORMALS_AT_ONCE = 512
_STEP_S = 0.02  # What a step takes unless the caller takes others.


class Whims:
    """The disturbances of one drone.

    Attributes:
        wind: World velocity that the air is to force on the drone, metres per second.
        shake: Nose-down, right-side-down and left turn of the camera, radians.
    """

    def __init__(self, config: DynamicsConfig, rng: np.random.Generator) -> None:
        self.wind = _NOWHERE
        self.shake = _NOWHERE
        self._config = config
        self._rng = rng
        self._normals: list[float] = []
        self._bias_rad_s = math.radians(config.gyro_bias_deg_s) * float(rng.standard_normal())
        self._drift = _NOWHERE
        self._blown = _NOWHERE
        self._gust = _NOWHERE
        self._gust_left_s = 0.0
        self._still_s = self._wait_s()
        self._retime(_STEP_S)

    def calm(self) -> None:
        """Start afresh, as after standing on the ground."""
        self.shake = self._drift = self._blown = self._gust = _NOWHERE
        self._gust_left_s = 0.0

    def velocity(self, dt_s: float, sees_floor: bool) -> Vector:
        """Return the velocity of drift and wind together, ``dt_s`` after the last."""
        if dt_s != self._dt_s:
            self._retime(dt_s)
        normal, keep, kick = self.normal, self._drift_keep, self._drift_kick
        if not sees_floor:
            kick *= _BLIND_DRIFT
        dx, dy, dz = self._drift
        self._drift = dx, dy, dz = (
            keep * dx + kick * normal(),
            keep * dy + kick * normal(),
            keep * dz + kick * _VERTICAL_DRIFT * normal(),
        )
        bx, by, bz = self._blown
        self._blow_on(dt_s)
        wx, wy, wz = self.wind
        gx, gy, _ = self._gust
        blow = self._blow
        self._blown = bx, by, bz = (
            bx + blow * (wx + gx - bx),
            by + blow * (wy + gy - by),
            bz + blow * (wz - bz),
        )
        return dx + bx, dy + by, dz + bz

    def _blow_on(self, dt_s: float) -> None:
        """Let a gust begin or end when its time has come."""
        if self._gust_left_s > 0.0:
            self._gust_left_s -= dt_s
            if self._gust_left_s <= 0.0:
                self._gust = _NOWHERE
            return
        self._still_s -= dt_s
        if self._still_s > 0.0:
            return
        strength = self._config.gust_m_s
        self._gust = strength * self.normal(), strength * self.normal(), 0.0
        self._gust_left_s = self._config.gust_s
        self._still_s = self._wait_s()

    def _wait_s(self) -> float:
        """Return how long the air stays still until the next gust."""
        if self._config.gust_m_s <= 0.0:
            return math.inf
        return self._config.gust_period_s * float(self._rng.standard_exponential())

    def turn_rad(self, dt_s: float) -> float:
        """Return the turn, counter-clockwise, that the drone itself does not notice."""
        return self._bias_rad_s * dt_s + self._yaw_kick * self.normal()

    def shake_on(self) -> None:
        """Move the camera's shake on by one step."""
        normal, keep, kick = self.normal, self._shake_keep, self._shake_kick
        a, b, c = self.shake
        self.shake = (
            keep * a + kick * normal(),
            keep * b + kick * normal(),
            keep * c + kick * normal(),
        )

    def normal(self) -> float:
        """Return a draw from the standard normal distribution, out of a stock of them."""
        if not self._normals:
            self._normals = self._rng.standard_normal(_NORMALS_AT_ONCE).tolist()
        return self._normals.pop()

    def _retime(self, dt_s: float) -> None:
        """Work out what depends on the length of a step alone."""
        config = self._config
        self._dt_s = dt_s
        self._blow = 1.0 - math.exp(-dt_s / _WIND_LAG_S)
        self._drift_keep = math.exp(-dt_s / config.drift_tau_s)
        self._drift_kick = config.drift_sigma_m_s * math.sqrt(1.0 - self._drift_keep**2)
        self._yaw_kick = math.radians(config.yaw_walk_deg) * math.sqrt(dt_s)
        self._shake_keep = math.exp(-dt_s / _SHAKE_LAG_S)
        self._shake_kick = math.radians(config.shake_deg) * math.sqrt(1.0 - self._shake_keep**2)
