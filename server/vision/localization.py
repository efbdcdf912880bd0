"""Where the drones are, and where the object is, without any external localisation.

One extended Kalman filter per drone. Its state, 14 numbers:

    p (3)   camera centre, world metres            [0:3]
    b       world heading minus reported yaw, rad  [3]
    e (3)   error of the reported velocity, body FLU, m/s  [4:7]
    o (3)   slowly changing errors of the box: right, down (rad), log apparent height  [7:10]
    t (3)   centre of the object, world metres     [10:13]
    h       log of the object's height in metres   [13]

Reported velocity and yaw drive the prediction; distance sensor and height correct z; the box gives
direction (two angles) and log apparent height of the object. Every filter holds the object in its
own state, starting from the same prior: it stands about where the start circle has its centre. That
prior and the start places are the gauge of the world.

Given the object, the drones' errors are independent, so the object is the only thing they have to
share: ``TargetEstimator`` multiplies the drones' likelihoods of it, and a filter is conditioned on
what the *others* know of it when a pose is asked for. Nothing is counted twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import R_BODY_LEVEL_CAM, rotation_z, rotation_zyx, wrap_angle
from server.geometry.cameras import Intrinsics
from server.geometry.poses import transform_from
from server.stages import Box, CameraPose, Telemetry
from server.vision.config import LocalizationConfig

Array = NDArray[np.float64]

_P, _B, _E, _O, _T = slice(0, 3), 3, slice(4, 7), slice(7, 10), slice(10, 14)
_SIZE = 14
# A standard deviation so large that the measurement changes nothing.
_IGNORED = 100.0
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class TargetEstimate:
    """What is known of the object.

    Attributes:
        centre: Its centre ``(3,)``, world metres.
        height_m: Its height.
        covariance: ``(4, 4)`` of (x, y, z, log height).
    """

    centre: Array
    height_m: float
    covariance: Array

    @property
    def vector(self) -> Array:
        """The estimate as ``(4,)``: x, y, z, log height."""
        return np.append(self.centre, np.log(self.height_m))

    @property
    def sigma_m(self) -> float:
        """Root of the mean variance of the centre, metres."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3]) / 3.0))


def prior_target(config: LocalizationConfig) -> TargetEstimate:
    """Return what is known of the object before anything was seen."""
    sigmas = np.array(
        [
            config.target_sigma_m,
            config.target_sigma_m,
            config.target_height_sigma_m,
            config.object_height_log_sigma,
        ]
    )
    centre = np.array([0.0, 0.0, config.target_height_m])
    return TargetEstimate(centre, config.object_height_m, np.diag(sigmas**2))


def _estimate_from(vector: Array, covariance: Array) -> TargetEstimate:
    return TargetEstimate(vector[:3].copy(), float(np.exp(vector[3])), covariance)


class TargetEstimator:
    """Combines the drones' beliefs about the object into one.

    With prior information L0 and posterior L_i of drone i, the drone's own contribution is
    L_i - L0, and together they know L0 + sum_i (L_i - L0).
    """

    def __init__(self, config: LocalizationConfig, prior: TargetEstimate | None = None) -> None:
        """Begin with ``prior``, which every filter must begin with too; None: the config's."""
        self._prior = prior_target(config) if prior is None else prior
        self._beliefs: dict[str, TargetEstimate] = {}

    def observe(self, drone_id: str, belief: TargetEstimate) -> None:
        """Take the newest belief of ``drone_id`` (``PoseFilter.target_belief``)."""
        self._beliefs[drone_id] = belief

    def estimate(self, excluding: str | None = None) -> TargetEstimate:
        """Return what all drones, or all but ``excluding``, know together."""
        information0 = np.linalg.inv(self._prior.covariance)
        information = information0.copy()
        weighted = information0 @ self._prior.vector
        for drone_id, belief in self._beliefs.items():
            if drone_id != excluding:
                own = np.linalg.inv(belief.covariance)
                information += own - information0
                weighted += own @ belief.vector - information0 @ self._prior.vector
        covariance = np.linalg.inv(information)
        return _estimate_from(covariance @ weighted, (covariance + covariance.T) / 2.0)


class PoseFilter:
    """The believed pose of one drone's camera, with an honest covariance.

    Attributes:
        drone_id: Which drone.
        refused_boxes: Boxes refused so far because they did not fit what is believed.
    """

    def __init__(
        self,
        drone_id: str,
        start_position: Array,
        start_yaw: float,
        config: LocalizationConfig,
        intrinsics: Intrinsics,
        tilt_rad: float,
    ) -> None:
        """Start on the floor.

        Args:
            drone_id: Which drone.
            start_position: Nominal start place ``(3,)``, world metres; its height is taken from
                the config, a drone starts on the floor.
            start_yaw: Nominal start heading, radians.
            config: Settings.
            intrinsics: The drone's camera.
            tilt_rad: How far it looks below the horizon.
        """
        self.drone_id = drone_id
        self.refused_boxes = 0
        self._config = config
        self._intrinsics = intrinsics
        self._R_body_cam = rotation_zyx(0.0, tilt_rad, 0.0) @ R_BODY_LEVEL_CAM
        self._prior = prior_target(config)
        self._start_yaw = start_yaw
        self._telemetry: Telemetry | None = None
        self._yaw_rate_rad_s = 0.0
        self._box_at_s: float | None = None
        self._others: tuple[Array, Array] | None = None
        self._x = np.zeros(_SIZE)
        self._x[0:2] = np.asarray(start_position, float)[:2]
        self._x[2] = config.start_height_m
        self._x[_B] = start_yaw
        self._x[_T] = self._prior.vector
        sigmas = np.concatenate(
            [
                np.full(2, config.start_position_sigma_m),
                [config.start_height_sigma_m, config.start_yaw_sigma_rad],
                np.full(3, config.velocity_bias_m_s),
                [config.box_bias_rad, config.box_bias_rad, config.size_bias],
            ]
        )
        self._cov = np.zeros((_SIZE, _SIZE))
        self._cov[:10, :10] = np.diag(sigmas**2)
        self._cov[_T, _T] = self._prior.covariance

    def begin_target(self, prior: TargetEstimate) -> None:
        """Believe ``prior`` of the object and forget what boxes said of it before.

        The pose keeps its estimate. The slow errors of the box go as well: they were those of
        whatever the boxes showed.
        """
        self._prior = prior
        self._others = None
        spread = np.array([self._config.box_bias_rad, self._config.box_bias_rad])
        for part, mean, cov in (
            (_O, np.zeros(3), np.diag(np.append(spread, self._config.size_bias) ** 2)),
            (_T, prior.vector, prior.covariance),
        ):
            self._x[part] = mean
            self._cov[part, :] = 0.0
            self._cov[:, part] = 0.0
            self._cov[part, part] = cov

    # Prediction -----------------------------------------------------------------------------

    def observe_telemetry(self, t: Telemetry) -> None:
        """Move along with one state report and correct the height; a late report is ignored."""
        last = self._telemetry
        if last is None:
            # The first report fixes what the reported yaw is counted from.
            self._x[_B] = self._start_yaw - t.yaw_rad
            self._telemetry = t
            return
        dt_s = t.received_s - last.received_s
        if dt_s <= 0.0:
            return
        turn = wrap_angle(t.yaw_rad - last.yaw_rad)
        self._yaw_rate_rad_s = turn / max(dt_s, 0.05)
        self._predict(
            dt_s,
            velocity_body=(last.velocity_m_s + t.velocity_m_s) / 2.0,
            yaw_reported=last.yaw_rad + turn / 2.0,
            resting=_rests(last) and _rests(t),
        )
        self._telemetry = t
        self._correct_height(t)

    def _predict(
        self, dt_s: float, velocity_body: Array, yaw_reported: float, resting: bool
    ) -> None:
        config = self._config
        F, Q = np.eye(_SIZE), np.zeros(_SIZE)
        Q[_B] = config.yaw_drift_rad_sqrt_s**2 * dt_s
        if not resting:
            R = rotation_z(self._x[_B] + yaw_reported)
            moved = R @ (velocity_body - self._x[_E]) * dt_s
            self._x[_P] += moved
            F[_P, _B] = np.cross(_UP, moved)
            F[_P, _E] = -R * dt_s
            Q[_P] = (config.velocity_sigma_m_s * dt_s) ** 2
            wander = (
                config.velocity_bias_m_s**2 + (config.velocity_scale_sigma * velocity_body) ** 2
            )
            keep = np.exp(-dt_s / config.velocity_bias_tau_s)
            self._x[_E] *= keep
            F[_E, _E] = keep * np.eye(3)
            Q[_E] = (1.0 - keep**2) * wander
        keep = np.exp(-dt_s / config.box_bias_tau_s)
        self._x[_O] *= keep
        F[_O, _O] = keep * np.eye(3)
        spread = np.array([config.box_bias_rad, config.box_bias_rad, config.size_bias])
        Q[_O] = (1.0 - keep**2) * spread**2
        self._cov = F @ self._cov @ F.T + np.diag(Q)

    # Correction -----------------------------------------------------------------------------

    def _correct_height(self, t: Telemetry) -> None:
        config = self._config
        H = np.zeros((1, _SIZE))
        H[0, 2] = 1.0
        above_start = config.start_height_m + t.height_m - self._x[2]
        self._correct(np.array([above_start]), H, np.array([config.height_sigma_m**2]))
        if t.tof_m is not None:
            above_floor = config.tof_offset_m + t.tof_m - self._x[2]
            self._correct(np.array([above_floor]), H, np.array([config.tof_sigma_m**2]))

    def observe_box(self, box: Box, at_s: float, target: TargetEstimate | None = None) -> bool:
        """Correct pose and object by a box seen at ``at_s``; return False when it was refused.

        Args:
            box: The object's box.
            at_s: When its picture was taken.
            target: What the *other* drones know of the object
                (``TargetEstimator.estimate(excluding=drone_id)``), None to keep the last.
        """
        if target is not None:
            self._others = self._likelihood_of_others(target)
        if self._telemetry is None or (self._box_at_s is not None and at_s <= self._box_at_s):
            return False
        predicted = self._predict_box(at_s)
        if predicted is None:
            return False
        expected, H = predicted
        measured, variances = self._measure_box(box)
        fitted = self._correct(measured - expected, H, variances)
        if fitted:
            self._box_at_s = at_s
        else:
            self.refused_boxes += 1
        return fitted

    def _measure_box(self, box: Box) -> tuple[Array, Array]:
        """Return (right, down, log apparent height) as tangents, and their variances.

        A box that touches the picture's edge is cut there. Sideways its centroid still says where
        to, loosely; cut above or below, neither its elevation nor its height says anything.
        """
        config, camera = self._config, self._intrinsics
        corners = np.stack([box.xyxy_px[:2], box.xyxy_px[2:], box.centroid_px])
        directions = camera.directions(corners)
        tangents = directions[:, :2] / directions[:, 2:]
        width, height = np.maximum(tangents[1] - tangents[0], 1e-4)
        left, top, right, bottom = box.xyxy_px
        cut_x = left <= 1.0 or right >= camera.width - 2.0
        cut_y = top <= 1.0 or bottom >= camera.height - 2.0
        white = config.box_sigma_rad**2 + config.yaw_sigma_rad**2
        variances = np.array(
            [
                white + (0.5 * width if cut_x else 0.0) ** 2,
                white + (_IGNORED if cut_y else 0.0) ** 2,
                config.size_sigma**2 + (_IGNORED if cut_y else 0.0) ** 2,
            ]
        )
        return np.array([tangents[2, 0], tangents[2, 1], np.log(height)]), variances

    def _predict_box(self, at_s: float) -> tuple[Array, Array] | None:
        """Return the expected measurement ``(3,)`` and Jacobian ``(3, 14)``; None if behind."""
        position, R_world_cam = self._pose_at(at_s, self._x)
        R_cam_world = R_world_cam.T
        offset = self._x[10:13] - position
        x, y, z = R_cam_world @ offset
        if z < 0.1:
            return None
        expected = np.array([x / z, y / z, self._x[13] - np.log(z)]) + self._x[_O]
        by_point = np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z], [0.0, 0.0, -1.0]]) / z
        H = np.zeros((3, _SIZE))
        H[:, 10:13] = by_point @ R_cam_world
        H[:, _P] = -H[:, 10:13]
        H[:, _B] = -by_point @ R_cam_world @ np.cross(_UP, offset)
        H[:, _O] = np.eye(3)
        H[2, 13] = 1.0
        return expected, H

    def _correct(self, innovation: Array, H: Array, variances: Array) -> bool:
        """Apply one linearised measurement; return False when it fails the gate."""
        S = H @ self._cov @ H.T + np.diag(variances)
        solved = np.linalg.solve(S, np.column_stack([innovation, H @ self._cov]))
        if innovation @ solved[:, 0] > self._config.gate * len(innovation):
            return False
        K = solved[:, 1:].T
        self._x = self._x + K @ innovation
        # Joseph's form keeps the covariance symmetric and positive for thousands of corrections.
        A = np.eye(_SIZE) - K @ H
        self._cov = A @ self._cov @ A.T + (K * variances) @ K.T
        return True

    # Answers --------------------------------------------------------------------------------

    def target_belief(self) -> TargetEstimate:
        """Return what this drone alone knows of the object."""
        return _estimate_from(self._x[_T], self._cov[_T, _T].copy())

    def pose(self, now_s: float) -> CameraPose:
        """Return the believed camera pose at ``now_s``, with what the other drones know used."""
        x, cov = self._conditioned()
        position, R_world_cam = self._pose_at(now_s, x)
        dt_s = self._offset_s(now_s)
        covariance = cov[:4, :4].copy()
        drift = (self._config.velocity_sigma_m_s * dt_s) ** 2
        covariance[np.arange(3), np.arange(3)] += drift
        covariance[3, 3] += self._config.yaw_sigma_rad**2
        return CameraPose(self.drone_id, now_s, transform_from(R_world_cam, position), covariance)

    def velocity(self) -> Array:
        """Return the believed velocity ``(3,)``, world m/s: the reported one less its error."""
        t = self._telemetry
        if t is None or _rests(t):
            return np.zeros(3)
        x, _ = self._conditioned()
        return rotation_z(x[_B] + t.yaw_rad) @ (t.velocity_m_s - x[_E])

    def _offset_s(self, at_s: float) -> float:
        limit = self._config.max_extrapolation_s
        newest = at_s if self._telemetry is None else self._telemetry.received_s
        return float(np.clip(at_s - newest, -limit, limit))

    def _pose_at(self, at_s: float, x: Array) -> tuple[Array, Array]:
        """Return camera centre ``(3,)`` and ``R_world_cam`` of state ``x`` carried to ``at_s``."""
        t = self._telemetry
        if t is None:
            yaw = x[_B]
            pitch = roll = 0.0
            position = x[_P].copy()
        else:
            dt_s = self._offset_s(at_s)
            yaw = x[_B] + t.yaw_rad + self._yaw_rate_rad_s * dt_s
            pitch, roll = (t.pitch_rad, t.roll_rad) if self._config.use_attitude else (0.0, 0.0)
            velocity = np.zeros(3) if _rests(t) else t.velocity_m_s - x[_E]
            position = x[_P] + rotation_z(yaw) @ velocity * dt_s
        # Nose up and right side down are positive; turning about left lowers the nose.
        return position, rotation_zyx(yaw, -pitch, roll) @ self._R_body_cam

    def _likelihood_of_others(self, target: TargetEstimate) -> tuple[Array, Array]:
        """Return information ``(4, 4)`` and information vector ``(4,)`` beyond the common prior."""
        information0 = np.linalg.inv(self._prior.covariance)
        information = np.linalg.inv(target.covariance)
        return (
            information - information0,
            information @ target.vector - information0 @ self._prior.vector,
        )

    def _conditioned(self) -> tuple[Array, Array]:
        """Return state and covariance given also what the others know of the object."""
        if self._others is None:
            return self._x, self._cov
        information, weighted = self._others
        cov_t = self._cov[_T, _T]
        # t given both: (C^-1 + I)^-1 = C - C I (1 + C I)^-1 C, which needs no inverse of I.
        gain = self._cov[:, _T] @ np.linalg.inv(np.eye(4) + information @ cov_t)
        x = self._x + gain @ (weighted - information @ self._x[_T])
        cov = self._cov - gain @ information @ self._cov[_T, :]
        return x, (cov + cov.T) / 2.0


def _rests(t: Telemetry) -> bool:
    """Return whether the drone stands on the floor: no height, no speed, nothing below seen far."""
    near = t.tof_m is None or t.tof_m < 0.15
    return near and abs(t.height_m) < 0.05 and not np.any(t.velocity_m_s)
