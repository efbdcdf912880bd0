"""Configuration of drones, fleet and safety rules, and the fleet file.

Everything here is frozen and checked when it is made: a wrong value raises ``ValueError`` naming
the field. The fleet file is TOML; its keys are the field names below.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from ipaddress import AddressValueError, IPv4Address
from pathlib import Path
from typing import Any

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics

MAX_DRONES = 8

# Distinguishable on light and dark ground and for the common kinds of colour blindness.
DRONE_COLOURS = (
    "#e69f00",
    "#56b4e9",
    "#009e73",
    "#cc79a7",
    "#f0e442",
    "#0072b2",
    "#d55e00",
    "#999999",
)


class FleetFileError(ValueError):
    """A fleet file cannot be used; the text is one line naming the file and the key."""


def _check(holds: bool, name: str, rule: str, value: object) -> None:
    if not holds:
        raise ValueError(f"{name} {rule}, not {value!r}")


def _check_address(name: str, value: str) -> None:
    try:
        IPv4Address(value)
    except AddressValueError:
        raise ValueError(f"{name} must be an IPv4 address, not {value!r}") from None


@dataclass(frozen=True, slots=True)
class DroneConfig:
    """One drone: who it is, where it stands at the start, how it is reached.

    Attributes:
        id: Its ``drone_id``; letters, digits, ``-`` and ``_``.
        name: For people; empty means the id.
        colour: ``#rrggbb``; empty means one by its place in the fleet.
        azimuth_deg: Nominal place on the start circle, degrees counter-clockwise from world +X.
        address: IPv4 address of the drone.
        local_address: IPv4 address our sockets are bound to; empty means any.
        interface: Network interface our sockets are bound to; empty means any. Needed when
            several drones share one address, one per Wi-Fi adapter.
        command_port: The drone's command port.
        state_port: Our port for state reports.
        video_port: Our port for video.
        edu: True for an EDU (SDK 2.0 or later), False for the consumer drone.
        tilt_deg: How far the camera looks below the horizon, degrees.
        intrinsics: Calibration of the camera, pixels.
    """

    id: str = "drone-1"
    name: str = ""
    colour: str = ""
    azimuth_deg: float = 0.0
    address: str = "192.168.10.1"
    local_address: str = ""
    interface: str = ""
    command_port: int = 8889
    state_port: int = 8890
    video_port: int = 11111
    edu: bool = True
    tilt_deg: float = 12.0
    intrinsics: Intrinsics = TELLO_INTRINSICS

    def __post_init__(self) -> None:
        _check(
            bool(re.fullmatch(r"[A-Za-z0-9_-]{1,32}", self.id)),
            "id",
            "must be 1-32 letters, digits, - or _",
            self.id,
        )
        _check(
            not self.colour or bool(re.fullmatch(r"#[0-9a-fA-F]{6}", self.colour)),
            "colour",
            "must look like #rrggbb",
            self.colour,
        )
        _check(math.isfinite(self.azimuth_deg), "azimuth_deg", "must be finite", self.azimuth_deg)
        _check_address("address", self.address)
        if self.local_address:
            _check_address("local_address", self.local_address)
        # The kernel's limit for interface names is 15 bytes.
        _check(
            bool(re.fullmatch(r"[^\s/]{0,15}", self.interface)),
            "interface",
            "must be an interface name of at most 15 characters",
            self.interface,
        )
        for name in ("command_port", "state_port", "video_port"):
            port = getattr(self, name)
            _check(1 <= port <= 65535, name, "must be 1-65535", port)
        _check(
            self.state_port != self.video_port,
            "video_port",
            "must differ from state_port",
            self.video_port,
        )
        _check(-30.0 <= self.tilt_deg <= 60.0, "tilt_deg", "must be -30 to 60", self.tilt_deg)

    @property
    def label(self) -> str:
        """The name for people."""
        return self.name or self.id


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """The drones and the circle they start on.

    Attributes:
        drones: One to eight drones with distinct ids and distinct addresses (two drones may share
            an address when their interfaces differ).
        start_radius_m: Radius of the nominal start circle, metres.
    """

    drones: tuple[DroneConfig, ...]
    start_radius_m: float = 1.8

    def __post_init__(self) -> None:
        _check(
            1 <= len(self.drones) <= MAX_DRONES,
            "drones",
            f"must be 1 to {MAX_DRONES} drones",
            len(self.drones),
        )
        _check(
            0.3 <= self.start_radius_m <= 20.0,
            "start_radius_m",
            "must be 0.3 to 20",
            self.start_radius_m,
        )
        ids: set[str] = set()
        reached: dict[tuple[str, str], str] = {}
        for drone in self.drones:
            _check(drone.id not in ids, "id", "must be unique", drone.id)
            ids.add(drone.id)
            other = reached.setdefault((drone.address, drone.interface), drone.id)
            _check(
                other == drone.id,
                "address",
                f"must be unique per interface ({other} and {drone.id} share it)",
                drone.address,
            )


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """Thresholds of the safety rules, see ``server.swarm.safety``.

    Attributes:
        fence_radius_m: Drones stay within this distance of the world's z axis, metres.
        floor_m: Lowest flying height of the camera above the floor, metres.
        ceiling_m: Greatest flying height, metres.
        standoff_m: Smallest distance to the object's box, metres.
        separation_m: Two drones nearer than this to each other hold, metres.
        fence_slack_m: How far outside fence or ceiling a drone may be before it holds, metres.
        max_speed_m_s: No setpoint is faster, metres per second.
        max_yaw_rate_rad_s: No setpoint turns faster, radians per second.
        brake_s: A drone ``d`` metres before a limit may approach it at ``d / brake_s``.
        state_hold_s: Hover when the newest state report is older, seconds.
        state_land_s: Land when it is older than this, seconds.
        battery_take_off_pct: No take-off below, percent.
        battery_land_pct: Land at or below, percent.
        temperature_take_off_c: No take-off at or above, degrees Celsius.
        temperature_land_c: Land at or above, degrees Celsius.
    """

    fence_radius_m: float = 4.5
    floor_m: float = 0.25
    ceiling_m: float = 3.0
    standoff_m: float = 0.5
    separation_m: float = 0.6
    fence_slack_m: float = 0.4
    max_speed_m_s: float = 0.5
    max_yaw_rate_rad_s: float = 1.0
    brake_s: float = 0.9
    state_hold_s: float = 1.0
    state_land_s: float = 3.0
    battery_take_off_pct: int = 20
    battery_land_pct: int = 15
    temperature_take_off_c: float = 95.0
    temperature_land_c: float = 100.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            _check(math.isfinite(value) and value > 0, item.name, "must be positive", value)
        _check(self.floor_m < self.ceiling_m, "ceiling_m", "must be above floor_m", self.ceiling_m)
        _check(
            self.state_hold_s < self.state_land_s,
            "state_land_s",
            "must exceed state_hold_s",
            self.state_land_s,
        )
        _check(
            self.battery_land_pct < self.battery_take_off_pct <= 100,
            "battery_take_off_pct",
            "must exceed battery_land_pct and be at most 100",
            self.battery_take_off_pct,
        )
        _check(
            self.temperature_take_off_c <= self.temperature_land_c,
            "temperature_land_c",
            "must be at least temperature_take_off_c",
            self.temperature_land_c,
        )


@dataclass(frozen=True, slots=True)
class TimingConfig:
    """Times of the driver.

    Attributes:
        beat_s: Period of the rc loop, seconds.
        setpoint_life_s: A setpoint older than this counts as hover, seconds.
        keep_alive_s: On the ground something is sent at least this often, seconds.
        retry_s: An unanswered harmless command is repeated after this time, seconds.
        take_off_s: Longest wait for a take-off, seconds.
        land_s: Longest wait for a landing, seconds.
        land_repeat_s: ``land`` is repeated this often until the drone is down, seconds.
        cut_repeat_s: ``emergency`` is repeated this often until the motors stand, seconds.
        video_silence_s: ``streamon`` is repeated after this long without video, seconds.
        stop_repeats_s: When the repeats of a stop are sent after the first, seconds.
    """

    beat_s: float = 0.05
    setpoint_life_s: float = 0.4
    keep_alive_s: float = 4.0
    retry_s: float = 1.0
    take_off_s: float = 20.0
    land_s: float = 20.0
    land_repeat_s: float = 1.0
    cut_repeat_s: float = 0.2
    video_silence_s: float = 2.0
    stop_repeats_s: tuple[float, ...] = field(default=(0.05, 0.1, 0.2, 0.4))

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                _check(math.isfinite(number) and number > 0, item.name, "must be positive", value)
        _check(bool(self.stop_repeats_s), "stop_repeats_s", "must not be empty", ())
        # The drone lands by itself after 15 s of silence; one lost datagram must not lead there.
        _check(self.keep_alive_s <= 5.0, "keep_alive_s", "must be at most 5", self.keep_alive_s)


_INTRINSICS_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "distortion")


def load_fleet(path: Path) -> FleetConfig:
    """Read a fleet file.

    The file holds ``start_radius_m`` and one ``[[drones]]`` table per drone, with an optional
    ``[drones.intrinsics]``. Left-out azimuths are spread evenly; left-out ids count from 1.

    Raises:
        FleetFileError: If the file cannot be read or anything in it is unknown, of a wrong type
            or out of range.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise FleetFileError(f"{path}: cannot be read: {reason}") from error
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason = " ".join(str(error).split())
        raise FleetFileError(f"{path}: not valid TOML: {reason}") from error
    try:
        return _fleet_from(document)
    except ValueError as error:
        raise FleetFileError(f"{path}: {error}") from error


def _fleet_from(document: Mapping[str, object]) -> FleetConfig:
    for key in document:
        if key not in ("start_radius_m", "drones"):
            raise ValueError(f"unknown key {key!r} (known: start_radius_m, drones)")
    tables = document.get("drones")
    if not isinstance(tables, list) or not tables:
        raise ValueError("drones: at least one [[drones]] table is needed")
    if len(tables) > MAX_DRONES:
        raise ValueError(f"drones: at most {MAX_DRONES} drones, not {len(tables)}")
    drones: list[DroneConfig] = []
    for index, table in enumerate(tables):
        where = f"drones[{index + 1}]"
        if not isinstance(table, dict):
            raise ValueError(f"{where} must be a table")
        drones.append(_drone_from(table, index, len(tables), where))
    radius = document.get("start_radius_m", 1.8)
    return FleetConfig(tuple(drones), _number(radius, "start_radius_m"))


def _drone_from(table: Mapping[str, object], index: int, count: int, where: str) -> DroneConfig:
    defaults = DroneConfig()
    known = [item.name for item in fields(DroneConfig)]
    values: dict[str, object] = {
        "id": f"drone-{index + 1}",
        "colour": DRONE_COLOURS[index],
        "azimuth_deg": 360.0 * index / count,
    }
    for key, value in table.items():
        label = f"{where}.{key}"
        if key not in known:
            raise ValueError(f"{where}: unknown key {key!r} (known: {', '.join(known)})")
        if key == "intrinsics":
            values[key] = _intrinsics_from(value, label)
        else:
            values[key] = _typed(value, getattr(defaults, key), label)
    try:
        return DroneConfig(**values)  # pyright: ignore[reportArgumentType]  # Typed just above.
    except ValueError as error:
        raise ValueError(f"{where}.{error}") from error


def _typed(value: object, example: object, label: str) -> object:
    if isinstance(example, float):
        return _number(value, label)
    # bool is a subclass of int, so the exact type is asked for.
    if type(value) is not type(example):
        raise ValueError(f"{label} must be of type {type(example).__name__}, not {value!r}")
    return value


def _number(value: object, label: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{label} must be a number, not {value!r}")
    return float(value)


def _intrinsics_from(value: object, label: str) -> Intrinsics:
    if not isinstance(value, dict):
        raise ValueError(f"{label} must be a table")
    numbers: dict[str, Any] = {}
    for key, item in value.items():
        if key not in _INTRINSICS_KEYS:
            raise ValueError(f"{label}: unknown key {key!r} (known: {', '.join(_INTRINSICS_KEYS)})")
        if key == "distortion":
            if not isinstance(item, list) or len(item) != 5:
                raise ValueError(f"{label}.distortion must be five numbers k1, k2, p1, p2, k3")
            numbers[key] = tuple(_number(k, f"{label}.distortion") for k in item)
        elif key in ("width", "height"):
            numbers[key] = _typed(item, 1, f"{label}.{key}")
        else:
            numbers[key] = _number(item, f"{label}.{key}")
    merged = {key: numbers.get(key, getattr(TELLO_INTRINSICS, key)) for key in _INTRINSICS_KEYS}
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        if not math.isfinite(merged[key]):
            raise ValueError(f"{label}.{key} must be finite, not {merged[key]!r}")
    if not all(map(math.isfinite, merged["distortion"])):
        raise ValueError(f"{label}.distortion must be finite, not {merged['distortion']!r}")
    for key in ("width", "height", "fx", "fy"):
        if not merged[key] > 0:
            raise ValueError(f"{label}.{key} must be positive, not {merged[key]!r}")
    return Intrinsics(**merged)
