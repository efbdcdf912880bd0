"""The simulated airframe against what is known of the real one."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.geometry.poses import camera_pose, yaw_of_camera
from server.sim.config import DynamicsConfig, SimConfig, fleet_config
from server.sim.dynamics import Airframe
from server.sim.sdk import state_line
from server.sim.sensors import camera_from_angles
from server.sim.sticks import stick_speed
from server.sim.tello import placed_airframe
from server.stages import Setpoint
from server.swarm.protocol import decode_state, rc_from_setpoint

CALM = DynamicsConfig.calm()
STEP_S = 0.02


def airframe(config: DynamicsConfig = CALM, yaw_rad: float = 0.0, seed: int = 0) -> Airframe:
    return Airframe(np.zeros(3), yaw_rad, config, np.random.default_rng(seed))


def fly(body: Airframe, seconds: float) -> int:
    """Step on; return in how many steps something ended."""
    ended = 0
    for _ in range(round(seconds / STEP_S)):
        body.step(STEP_S)
        ended += body.finished
    return ended


def hovering(config: DynamicsConfig = CALM, yaw_rad: float = 0.0, seed: int = 0) -> Airframe:
    body = airframe(config, yaw_rad, seed)
    body.take_off()
    fly(body, 8.0)
    assert body.phase == "flying"
    return body


def test_take_off_ends_once_at_its_height_and_landing_on_the_floor() -> None:
    body = airframe()
    body.take_off()
    assert body.motors_on
    assert fly(body, 10.0) == 1
    assert body.position[2] == pytest.approx(CALM.take_off_height_m, abs=0.05)
    body.land()
    assert fly(body, 10.0) == 1
    assert body.phase == "standing"
    assert body.position[2] == 0.0
    assert not body.motors_on


@pytest.mark.parametrize(
    ("axis", "world_axis", "sign"),
    [(0, 1, -1), (1, 0, 1), (2, 2, 1)],
    ids=["right", "forward", "up"],
)
@pytest.mark.parametrize("stick", [50.0, -30.0])
def test_sticks_move_it_along_their_axis(
    axis: int, world_axis: int, sign: int, stick: float
) -> None:
    """Heading along +X: right is -Y, forward +X, up +Z; the speeds are the calibrated ones."""
    body = hovering()
    sticks = [0.0] * 4
    sticks[axis] = stick
    body.sticks = (sticks[0], sticks[1], sticks[2], sticks[3])
    fly(body, 2.0)
    assert body.velocity[world_axis] == pytest.approx(sign * stick_speed(axis, stick), rel=0.01)
    assert np.abs(np.delete(body.velocity, world_axis)).max() < 1e-6


@pytest.mark.parametrize("stick", [50.0, -50.0])
def test_the_fourth_stick_turns_clockwise(stick: float) -> None:
    body = hovering()
    body.sticks = (0.0, 0.0, 0.0, stick)
    fly(body, 2.0)
    before = body.yaw_rad
    fly(body, 1.0)
    assert body.yaw_rad - before == pytest.approx(
        -math.copysign(math.radians(35.1), stick), rel=0.01
    )


def test_forward_follows_the_heading() -> None:
    body = hovering(yaw_rad=math.pi / 2)
    body.sticks = (0.0, 50.0, 0.0, 0.0)
    fly(body, 2.0)
    assert body.velocity[1] == pytest.approx(0.287, rel=0.01)
    assert abs(body.velocity[0]) < 1e-6


@pytest.mark.parametrize(
    ("axis", "stick", "speed"),
    [(0, 20, 0.099), (1, 50, 0.287), (2, 100, 0.40), (3, 30, math.radians(16.9)), (1, 9.9, 0.0)],
)
def test_stick_speeds_are_those_of_the_calibration(axis: int, stick: float, speed: float) -> None:
    assert stick_speed(axis, stick) == pytest.approx(speed)
    assert stick_speed(axis, -stick) == pytest.approx(-speed)


@pytest.mark.parametrize("axis", range(4))
def test_a_dead_zone_swallows_sticks_inside_and_leaves_those_outside(axis: int) -> None:
    for stick in (11.0, 19.9, -19.9):
        assert stick_speed(axis, stick) != 0.0
        assert stick_speed(axis, stick, 20.0) == 0.0
    for stick in (20.0, -20.0, 26.0, 100.0):
        assert stick_speed(axis, stick, 20.0) == stick_speed(axis, stick) != 0.0


def test_a_drone_with_a_larger_dead_zone_stands_still_for_longer() -> None:
    body = hovering(replace(CALM, dead_zone=20.0))
    body.sticks = (19.0, -19.0, 19.0, 19.0)
    before, yaw_rad = body.position, body.yaw_rad
    fly(body, 2.0)
    np.testing.assert_allclose(body.position, before, atol=0.03)  # The climb's last centimetres.
    assert body.yaw_rad == yaw_rad
    body.sticks = (0.0, 21.0, 0.0, 0.0)
    fly(body, 3.0)
    assert body.velocity[0] == pytest.approx(stick_speed(1, 21.0), rel=0.01)


@pytest.mark.parametrize("dead_zone", [9.9, 50.1, math.inf, math.nan])
def test_senseless_dead_zones_are_refused_by_name(dead_zone: float) -> None:
    with pytest.raises(ValueError, match="dead_zone"):
        DynamicsConfig(dead_zone=dead_zone)


@pytest.mark.parametrize("name", ["forward", "left", "up", "turn"])
def test_driver_and_simulator_invert_each_other(name: str) -> None:
    """Two tables of one calibration: a wish comes back as that speed, rounded to whole sticks."""
    for wish in np.linspace(0.08, 0.38, 7):
        values = {"forward": 0.0, "left": 0.0, "up": 0.0, "turn": 0.0, name: float(wish)}
        velocity = np.array([values["forward"], values["left"], values["up"]])
        sticks = rc_from_setpoint(Setpoint(velocity, values["turn"]))
        axis, sign = {"left": (0, -1), "forward": (1, 1), "up": (2, 1), "turn": (3, -1)}[name]
        assert sign * stick_speed(axis, sticks[axis]) == pytest.approx(wish, abs=0.012)


def test_speed_follows_the_stick_with_a_lag() -> None:
    body = hovering()
    body.sticks = (0.0, 50.0, 0.0, 0.0)
    fly(body, CALM.lag_s)
    assert body.velocity[0] == pytest.approx(0.287 * (1 - math.exp(-1)), rel=0.06)


def test_stop_hovers_also_out_of_take_off_and_landing() -> None:
    body = airframe()
    body.take_off()
    fly(body, 1.0)
    body.stop()
    height = body.position[2]
    fly(body, 3.0)
    assert body.phase == "flying"
    assert body.position[2] == pytest.approx(height, abs=0.15)
    body.land()
    fly(body, 0.3)
    body.stop()
    fly(body, 3.0)
    assert body.phase == "flying"


def test_cut_falls() -> None:
    body = hovering()
    body.cut()
    assert body.phase == "falling"
    assert not body.motors_on
    fly(body, 0.3)
    assert body.position[2] == pytest.approx(0.8 - 0.5 * 9.8 * 0.09, abs=0.07)
    fly(body, 1.0)
    assert body.phase == "standing"
    assert body.position[2] == 0.0
    grounded = airframe()
    grounded.cut()
    assert grounded.phase == "standing"


def test_manoeuvres_end_at_their_goal() -> None:
    body = hovering(yaw_rad=math.pi / 2)
    start = body.position.copy()
    body.fly(1.0, 0.5, 0.2, 0.5)
    assert fly(body, 12.0) == 1
    np.testing.assert_allclose(body.position - start, [-0.5, 1.0, 0.2], atol=0.06)
    body.turn(math.radians(-90))
    assert fly(body, 8.0) == 1
    assert body.yaw_rad == pytest.approx(0.0, abs=math.radians(3))


@pytest.mark.parametrize("seed", range(8))
def test_a_drifting_drone_still_comes_to_the_end_of_a_move(seed: int) -> None:
    """Clients in the wild give a move seven seconds."""
    body = hovering(DynamicsConfig(), seed=seed)
    start = body.position
    body.fly(0.0, 0.0, 0.4, 1.0)
    assert fly(body, 6.5) == 1
    assert body.position[2] - start[2] == pytest.approx(0.4, abs=0.15)


def test_a_move_against_the_wind_ends_where_its_time_is_up() -> None:
    body = hovering()
    body.whims.wind = (-1.5, 0.0, 0.0)
    body.fly(1.0, 0.0, 0.0, 0.5)
    assert fly(body, 12.0) == 1
    assert body.position[0] < 0.5


def test_it_never_sinks_below_the_floor() -> None:
    body = hovering()
    body.sticks = (0.0, 0.0, -100.0, 0.0)
    fly(body, 10.0)
    assert body.position[2] >= 0.0


def test_battery_and_motor_clock() -> None:
    body = hovering(replace(CALM, flight_time_s=100.0, idle_time_s=1000.0))
    motor_s, battery = body.motor_time_s, body.battery_pct
    fly(body, 10.0)
    assert body.motor_time_s - motor_s == pytest.approx(10.0)
    assert battery - body.battery_pct == pytest.approx(10.0)
    body.land()
    fly(body, 5.0)
    motor_s, battery = body.motor_time_s, body.battery_pct
    fly(body, 10.0)
    assert body.motor_time_s == motor_s
    assert battery - body.battery_pct == pytest.approx(1.0)


def test_the_whole_chain_to_telemetry_keeps_signs_and_steps() -> None:
    """What the driver reads of a drone that flies forward, left and up while turning left."""
    body = hovering()
    body.sticks = (-50.0, 70.0, 70.0, -40.0)
    fly(body, 1.5)
    line = state_line(body)
    assert line.startswith(b"mid:")
    assert line.endswith(b";\r\n")
    assert 130 <= len(line) <= 190
    telemetry = decode_state(line, "d", 0.0)
    assert (telemetry.velocity_m_s > 0).all()
    c, s = math.cos(body.yaw_rad), math.sin(body.yaw_rad)
    forward, left = (
        c * body.velocity[0] + s * body.velocity[1],
        -s * body.velocity[0] + c * body.velocity[1],
    )
    # Steps of a decimetre per second, and 4 cm/s of noise.
    np.testing.assert_allclose(telemetry.velocity_m_s[:2], [forward, left], atol=0.05 + 0.16)
    assert telemetry.yaw_rad == pytest.approx(body.yaw_rad, abs=math.radians(0.51))
    assert telemetry.height_m * 10 == round(telemetry.height_m * 10)
    assert telemetry.height_m == pytest.approx(body.position[2], abs=0.051)
    assert telemetry.acceleration_m_s2[2] == pytest.approx(9.8, abs=0.6)
    assert telemetry.tof_m == pytest.approx(body.position[2] + 0.08, abs=0.05)


def test_the_range_finder_reports_sentinels() -> None:
    body = airframe()
    assert body.readings()["tof"] == 10
    body.position = np.array([0.0, 0.0, 9.0])
    assert body.readings()["tof"] == 6553


def test_a_pushed_start_reports_no_heading_error() -> None:
    """The drone's own yaw starts at zero wherever it looks: truth does not leak through it."""
    body = airframe(yaw_rad=2.0)
    assert abs(body.readings()["yaw"]) <= 1


def test_hover_drifts_by_centimetres_per_second() -> None:
    speeds = []
    for seed in range(4):
        body = hovering(DynamicsConfig(), seed=seed)
        for _ in range(10):
            fly(body, 1.0)
            speeds.append(np.linalg.norm(body.velocity[:2]))
    assert 0.005 < float(np.mean(speeds)) < 0.06


def test_one_seed_gives_one_flight() -> None:
    first, second = (hovering(DynamicsConfig(), seed=5) for _ in range(2))
    np.testing.assert_array_equal(first.position, second.position)
    assert not np.array_equal(first.position, hovering(DynamicsConfig(), seed=6).position)


def test_the_camera_looks_ahead_and_down() -> None:
    T = hovering().T_world_cam()
    assert yaw_of_camera(T) == pytest.approx(0.0, abs=1e-6)
    assert T[2, 2] == pytest.approx(-math.sin(math.radians(12.0)), abs=1e-3)
    assert T[0, 3] == pytest.approx(0.035, abs=1e-6)


def test_the_camera_pose_written_out_is_the_composed_one() -> None:
    """Against the poses module's own composition and a turn about the optical axis."""
    for yaw, nose, roll in [(0.3, 0.2, 0.0), (-2.0, 0.5, 0.3), (1.0, -0.4, -1.0)]:
        expected = camera_pose(np.array([1.0, 2.0, 3.0]), yaw, nose)
        expected[:3, :3] = expected[:3, :3] @ Rotation.from_euler("z", roll).as_matrix()
        got = camera_from_angles((1.0, 2.0, 3.0), yaw, nose, roll)
        np.testing.assert_allclose(got, expected, atol=1e-12)


def test_the_downward_camera_sees_the_floor_with_the_nose_up() -> None:
    T = hovering(yaw_rad=0.7).T_world_down_cam()
    np.testing.assert_allclose(T[:3, 2], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(-T[:3, 1], [math.cos(0.7), math.sin(0.7), 0.0], atol=1e-12)


def test_drones_are_set_down_roughly_on_the_circle() -> None:
    config = SimConfig(start_sigma_m=1.0, start_sigma_deg=90.0, base_address="127.3.2.1")
    for index in range(config.drones):
        body = placed_airframe(config, index)
        azimuth = math.radians(config.azimuth_deg(index))
        nominal = 1.8 * np.array([math.cos(azimuth), math.sin(azimuth)])
        assert np.linalg.norm(body.position[:2] - nominal) <= 0.2 + 1e-9
        turned = (body.yaw_rad - azimuth - math.pi + math.pi) % (2 * math.pi) - math.pi
        assert abs(turned) <= math.radians(15) + 1e-9


def test_the_fleet_that_reaches_the_simulation() -> None:
    fleet = fleet_config(SimConfig(base_address="127.3.2.1"))
    assert [drone.address for drone in fleet.drones] == [f"127.3.2.{k}" for k in (1, 2, 3, 4)]
    assert [drone.local_address for drone in fleet.drones] == [
        f"127.3.2.{k}" for k in (101, 102, 103, 104)
    ]
    assert [drone.azimuth_deg for drone in fleet.drones] == [0.0, 90.0, 180.0, 270.0]


@pytest.mark.parametrize(
    "change",
    [
        {"drones": 0},
        {"drones": 9},
        {"base_address": "10.0.0.1"},
        {"base_address": "127.0.1.98"},
        {"base_address": "localhost"},
        {"start_radius_m": math.nan},
        {"seed": -1},
        {"supersample": 5},
        {"fps_cap": 60.0},
        {"bitrate_kbit_s": 1},
        {"start_sigma_m": -0.1},
    ],
)
def test_senseless_simulations_are_refused_by_name(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(change))):
        SimConfig(**change)  # pyright: ignore[reportArgumentType]


def test_senseless_dynamics_are_refused_by_name() -> None:
    for item in fields(DynamicsConfig):
        with pytest.raises(ValueError, match=item.name):
            DynamicsConfig(**{item.name: -1.0})
