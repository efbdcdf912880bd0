"""Pose filters on forward-simulated flights: known truth in, estimate and covariance judged."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import chi2
from simulated_fleet import fly

from server.geometry.axes import wrap_angle
from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import look_at
from server.stages import Box, SeedGeometry, Telemetry
from server.vision.config import LocalizationConfig
from server.vision.localization import PoseFilter
from server.vision.target import TargetEstimate, TargetEstimator, prior_target
from server.vision.view_dependence import view_dependence

CONFIG = LocalizationConfig()


@pytest.mark.slow
def test_the_covariance_is_honest() -> None:
    """Normalised errors squared lie in the chi-square band, on flights with all disturbances."""
    flights = [fly(seed, seconds=30.0) for seed in range(12)]
    at_end = np.concatenate([flown.nees_at_end for flown in flights])
    # The four drones of a flight share what they know of the object: counted as one, the band is
    # wider than it could be.
    low, high = chi2.ppf([0.005, 0.995], 4 * len(flights)) / len(flights)
    assert low < at_end.mean() < high
    all_along = np.array([flown.nees.mean() for flown in flights])
    assert low < all_along.mean() < high
    assert all_along.max() < chi2.ppf(0.9999, 4)
    for flown in flights:
        off = flown.target.centre - flown.true_target[:3]
        assert off @ np.linalg.solve(flown.target.covariance[:3, :3], off) < chi2.ppf(0.9999, 3)


@pytest.mark.slow
def test_drones_set_down_as_badly_as_may_be_are_recovered() -> None:
    """20 cm and 15 degrees off, every one of them: bearings tell headings from places."""
    flights = [fly(100 + seed, worst_start=True, seconds=20.0) for seed in range(6)]
    errors = np.concatenate([flown.errors for flown in flights])
    assert np.rad2deg(np.median(np.abs(errors[:, 3]))) < 7.0
    assert np.median(np.linalg.norm(errors[:, :3], axis=1)) < 0.25
    assert np.mean([flown.nees.mean() for flown in flights]) < 8.0


@pytest.mark.slow
def test_one_drone_alone_is_served_too() -> None:
    flown = fly(11, drones=1)
    # Nothing tells its heading from its place, and the filter knows it.
    assert np.linalg.norm(flown.errors[:, :3], axis=1).max() < 1.2
    assert flown.nees.mean() < 12.0


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


def test_what_a_drone_does_not_feel_makes_its_place_unsure():
    sigmas = {}
    for felt in (True, False):
        pose_filter, t = resting_filter()
        for k in range(1, 81):
            flying = later(t, 0.1 * k, height_m=0.8, tof_m=0.88)
            pose_filter.observe_telemetry(flying, felt=felt)
        sigmas[felt] = pose_filter.pose(8.0).position_sigma_m
    # A drift of 0.15 m/s that lasts 3 s at a time, over 8 s.
    assert 0.7 < sigmas[False] < 1.5
    assert sigmas[True] < 0.4


def test_after_a_silence_it_goes_on_where_it_is_believed():
    pose_filter, t = resting_filter()
    before = pose_filter.pose(0.0)
    # Away for ten seconds, with a velocity that must not be flown on for as long.
    flying = later(t, 10.0, velocity_m_s=np.array([0.5, 0, 0]), height_m=0.8, tof_m=0.88)
    place = np.array([0.5, 0.7, 0.9])
    pose_filter.resume(flying, place, 0.8)
    pose = pose_filter.pose(10.0)
    np.testing.assert_allclose(pose.position_world, place)
    assert pose.yaw_rad == pytest.approx(before.yaw_rad)
    assert 0.8 < pose.position_sigma_m < 0.9
    # One that was off counts its yaw anew, and looks where it looked.
    fallen = later(t, 20.0, yaw_rad=0.0)
    pose_filter.resume(fallen, place, 0.4, restarted=True)
    again = pose_filter.pose(20.0)
    assert wrap_angle(again.yaw_rad - before.yaw_rad) == pytest.approx(0.0, abs=1e-9)
    assert again.covariance[3, 3] > pose.covariance[3, 3] + 0.9 * CONFIG.start_yaw_sigma_rad**2


def test_a_late_report_changes_nothing():
    pose_filter, t = resting_filter()
    pose_filter.observe_telemetry(later(t, 1.0))
    before = pose_filter.pose(1.0)
    pose_filter.observe_telemetry(later(t, 0.5, velocity_m_s=np.array([3.0, 0, 0])))
    np.testing.assert_array_equal(pose_filter.pose(1.0).T_world_cam, before.T_world_cam)


def test_a_box_that_does_not_fit_is_refused():
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
    np.testing.assert_array_equal(pose_filter.pose(6.0).T_world_cam, before.T_world_cam)


def sees(pose_filter: PoseFilter, at_s: float, top_px: float, bottom_px: float) -> bool:
    """Show it a box in the middle of the picture's width."""
    centre_x = TELLO_INTRINSICS.cx
    corners = np.array([centre_x - 60.0, top_px, centre_x + 60.0, bottom_px])
    return pose_filter.observe_box(Box(corners, 0.9, False), at_s)


def known_log_height(pose_filter: PoseFilter) -> tuple[float, float]:
    """Return the mean and sigma of the object's log height (m) as this drone alone knows it."""
    belief = pose_filter.target_belief()
    return float(belief.vector[3]), float(np.sqrt(belief.covariance[3, 3]))


@pytest.mark.parametrize("bottom_share", [0.6, 1.0])
def test_a_box_cut_above_or_below_says_nothing_of_the_size(bottom_share: float) -> None:
    pose_filter, t = resting_filter()
    pose_filter.observe_telemetry(later(t, 0.1))
    before, sigma_before = known_log_height(pose_filter)
    assert sees(pose_filter, 0.1, 0.0, TELLO_INTRINSICS.height * bottom_share - 1.0)
    after, sigma_after = known_log_height(pose_filter)
    assert after == pytest.approx(before, abs=0.02)
    assert sigma_after == pytest.approx(sigma_before, rel=0.02)


def hovering_sight(seconds: float, shown_m: Callable[[float], float]) -> PoseFilter:
    """Hover in front of an object of which ``shown_m(at_s)`` metres of height are in the box.

    Nearly all of these boxes are believed.
    """
    pose_filter, t = resting_filter()
    camera, dt_s, refused = TELLO_INTRINSICS, 0.1, 0
    at = np.array([2.2, 0.0, 0.9])
    pose_filter.resume(later(t, 0.0, height_m=0.8, tof_m=0.9), at, 0.05)
    for k in range(1, int(seconds / dt_s)):
        at_s = dt_s * k
        pose_filter.observe_telemetry(later(t, at_s, height_m=0.8, tof_m=0.9))
        # The box begins at the floor, as a part of something that stands there does.
        ends = np.array([[0.0, -0.15, shown_m(at_s)], [0.0, 0.15, 0.0]])
        T = look_at(at, at + pose_filter.pose(0.0).T_world_cam[:3, 2])
        pixels, _ = camera.project(ends, T)
        corners = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        refused += not pose_filter.observe_box(Box(corners, 0.9, False), at_s)
    assert refused < 0.1 * seconds / dt_s
    return pose_filter


def grown(at_s: float) -> float:
    return 0.5 * 2.0 ** np.clip(at_s / 10.0 - 1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    "shown_m",
    [grown, lambda at_s: 0.5 if at_s < 10.0 else 1.0, lambda at_s: 0.5 if at_s < 10.0 else 0.25],
    ids=["grows", "doubles", "halves"],
)
def test_a_drone_that_hovers_is_not_moved_by_a_box_of_a_part_that_becomes_one_of_all(
    shown_m: Callable[[float], float],
) -> None:
    """A guitar's body is half of the guitar: what doubles in the picture need not be nearer."""
    steady = hovering_sight(30.0, lambda _: 0.5)
    other = hovering_sight(30.0, shown_m)
    moved = other.pose(30.0).position_world - steady.pose(30.0).position_world
    assert np.linalg.norm(moved) < 0.1


def test_a_reported_height_that_is_off_by_far_is_believed_in_the_end() -> None:
    """A step in the floor, or a pose that was wrong: it must not shut the sensor out."""
    pose_filter, t = resting_filter()
    pose_filter.resume(later(t, 0.0, height_m=0.8, tof_m=0.9), np.array([2.0, 0.0, 1.15]), 0.02)
    for k in range(1, 60):
        pose_filter.observe_telemetry(later(t, 0.1 * k, height_m=0.8, tof_m=0.9))
    # A part of it is taken for an error of the sensor's zero.
    assert pose_filter.pose(6.0).position_world[2] == pytest.approx(0.9, abs=0.12)


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


def test_many_reports_of_one_height_say_no_more_than_one() -> None:
    """Reported heights are rounded to 10 cm: their error does not average out."""
    pose_filter, t = resting_filter()
    sigmas = []
    for k in range(1, 200):
        # It hovers where the distance sensor sees nothing.
        pose_filter.observe_telemetry(later(t, 0.1 * k, height_m=0.8 if k > 5 else 0.0))
        sigmas.append(np.sqrt(pose_filter.pose(0.1 * k).covariance[2, 2]))
    assert min(sigmas[10:]) > 0.02
    assert sigmas[-1] > sigmas[10]


def test_the_zero_of_the_distance_sensor_is_learned_on_the_way_up() -> None:
    """A sensor that reads 8 cm too much lifts no drone by 8 cm."""
    pose_filter, t = resting_filter()
    climb_m_s, dt_s = 0.3, 0.1
    for k in range(1, 41):
        body_m = min(0.9, climb_m_s * dt_s * k)
        climbing = np.array([0.0, 0.0, climb_m_s if body_m < 0.9 else 0.0])
        pose_filter.observe_telemetry(
            later(
                t,
                dt_s * k,
                velocity_m_s=climbing,
                height_m=round(body_m * 10) / 10,
                tof_m=None if body_m < 0.2 else body_m + CONFIG.start_height_m + 0.08,
            )
        )
    pose = pose_filter.pose(4.0)
    error_m = pose.position_world[2] - (0.9 + CONFIG.start_height_m)
    assert abs(error_m) < 0.035
    assert abs(error_m) < 3.0 * np.sqrt(pose.covariance[2, 2])


def seed_of(size: tuple[float, float, float]) -> SeedGeometry:
    half = np.array(size) / 2.0
    box = Box3(np.array([0.3, -0.2, 0.4]) - half, np.array([0.3, -0.2, 0.4]) + half)
    return SeedGeometry(box, (box,), 4)


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 1.9, 3.3, 5.0])
def test_a_long_box_shifts_and_grows_as_a_camera_sees_it(azimuth: float) -> None:
    """Against the projection of its corners by a camera that looks at its middle."""
    seed = seed_of((0.9, 0.3, 0.6))

    def seen(angle: float) -> np.ndarray:
        offset = np.array([1.8 * np.cos(angle), 1.8 * np.sin(angle), 0.5])
        T = look_at(seed.outer.centre + offset, seed.outer.centre)
        pixels, _ = TELLO_INTRINSICS.project(seed.outer.corners, T)
        middle = (pixels.min(axis=0) + pixels.max(axis=0)) / 2.0
        tangents = (middle - [TELLO_INTRINSICS.cx, TELLO_INTRINSICS.cy]) / TELLO_INTRINSICS.fx
        return np.append(tangents, np.log(np.ptp(pixels[:, 1])))

    offset = np.array([1.8 * np.cos(azimuth), 1.8 * np.sin(azimuth), 0.5])
    around = azimuth + np.arange(12) * np.pi / 6.0
    expected = seen(azimuth) - np.mean([seen(angle) for angle in around], axis=0)
    np.testing.assert_allclose(view_dependence(seed, offset), expected, atol=1e-3)


def test_a_round_object_looks_the_same_from_all_sides() -> None:
    # A square pillar repeats every quarter turn.
    seed = seed_of((0.4, 0.4, 0.9))
    views = [
        view_dependence(seed, np.array([1.8 * np.cos(a), 1.8 * np.sin(a), 0.5]))
        for a in (0.3, 0.3 + np.pi / 2, 0.3 + np.pi)
    ]
    np.testing.assert_allclose(views[0], views[1], atol=1e-9)
    np.testing.assert_allclose(views[0], views[2], atol=1e-9)
    assert np.abs(views[0]).max() < 0.06
