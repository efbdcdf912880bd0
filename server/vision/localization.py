"""Where the drones are, and where the object is, without any external localisation.

One extended Kalman filter per drone. Its state, 17 numbers:

    p (3)   camera centre, world metres            [0:3]
    b       world heading minus reported yaw, rad  [3]
    d       how fast that drifts in flight, rad/s  [4]
    s       share by which reported speeds are too high  [5]
    e (3)   further error of the reported velocity, body FLU, m/s  [6:9]
    f       error of the distance sensor's zero, m [9]
    o (3)   slowly changing errors of the box: right, down (rad), log apparent height  [10:13]
    t (3)   centre of the object, world metres     [13:16]
    h       log of the object's height in metres   [16]

Reported velocity and yaw drive the prediction; distance sensor and height correct z; the box gives
direction (two angles) and log apparent height of the object. Every filter holds the object in its
own state, starting from the same prior: it stands about where the start circle has its centre. That
prior and the start places are the gauge of the world. What drones share is in ``target``.

Heights are reported in steps of 10 cm, so that many reports of one height say no more than one:
only a step is a measurement, of the height between the two.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import R_BODY_LEVEL_CAM, rotation_z, rotation_zyx, wrap_angle
from server.geometry.cameras import Intrinsics
from server.geometry.poses import transform_from
from server.stages import Box, CameraPose, SeedGeometry, Telemetry
from server.vision.config import LocalizationConfig
from server.vision.target import TargetEstimate, estimate_from, prior_target
from server.vision.view_dependence import view_dependence

Array = NDArray[np.float64]

_P, _B, _D, _S, _E, _F = slice(0, 3), 3, 4, 5, slice(6, 9), 9
_O, _T = slice(10, 13), slice(13, 17)
_SIZE = 17
_AXES = np.arange(3)
# Reported heights come in steps of this size, metres; a larger change hides the way between.
_HEIGHT_STEP_M = 0.11
# A standard deviation so large that the measurement changes nothing.
_IGNORED = 100.0
_UP = np.array([0.0, 0.0, 1.0])


class PoseFilter:
    """The believed pose of one drone's camera, with an honest covariance.

    Attributes:
        drone_id: Which drone.
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
        self._config = config
        self._intrinsics = intrinsics
        self._R_body_cam = rotation_zyx(0.0, tilt_rad, 0.0) @ R_BODY_LEVEL_CAM
        self._prior = prior_target(config)
        self._start_yaw = start_yaw
        self._telemetry: Telemetry | None = None
        self._yaw_rate_rad_s = 0.0
        self._box_at_s: float | None = None
        self._others: tuple[Array, Array] | None = None
        # Answers as last given; a pose is asked for more often than it changes.
        self._answer: tuple[Array, Array] | None = None
        self._pose: CameraPose | None = None
        self._x = np.zeros(_SIZE)
        self._x[0:2] = np.asarray(start_position, float)[:2]
        self._x[2] = config.start_height_m
        self._x[_B] = start_yaw
        self._x[_T] = self._prior.vector
        sigmas = np.concatenate(
            [
                np.full(2, config.start_position_sigma_m),
                [config.start_height_sigma_m, config.start_yaw_sigma_rad],
                [config.yaw_bias_rad_s, config.velocity_scale_sigma],
                np.full(3, config.velocity_bias_m_s),
                [config.tof_bias_m],
                [config.box_bias_rad, config.box_bias_rad, config.size_bias],
            ]
        )
        self._cov = np.zeros((_SIZE, _SIZE))
        self._cov[: len(sigmas), : len(sigmas)] = np.diag(sigmas**2)
        self._cov[_T, _T] = self._prior.covariance

    def begin_target(self, prior: TargetEstimate) -> None:
        """Believe ``prior`` of the object and forget what boxes said of it before.

        The pose keeps its estimate. The slow errors of the box go as well: they were those of
        whatever the boxes showed.
        """
        self._prior = prior
        self._others = None
        self._forget_answers()
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

    def observe_telemetry(self, t: Telemetry, *, felt: bool = True) -> None:
        """Move along with one state report and correct the height; a late report is ignored.

        Args:
            t: The report.
            felt: False when its velocity was not measured but is what the drone was told: it has
                lost its hold on the floor and drifts.
        """
        last = self._telemetry
        self._forget_answers()
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
            felt=felt,
        )
        self._telemetry = t
        self._correct_height(last, t)

    def resume(
        self, t: Telemetry, position: Array, sigma_m: float, *, restarted: bool = False
    ) -> None:
        """Go on with report ``t`` after a silence.

        Args:
            t: The first report since.
            position: Where the drone is believed now ``(3,)``, world metres.
            sigma_m: How much less is known of that than before the silence, per axis.
            restarted: True when it was off meanwhile: it counts its yaw anew.
        """
        last, self._telemetry, self._yaw_rate_rad_s = self._telemetry, t, 0.0
        self._forget_answers()
        self._x[_P] = position
        self._cov[_P, _P] += sigma_m**2 * np.eye(3)
        if restarted and last is not None:
            self._x[_B] += last.yaw_rad - t.yaw_rad
            self._cov[_B, _B] += self._config.start_yaw_sigma_rad**2

    def _predict(
        self, dt_s: float, velocity_body: Array, yaw_reported: float, resting: bool, felt: bool
    ) -> None:
        config = self._config
        F, Q = np.eye(_SIZE), np.zeros(_SIZE)
        Q[_B] = config.yaw_drift_rad_sqrt_s**2 * dt_s
        if not resting:
            R = rotation_z(self._x[_B] + yaw_reported)
            scaled = (1.0 - self._x[_S]) * velocity_body
            moved = R @ (scaled - self._x[_E]) * dt_s
            self._x[_P] += moved
            self._x[_B] += self._x[_D] * dt_s
            F[_P, _B] = np.cross(_UP, moved)
            F[_P, _S] = -R @ velocity_body * dt_s
            F[_P, _E] = -R * dt_s
            F[_B, _D] = dt_s
            Q[_P] = (config.velocity_sigma_m_s * dt_s) ** 2
            if not felt:
                # A drift that lasts for its correlation time, as the random walk it amounts to.
                Q[_P] += 2.0 * config.unfelt_sigma_m_s**2 * config.velocity_bias_tau_s * dt_s
            keep = np.exp(-dt_s / config.velocity_bias_tau_s)
            self._x[_E] *= keep
            F[_E, _E] = keep * np.eye(3)
            Q[_E] = (1.0 - keep**2) * config.velocity_bias_m_s**2
        keep = np.exp(-dt_s / config.box_bias_tau_s)
        self._x[_O] *= keep
        F[_O, _O] = keep * np.eye(3)
        spread = np.array([config.box_bias_rad, config.box_bias_rad, config.size_bias])
        Q[_O] = (1.0 - keep**2) * spread**2
        self._cov = F @ self._cov @ F.T + np.diag(Q)

    # Correction -----------------------------------------------------------------------------

    def _correct_height(self, last: Telemetry, t: Telemetry) -> None:
        config = self._config
        H = np.zeros((1, _SIZE))
        H[0, 2] = 1.0
        step_m = t.height_m - last.height_m
        if step_m != 0.0:
            between_m = t.height_m - (step_m / 2.0 if abs(step_m) < _HEIGHT_STEP_M else 0.0)
            above_start = config.start_height_m + between_m - self._x[2]
            variances = np.array([config.height_sigma_m**2])
            self._correct(np.array([above_start]), H, variances, config.height_gate)
        if t.tof_m is not None:
            H[0, _F] = 1.0
            above_floor = config.tof_offset_m + t.tof_m - self._x[2] - self._x[_F]
            variances = np.array([config.tof_sigma_m**2])
            self._correct(np.array([above_floor]), H, variances, config.height_gate)

    def observe_box(
        self,
        box: Box,
        at_s: float,
        target: TargetEstimate | None = None,
        seed: SeedGeometry | None = None,
    ) -> bool:
        """Correct pose and object by a box seen at ``at_s``; return False when it was refused.

        Args:
            box: The object's box.
            at_s: When its picture was taken.
            target: What the *other* drones know of the object
                (``TargetEstimator.estimate(excluding=drone_id)``), None to keep the last.
            seed: The object's geometry, None while it is not known.
        """
        self._forget_answers()
        if target is not None:
            self._others = self._likelihood_of_others(target)
        if self._telemetry is None or (self._box_at_s is not None and at_s <= self._box_at_s):
            return False
        predicted = self._predict_box(at_s, seed)
        if predicted is None:
            return False
        expected, H = predicted
        measured, variances = self._measure_box(box)
        fitted = self._correct(measured - expected, H, variances, self._config.gate)
        if fitted:
            self._box_at_s = at_s
        return fitted

    def _measure_box(self, box: Box) -> tuple[Array, Array]:
        """Return (right, down, log apparent height) as tangents, and their variances.

        A box that touches the picture's edge is cut there. Sideways its centroid still says where
        to, loosely; cut above or below, its elevation and its height say nothing.
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

    def _predict_box(self, at_s: float, seed: SeedGeometry | None) -> tuple[Array, Array] | None:
        """Return the expected measurement ``(3,)`` and Jacobian ``(3, 17)``; None if behind."""
        position, R_world_cam = self._pose_at(at_s, self._x)
        R_cam_world = R_world_cam.T
        offset = self._x[13:16] - position
        x, y, z = R_cam_world @ offset
        if z < 0.1:
            return None
        expected = np.array([x / z, y / z, self._x[16] - np.log(z)]) + self._x[_O]
        if seed is not None:
            expected += view_dependence(seed, -offset)
        by_point = np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z], [0.0, 0.0, -1.0]]) / z
        H = np.zeros((3, _SIZE))
        H[:, 13:16] = by_point @ R_cam_world
        H[:, _P] = -H[:, 13:16]
        H[:, _B] = -by_point @ R_cam_world @ np.cross(_UP, offset)
        H[:, _O] = np.eye(3)
        H[2, 16] = 1.0
        return expected, H

    def _correct(self, innovation: Array, H: Array, variances: Array, gate: float) -> bool:
        """Apply one linearised measurement; return False when it fails the gate."""
        S = H @ self._cov @ H.T + np.diag(variances)
        solved = np.linalg.solve(S, np.column_stack([innovation, H @ self._cov]))
        if innovation @ solved[:, 0] > gate * len(innovation):
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
        return estimate_from(self._x[_T], self._cov[_T, _T].copy())

    def pose(self, now_s: float) -> CameraPose:
        """Return the believed camera pose at ``now_s``, with what the other drones know used."""
        if self._pose is not None and self._pose.at_s == now_s:
            return self._pose
        x, cov = self._conditioned()
        position, R_world_cam = self._pose_at(now_s, x)
        dt_s = self._offset_s(now_s)
        covariance = cov[:4, :4].copy()
        velocity = self.velocity()
        drift = (self._config.velocity_sigma_m_s * dt_s) ** 2
        covariance[_AXES, _AXES] += drift
        # What it reports lags behind, so it is ahead along its way, by nobody knows how much.
        covariance[:3, :3] += self._config.velocity_lag_s**2 * np.outer(velocity, velocity)
        covariance[3, 3] += self._config.yaw_sigma_rad**2
        T_world_cam = transform_from(R_world_cam, position)
        self._pose = CameraPose(self.drone_id, now_s, T_world_cam, covariance)
        return self._pose

    def velocity(self) -> Array:
        """Return the believed velocity ``(3,)``, world m/s: the reported one less its error."""
        t = self._telemetry
        if t is None or _rests(t):
            return np.zeros(3)
        x, _ = self._conditioned()
        return rotation_z(x[_B] + t.yaw_rad) @ ((1.0 - x[_S]) * t.velocity_m_s - x[_E])

    def _offset_s(self, at_s: float) -> float:
        limit = self._config.max_extrapolation_s
        newest = at_s if self._telemetry is None else self._telemetry.received_s
        return min(max(at_s - newest, -limit), limit)

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
            share = self._config.attitude_share
            pitch, roll = share * t.pitch_rad, share * t.roll_rad
            velocity = np.zeros(3) if _rests(t) else (1.0 - x[_S]) * t.velocity_m_s - x[_E]
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

    def _forget_answers(self) -> None:
        self._answer = self._pose = None

    def _conditioned(self) -> tuple[Array, Array]:
        """Return state and covariance given also what the others know of the object."""
        if self._answer is None:
            self._answer = self._condition()
        return self._answer

    def _condition(self) -> tuple[Array, Array]:
        if self._others is None:
            return self._x.copy(), self._cov
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
