"""A fleet of simulated airframes around an object, and the pose filters that follow it.

Everything that the simulator does to a Tello is done here: drift, gusts, lag, scale and rounding of
its reports, a lens that differs from the calibrated one. What draws the errors is the filter's own
idea of them, so that its covariance can be judged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from server.geometry.axes import wrap_angle
from server.geometry.poses import yaw_of_camera
from server.sim.camera import true_intrinsics
from server.sim.config import CameraConfig, DynamicsConfig
from server.sim.dynamics import Airframe
from server.sim.sdk import state_line
from server.stages import Box
from server.swarm.protocol import decode_state
from server.vision.config import LocalizationConfig
from server.vision.localization import PoseFilter
from server.vision.target import TargetEstimate, TargetEstimator

STEP_S, REPORT_STEPS, PICTURE_STEPS = 0.02, 5, 8
CAMERA = CameraConfig()
RADIUS_M, HEIGHT_M = 1.8, 0.9


@dataclass
class Flier:
    """One drone, its filter, and what is wrong with the boxes of its pictures."""

    body: Airframe
    filter: PoseFilter
    lens_index: int
    box_bias: np.ndarray
    rng: np.random.Generator
    seed: int

    def steer(self, wanted_world: np.ndarray, yaw_rate_rad_s: float) -> None:
        """Set the sticks for about a velocity and a turn."""
        c, s = np.cos(self.body.yaw_rad), np.sin(self.body.yaw_rad)
        x, y, z = wanted_world
        right, forward = s * x - c * y, c * x + s * y
        sticks = np.array([right * 130, forward * 170, z * 240, -yaw_rate_rad_s * 80])
        self.body.sticks = tuple(np.clip(sticks + 8 * np.sign(sticks), -60, 60).tolist())

    def report(self, now_s: float) -> None:
        line = state_line(self.body)
        self.filter.observe_telemetry(decode_state(line, self.filter.drone_id, now_s))

    def see(self, target: np.ndarray, now_s: float, config: LocalizationConfig) -> Box | None:
        """Return the box of an object, ``target`` being its x, y, z and height."""
        lens = true_intrinsics(CAMERA, self.seed, self.lens_index)
        keep = np.exp(-PICTURE_STEPS * STEP_S / config.box_bias_tau_s)
        spread = np.array([config.box_bias_rad, config.box_bias_rad, config.size_bias])
        kick = np.sqrt(1.0 - keep**2) * spread
        self.box_bias = keep * self.box_bias + kick * self.rng.standard_normal(3)
        pixels, depths = lens.project(target[None, :3], self.body.T_world_cam())
        white = [config.box_sigma_rad, config.box_sigma_rad, config.size_sigma]
        right, down, size = self.box_bias + white * self.rng.standard_normal(3)
        centre = pixels[0] + lens.fx * np.array([right, down])
        height = lens.fy * target[3] / depths[0] * np.exp(size)
        half = np.array([0.35, 0.5]) * height
        if (centre - half < 5).any() or (centre + half > [950, 710]).any():
            return None
        return Box(np.concatenate([centre - half, centre + half]), 0.9, touches_edge=False)


@dataclass(frozen=True)
class Flown:
    """What one flight showed.

    Attributes:
        errors: Believed minus true (x, y, z, yaw) ``(n, 4)``.
        nees: Normalised errors squared ``(n,)``.
        nees_at_end: The same at the end, one per drone.
        target: What is believed of the object in the end.
        true_target: Its x, y, z, height.
    """

    errors: np.ndarray
    nees: np.ndarray
    nees_at_end: np.ndarray
    target: TargetEstimate
    true_target: np.ndarray


def fly(
    seed: int,
    drones: int = 4,
    seconds: float = 40.0,
    config: LocalizationConfig | None = None,
    dynamics: DynamicsConfig | None = None,
    worst_start: bool = False,
) -> Flown:
    """Take off, then step along the circle facing the object, as rounds of a capture do.

    Args:
        seed: Of everything.
        drones: How many.
        seconds: How long.
        config: The filters'.
        dynamics: The airframes'.
        worst_start: Each drone stands 20 cm off, turned by 15 degrees; else at random as the
            filter believes it.
    """
    config = config or LocalizationConfig()
    rng = np.random.default_rng(seed)
    estimator = TargetEstimator(config)
    x, y, z = rng.normal(0.0, [0.2, 0.2, 0.05])
    target = np.array([x, y, 0.35 + z, 0.6])
    fleet = [
        _flier(k, drones, seed, config, dynamics or DynamicsConfig(), rng, worst_start)
        for k in range(drones)
    ]
    for flier in fleet:
        flier.report(0.0)
        flier.body.take_off()
    errors, nees = [], []
    for step in range(1, int(seconds / STEP_S)):
        now_s = step * STEP_S
        for number, flier in enumerate(fleet):
            _autopilot(flier, target, now_s)
            flier.body.step(STEP_S)
            if (step + number) % REPORT_STEPS == 0:
                flier.report(now_s)
            if (step + number) % PICTURE_STEPS == 0 and now_s > 4.0:
                _look(flier, target, now_s, config, estimator)
        if step % 50 == 0 and now_s > 6.0:
            judged = [_judge(flier, now_s) for flier in fleet]
            errors += [error for error, _ in judged]
            nees += [value for _, value in judged]
    return Flown(
        np.array(errors),
        np.array(nees),
        np.array(nees[-drones:]),
        estimator.estimate(),
        target,
    )


def _flier(
    k: int,
    drones: int,
    seed: int,
    config: LocalizationConfig,
    dynamics: DynamicsConfig,
    rng: np.random.Generator,
    worst_start: bool,
) -> Flier:
    azimuth = 2.0 * np.pi * k / drones
    nominal = RADIUS_M * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    if worst_start:
        angle = rng.uniform(0.0, 2.0 * np.pi)
        off = 0.2 * np.array([np.cos(angle), np.sin(angle)])
        turned = np.deg2rad(15.0) * rng.choice([-1.0, 1.0])
    else:
        off = rng.normal(0.0, config.start_position_sigma_m, 2)
        turned = rng.normal(0.0, config.start_yaw_sigma_rad)
    yaw = azimuth + np.pi + turned
    # The place is the camera's.
    ahead = dynamics.camera_offset_m * np.array([np.cos(yaw), np.sin(yaw)])
    at = nominal + np.append(off - ahead, 0.0)
    body = Airframe(at, yaw, dynamics, np.random.default_rng([seed, k]))
    tilt = np.deg2rad(dynamics.tilt_deg)
    believed = PoseFilter(
        f"drone-{k + 1}", nominal, azimuth + np.pi, config, CAMERA.calibrated, float(tilt)
    )
    spread = np.array([config.box_bias_rad, config.box_bias_rad, config.size_bias])
    return Flier(body, believed, k, spread * rng.standard_normal(3), rng, seed)


def _autopilot(flier: Flier, target: np.ndarray, now_s: float) -> None:
    if flier.body.phase != "flying":
        return
    x, y, z = flier.body.position
    azimuth = np.arctan2(y, x)
    outwards = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    along = np.array([-outwards[1], outwards[0], 0.0])
    steps = 0.3 if now_s > 8.0 and now_s % 6.0 < 3.0 else 0.0
    wanted = steps * along + 0.8 * (RADIUS_M - np.hypot(x, y)) * outwards
    wanted[2] = 0.8 * (HEIGHT_M - z)
    bearing = np.arctan2(target[1] - y, target[0] - x)
    flier.steer(wanted, 1.5 * wrap_angle(bearing - flier.body.yaw_rad))


def _look(
    flier: Flier,
    target: np.ndarray,
    now_s: float,
    config: LocalizationConfig,
    estimator: TargetEstimator,
) -> None:
    box = flier.see(target, now_s, config)
    if box is not None:
        drone_id = flier.filter.drone_id
        flier.filter.observe_box(box, now_s, estimator.estimate(excluding=drone_id))
        estimator.observe(drone_id, flier.filter.target_belief())


def _judge(flier: Flier, now_s: float) -> tuple[np.ndarray, float]:
    T_world_cam, pose = flier.body.T_world_cam(), flier.filter.pose(now_s)
    turn = wrap_angle(pose.yaw_rad - yaw_of_camera(T_world_cam))
    error = np.append(pose.position_world - T_world_cam[:3, 3], turn)
    return error, float(error @ np.linalg.solve(pose.covariance, error))
