"""Pose filters on forward-simulated flights: known truth in, estimate and covariance judged."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from server.geometry.axes import wrap_angle
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.stages import Box, Telemetry
from server.vision.config import LocalizationConfig
from server.vision.localization import (
    PoseFilter,
    TargetEstimate,
    TargetEstimator,
    prior_target,
)

CONFIG = LocalizationConfig()
STEP_S = 0.05


@dataclass
class FlyingDrone:
    """A drone with a first-order velocity response, drift, and quantised telemetry."""

    filter: PoseFilter
    position: np.ndarray
    yaw: float
    rng: np.random.Generator
    aim_error: np.ndarray
    start_yaw: float = 0.0
    yaw_drift: float = 0.0
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    drift: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def step(self, wanted_world: np.ndarray, yaw_rate: float) -> None:
        rng = self.rng
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        self.velocity += (R.T @ wanted_world - self.velocity) * STEP_S / 0.35
        self.drift += -self.drift * STEP_S / 2 + 0.03 * np.sqrt(STEP_S) * rng.normal(size=3)
        self.position = self.position + R @ (self.velocity + self.drift) * STEP_S
        self.yaw += yaw_rate * STEP_S
        self.yaw_drift += np.deg2rad(0.1) * np.sqrt(STEP_S) * rng.normal()

    def report(self, now_s: float) -> None:
        speed = np.round((self.velocity + self.drift + self.rng.normal(0, 0.03, 3)) * 10) / 10
        turned = np.rad2deg(self.yaw - self.start_yaw + self.yaw_drift)
        height = self.position[2]
        tof = None if height < 0.2 else height + self.rng.normal(0, 0.01)
        self.filter.observe_telemetry(
            Telemetry(
                self.filter.drone_id,
                now_s,
                wrap_angle(np.deg2rad(round(turned))),
                0.0,
                0.0,
                speed,
                np.array([0.0, 0.0, 9.81]),
                round((height - 0.08) * 10) / 10,
                tof,
                0.0,
                90,
                60.0,
                now_s,
            )
        )

    def see(self, target: np.ndarray, height_m: float, now_s: float, others) -> None:
        T = camera_pose(self.position, self.yaw, TELLO_TILT_RAD)
        pixels, depths = TELLO_INTRINSICS.project(target[None], T)
        size = TELLO_INTRINSICS.fy * height_m / depths[0]
        centre = pixels[0] + self.aim_error * size + self.rng.normal(0, 3, 2)
        half = np.array([0.4, 0.5]) * size
        if (centre - half < 5).any() or (centre + half > [950, 710]).any():
            return
        box = Box(np.concatenate([centre - half, centre + half]), 0.9, False)
        self.filter.observe_box(box, now_s, others)


def fly(seed: int, drones: int = 4, seconds: float = 30.0):
    """Take off, then step along the circle facing its centre; return errors, NEES and target."""
    rng = np.random.default_rng(seed)
    estimator = TargetEstimator(CONFIG)
    target = np.array([*rng.normal(0.0, 0.1, 2), 0.35])
    fleet = []
    for k in range(drones):
        azimuth = 2 * np.pi * k / drones
        nominal = np.array([1.8 * np.cos(azimuth), 1.8 * np.sin(azimuth), 0.08])
        start = nominal + np.append(rng.normal(0.0, 0.1, 2), 0.0)
        yaw = azimuth + np.pi + rng.normal(0.0, 0.12)
        pose_filter = PoseFilter(
            f"drone-{k}", nominal, azimuth + np.pi, CONFIG, TELLO_INTRINSICS, TELLO_TILT_RAD
        )
        drone = FlyingDrone(pose_filter, start, yaw, rng, rng.normal(0.0, 0.05, 2), yaw)
        drone.report(0.0)
        fleet.append(drone)
    errors, nees = [], []
    for step in range(1, int(seconds / STEP_S)):
        now_s = step * STEP_S
        for drone in fleet:
            x, y, z = drone.position
            azimuth = np.arctan2(y, x)
            along = 0.25 * (now_s > 6 and now_s % 6 < 3)
            wanted = np.array([-np.sin(azimuth) * along, np.cos(azimuth) * along, 0.8 * (0.9 - z)])
            wanted[:2] += (
                0.8 * (1.8 - np.hypot(x, y)) * np.array([np.cos(azimuth), np.sin(azimuth)])
            )
            drone.step(wanted, 1.5 * wrap_angle(azimuth + np.pi - drone.yaw))
            if step % 2 == 0:
                drone.report(now_s)
            if step % 4 == 0:
                name = drone.filter.drone_id
                drone.see(target, 0.7, now_s, estimator.estimate(excluding=name))
                estimator.observe(name, drone.filter.target_belief())
        if step % 20 == 0 and now_s > 6:
            for drone in fleet:
                pose = drone.filter.pose(now_s)
                turn = wrap_angle(pose.yaw_rad - drone.yaw)
                error = np.append(pose.position_world - drone.position, turn)
                errors.append(error)
                nees.append(error @ np.linalg.solve(pose.covariance, error))
    return np.array(errors), np.array(nees), estimator.estimate(), target


@pytest.mark.slow
def test_errors_stay_bounded_and_within_the_covariance():
    flights = [fly(seed) for seed in range(4)]
    errors = np.concatenate([flight[0] for flight in flights])
    nees = np.concatenate([flight[1] for flight in flights])
    distance = np.linalg.norm(errors[:, :3], axis=1)
    assert np.median(distance) < 0.2
    assert distance.max() < 0.7
    assert np.rad2deg(np.median(np.abs(errors[:, 3]))) < 6.0
    # Four degrees of freedom: honest means about 4 on average. Errors of one flight hang together,
    # so the mean over four flights may be off by a factor, but not by ten either way.
    assert 0.4 < nees.mean() < 8.0
    for _, _, estimate, target in flights:
        off = estimate.centre - target
        assert off @ np.linalg.solve(estimate.covariance[:3, :3], off) < 16.3  # 99.9 %.


@pytest.mark.slow
def test_one_drone_alone_is_served_too():
    errors, nees, _, _ = fly(11, drones=1)
    assert np.linalg.norm(errors[:, :3], axis=1).max() < 0.7
    assert nees.mean() < 12.0


def resting_filter(yaw_reported: float = 0.3) -> tuple[PoseFilter, Telemetry]:
    pose_filter = PoseFilter(
        "d", np.array([1.8, 0.0, 0.0]), np.pi, CONFIG, TELLO_INTRINSICS, TELLO_TILT_RAD
    )
    at_rest = Telemetry(
        "d", 0.0, yaw_reported, 0, 0, np.zeros(3), np.zeros(3), 0.0, None, 0, 90, 60, 0
    )
    pose_filter.observe_telemetry(at_rest)
    return pose_filter, at_rest


def later(t: Telemetry, at_s: float, **changes) -> Telemetry:
    values = {name: getattr(t, name) for name in t.__dataclass_fields__}
    return Telemetry(**{**values, "received_s": at_s, **changes})


def test_the_first_report_fixes_what_yaw_is_counted_from():
    pose_filter, _ = resting_filter(yaw_reported=1.1)
    pose = pose_filter.pose(0.0)
    assert wrap_angle(pose.yaw_rad - np.pi) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(pose.position_world, [1.8, 0.0, CONFIG.start_height_m])


def test_waiting_on_the_floor_costs_no_certainty_of_place():
    pose_filter, t = resting_filter()
    before = pose_filter.pose(0.0).covariance
    for k in range(1, 600):
        pose_filter.observe_telemetry(later(t, 0.1 * k))
    after = pose_filter.pose(59.9).covariance
    assert np.trace(after[:2, :2]) == pytest.approx(np.trace(before[:2, :2]), rel=1e-6)


def test_forward_flight_moves_along_the_heading_and_turns_left_for_positive_yaw():
    pose_filter, t = resting_filter()
    for k in range(1, 21):
        flying = later(t, 0.1 * k, velocity_m_s=np.array([0.5, 0, 0]), height_m=0.8, tof_m=0.88)
        pose_filter.observe_telemetry(flying)
    # It looks along -x; the first interval ramps up from rest.
    assert pose_filter.pose(2.0).position_world[0] == pytest.approx(1.8 - 0.975, abs=0.02)
    pose_filter.observe_telemetry(later(t, 2.1, yaw_rad=t.yaw_rad + 0.2, height_m=0.8, tof_m=0.88))
    assert wrap_angle(pose_filter.pose(2.1).yaw_rad - np.pi) == pytest.approx(0.2, abs=1e-6)


def test_a_late_report_changes_nothing():
    pose_filter, t = resting_filter()
    pose_filter.observe_telemetry(later(t, 1.0))
    before = pose_filter.pose(1.0)
    pose_filter.observe_telemetry(later(t, 0.5, velocity_m_s=np.array([3.0, 0, 0])))
    np.testing.assert_array_equal(pose_filter.pose(1.0).T_world_cam, before.T_world_cam)


def test_a_box_that_does_not_fit_is_refused_and_counted():
    pose_filter, t = resting_filter()
    for k in range(1, 10):
        pose_filter.observe_telemetry(later(t, 0.1 * k, height_m=0.8, tof_m=0.88))
    T = pose_filter.pose(0.9).T_world_cam
    pixel, _ = TELLO_INTRINSICS.project(np.array([[0.0, 0.0, 0.45]]), T)
    half = np.array([100.0, 200.0])
    fitting = Box(np.concatenate([pixel[0] - half, pixel[0] + half]), 0.9, False)
    for k in range(10, 60):
        pose_filter.observe_telemetry(later(t, 0.1 * k, height_m=0.8, tof_m=0.88))
        assert pose_filter.observe_box(fitting, 0.1 * k)
    centre = np.array([30.0, 100.0])
    elsewhere = Box(np.concatenate([centre - 20, centre + 20]), 0.9, False)
    before = pose_filter.pose(6.0)
    assert not pose_filter.observe_box(elsewhere, 6.0)
    assert pose_filter.refused_boxes == 1
    np.testing.assert_array_equal(pose_filter.pose(6.0).T_world_cam, before.T_world_cam)


def test_the_estimator_counts_the_prior_once():
    prior = prior_target(CONFIG)
    estimator = TargetEstimator(CONFIG)
    for name in ("a", "b", "c"):
        estimator.observe(name, prior)
    np.testing.assert_allclose(estimator.estimate().covariance, prior.covariance, atol=1e-12)
    np.testing.assert_allclose(estimator.estimate().centre, prior.centre, atol=1e-12)


def test_a_new_belief_of_the_object_leaves_the_pose_alone() -> None:
    config = LocalizationConfig()
    filter_ = PoseFilter(
        "d", np.array([2.0, 0.0, 0.0]), np.pi, config, TELLO_INTRINSICS, TELLO_TILT_RAD
    )
    before = filter_.pose(0.0)
    prior = TargetEstimate(np.array([0.6, 0.5, 0.4]), 0.5, np.eye(4) * 0.01)
    target = TargetEstimator(config, prior)
    filter_.begin_target(prior)
    target.observe("d", filter_.target_belief())
    after = filter_.pose(0.0)
    assert after.T_world_cam == pytest.approx(before.T_world_cam)
    assert after.covariance == pytest.approx(before.covariance)
    # One who has seen nothing since adds nothing to what all know, or all but one.
    for estimate in (target.estimate(), target.estimate(excluding="d")):
        assert estimate.vector == pytest.approx(prior.vector)
        assert estimate.covariance == pytest.approx(prior.covariance)
