"""Configuration of the simulator; frozen, checked when made."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.sim.faults import Fault
from server.sim.sticks import FIRST_STICK
from server.sim.words import LEVELS, SdkLevel
from server.swarm.config import DRONE_COLOURS, MAX_DRONES, DroneConfig, FleetConfig

_LARGEST_DEAD_ZONE = 50.0


@dataclass(frozen=True, slots=True)
class DynamicsConfig:
    """How the simulated airframes fly and measure.

    Attributes:
        lag_s: Time constant with which velocity follows the sticks, seconds.
        gain_sigma: Spread of each drone's stick gains about the calibration, as a share.
        dead_zone: Sticks nearer to the centre than this do nothing, 10 to 50 of 100.
        take_off_height_m: Height of the hover after take-off, metres.
        climb_m_s: Speed of take-off, metres per second.
        sink_m_s: Speed of landing, metres per second.
        drift_sigma_m_s: Spread of the horizontal hover drift velocity, metres per second.
        drift_tau_s: How long a drift velocity lasts, seconds.
        gust_m_s: Spread of the velocity along each horizontal axis that a gust forces on it, metres
            per second; 0: still air.
        gust_period_s: Mean time from a gust to the next, seconds.
        gust_s: How long a gust blows, seconds.
        speed_scale_sigma: Spread of the scale of each drone's reported velocity, as a share.
        speed_lag_s: How far reported velocities lag behind, seconds.
        yaw_walk_deg: Heading drift that the drone does not notice, degrees per root second.
        gyro_bias_deg_s: Spread of each drone's constant heading drift, degrees per second.
        camera_offset_m: Camera ahead of the body's centre, metres.
        camera_height_m: Camera above the ground when standing, metres.
        tilt_deg: Camera below the horizon, degrees.
        tilt_sigma_deg: Spread of each drone's camera tilt about it, degrees.
        shake_deg: Spread of the camera's residual attitude in flight, degrees.
        sway: Share of the airframe's lean that the stabilised video still shows.
        flight_time_s: Seconds from full to empty battery in the air.
        idle_time_s: Seconds from full to empty on the ground.
        battery_pct: Charge at power-on, percent.
    """

    lag_s: float = 0.35
    gain_sigma: float = 0.05
    dead_zone: float = FIRST_STICK
    take_off_height_m: float = 0.8
    climb_m_s: float = 0.35
    sink_m_s: float = 0.4
    drift_sigma_m_s: float = 0.02
    drift_tau_s: float = 4.0
    gust_m_s: float = 0.1
    gust_period_s: float = 15.0
    gust_s: float = 1.5
    speed_scale_sigma: float = 0.04
    speed_lag_s: float = 0.1
    yaw_walk_deg: float = 0.1
    gyro_bias_deg_s: float = 0.01
    camera_offset_m: float = 0.035
    camera_height_m: float = 0.03
    tilt_deg: float = 12.0
    tilt_sigma_deg: float = 0.3
    shake_deg: float = 0.15
    sway: float = 0.3
    flight_time_s: float = 780.0
    idle_time_s: float = 3000.0
    battery_pct: float = 100.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value < 0:
                raise ValueError(f"{item.name} must be finite and not negative, not {value!r}")
        for name in ("lag_s", "climb_m_s", "sink_m_s", "drift_tau_s", "take_off_height_m"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")
        for name in ("flight_time_s", "idle_time_s", "gust_period_s", "gust_s"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")
        if not FIRST_STICK <= self.dead_zone <= _LARGEST_DEAD_ZONE:
            raise ValueError(
                f"dead_zone must be {FIRST_STICK:g} to {_LARGEST_DEAD_ZONE:g},"
                f" not {self.dead_zone!r}"
            )

    @classmethod
    def calm(cls) -> DynamicsConfig:
        """Return an airframe without whims: it does what it is told, and says what it does."""
        none = (
            "gain_sigma",
            "drift_sigma_m_s",
            "gust_m_s",
            "speed_scale_sigma",
            "speed_lag_s",
            "yaw_walk_deg",
            "gyro_bias_deg_s",
            "tilt_sigma_deg",
            "shake_deg",
        )
        return cls(**dict.fromkeys(none, 0.0))


@dataclass(frozen=True, slots=True)
class CameraConfig:
    """How the simulated cameras take pictures.

    Attributes:
        distortion: Brown's ``(k1, k2, p1, p2, k3)`` of every lens, which its calibration knows.
        focal_sigma: Spread of each lens's true focal length about the calibrated, as a share.
        principal_sigma_px: Spread of its true principal point on each axis, pixels.
        readout_s: Time from the first row's exposure to the last row's, seconds; 0: all at once.
        exposure_s: How long a row is exposed, seconds; 0: no smear.
        depth_m: Depth assumed of all that is seen where the camera's own shift smears it, metres.
        gain_sigma: Spread of the logarithm of the exposure, which wanders.
        balance_sigma: Spread of the logarithms of blue and red against green.
        gain_tau_s: How long an exposure lasts, seconds.
    """

    distortion: tuple[float, float, float, float, float] = (-0.0335, 0.1052, 0.0013, -0.0066, 0.0)
    focal_sigma: float = 0.01
    principal_sigma_px: float = 2.0
    readout_s: float = 0.02
    exposure_s: float = 0.01
    depth_m: float = 1.8
    gain_sigma: float = 0.1
    balance_sigma: float = 0.03
    gain_tau_s: float = 8.0

    def __post_init__(self) -> None:
        if len(self.distortion) != 5 or not all(map(math.isfinite, self.distortion)):
            raise ValueError(f"distortion must be five numbers, not {self.distortion!r}")
        for name, most in (
            ("focal_sigma", 0.015),
            ("principal_sigma_px", 5.0),
            ("readout_s", 0.05),
            ("exposure_s", 0.05),
            ("gain_sigma", 0.5),
            ("balance_sigma", 0.2),
        ):
            if not 0.0 <= getattr(self, name) <= most:
                raise ValueError(f"{name} must be 0 to {most:g}, not {getattr(self, name)!r}")
        for name in ("depth_m", "gain_tau_s"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")

    @property
    def calibrated(self) -> Intrinsics:
        """What is known of every drone's camera: the calibration of its type."""
        return replace(TELLO_INTRINSICS, distortion=self.distortion)

    @property
    def bends(self) -> bool:
        """True unless pictures keep the shape of what a nominal pinhole draws."""
        spreads = (self.focal_sigma, self.principal_sigma_px, self.readout_s)
        return any(self.distortion) or any(spreads)


@dataclass(frozen=True, slots=True)
class SimConfig:
    """What is simulated.

    Attributes:
        scene: Name of a scene or path of a .glb or .obj file.
        drones: How many, 1 to 8.
        base_address: Loopback address of the first drone; the others follow. In namespaces the
            address of all, loopback or not.
        start_radius_m: Radius of the nominal start circle, metres.
        start_sigma_m: Spread of the start position on each axis, metres, capped at 20 cm in all.
        start_sigma_deg: Spread of the start heading, degrees, capped at 15.
        seed: Seed of everything random.
        supersample: Pictures are rendered this many times larger and averaged down.
        fps_cap: No drone sends more pictures per second.
        bitrate_kbit_s: Upper bound of each drone's video rate at the picture rate its client asked
            for (30 a second by default), kbit/s. With 2500 key pictures have 35 kB and others 10,
            as tello_ros measured on a real drone.
        truth_file: Where the true poses of rendered pictures go, for benches only; None: nowhere.
        dynamics: How the drones fly.
        camera: How their cameras take pictures.
        faults: What goes wrong, and when.
        sdk: Text protocol the drones speak.
        friendly_reads: True for reads answered with plain whole numbers, as some clients expect.
        station: True for drones in a network of others instead of each with its own.
        namespaces: Network namespaces of the drones, one each, where all have the same address;
            empty: none, loopback addresses one after the other.
    """

    scene: str = "robot_dog"
    drones: int = 4
    base_address: str = "127.0.1.1"
    start_radius_m: float = 1.8
    start_sigma_m: float = 0.08
    start_sigma_deg: float = 5.0
    seed: int = 0
    supersample: int = 1
    fps_cap: float = 15.0
    bitrate_kbit_s: int = 2500
    truth_file: Path | None = None
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    camera: CameraConfig = field(default_factory=CameraConfig)
    faults: tuple[Fault, ...] = ()
    sdk: SdkLevel = "3.0"
    friendly_reads: bool = False
    station: bool = False
    namespaces: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.drones <= MAX_DRONES:
            raise ValueError(f"drones must be 1 to {MAX_DRONES}, not {self.drones}")
        try:
            base = IPv4Address(self.base_address)
        except AddressValueError:
            raise ValueError(
                f"base_address must be an IPv4 address, not {self.base_address!r}"
            ) from None
        if not self.namespaces:
            self._check_loopback(base)
        elif len(self.namespaces) != self.drones:
            raise ValueError(
                f"namespaces must be one for each of {self.drones} drones, not"
                f" {len(self.namespaces)}"
            )
        if self.sdk not in LEVELS:
            raise ValueError(f"sdk must be one of {', '.join(LEVELS)}, not {self.sdk!r}")
        ids = [self.drone_id(index) for index in range(self.drones)]
        for fault in self.faults:
            if fault.drone is not None and fault.drone not in ids:
                raise ValueError(
                    f"faults: {fault.kind} is for {fault.drone}, which is none of {', '.join(ids)}"
                )
        if not 0.3 <= self.start_radius_m <= 5.0:
            raise ValueError(f"start_radius_m must be 0.3 to 5, not {self.start_radius_m!r}")
        for name in ("start_sigma_m", "start_sigma_deg"):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0:
                raise ValueError(f"{name} must be finite and not negative, not {value!r}")
        if self.seed < 0:
            raise ValueError(f"seed must not be negative, not {self.seed}")
        if self.supersample not in (1, 2, 3, 4):
            raise ValueError(f"supersample must be 1 to 4, not {self.supersample!r}")
        if not 0.5 <= self.fps_cap <= 30.0:
            raise ValueError(f"fps_cap must be 0.5 to 30, not {self.fps_cap!r}")
        if not 200 <= self.bitrate_kbit_s <= 20000:
            raise ValueError(f"bitrate_kbit_s must be 200 to 20000, not {self.bitrate_kbit_s!r}")

    def _check_loopback(self, base: IPv4Address) -> None:
        last = int(self.base_address.rsplit(".", 1)[1])
        # Clients use the addresses 100 above the drones', see ``fleet_config``.
        if not base.is_loopback or not 1 <= last <= 100 - self.drones:
            raise ValueError(
                "base_address must be a loopback address whose last number leaves room for all"
                f" drones below 100, not {self.base_address!r}"
            )

    def drone_id(self, index: int) -> str:
        """Return the id of the drone with ``index`` from 0."""
        return f"drone-{index + 1}"

    def address(self, index: int) -> str:
        """Return the address of the drone with ``index`` from 0."""
        if self.namespaces:
            return self.base_address
        return str(IPv4Address(self.base_address) + index)

    def azimuth_deg(self, index: int) -> float:
        """Return the nominal place on the start circle of the drone with ``index`` from 0."""
        return 360.0 * index / self.drones


def fleet_config(config: SimConfig) -> FleetConfig:
    """Return the fleet that reaches simulated drones on loopback addresses.

    Each drone gets a local address of its own, 100 above the drone's, so that the fixed state and
    video ports never clash on one machine. Of the cameras it knows the calibration of their type;
    each drone's own lens is a little different.
    """
    drones = tuple(
        DroneConfig(
            id=config.drone_id(index),
            name=f"Drone {index + 1}",
            colour=DRONE_COLOURS[index],
            azimuth_deg=config.azimuth_deg(index),
            address=config.address(index),
            local_address=str(IPv4Address(config.address(index)) + 100),
            intrinsics=config.camera.calibrated,
        )
        for index in range(config.drones)
    )
    return FleetConfig(drones, config.start_radius_m)
