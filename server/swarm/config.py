"""Configuration of drones, fleet and safety rules.

Everything here is frozen and checked when it is made: a wrong value raises ``ValueError`` naming
the field. The fleet file, see ``server.swarm.fleet_file``, uses the field names below.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, fields
from ipaddress import AddressValueError, IPv4Address, IPv4Network
from typing import Literal, get_args

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.swarm.failsafes import FailsafeTable

MAX_DRONES = 8

# Every drone that makes its own Wi-Fi network is here.
AP_ADDRESS = "192.168.10.1"
# Where a drone sends to unless it was told otherwise.
STATE_PORT, VIDEO_PORT = 8890, 11111
# A search asks every address; more of them than this is no drone's home network.
_SMALLEST_PREFIX = 22

LinkKind = Literal["ap", "relay", "station"]

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
        link: ``ap``: it makes a Wi-Fi network of its own; ``relay``: a forwarder speaks for it;
            ``station``: it has joined a network. Empty means ``ap`` at the usual address or with
            an interface, else ``station`` with a serial number, else ``relay``.
        address: IPv4 address of the drone or its relay. Empty for a station known by its serial
            number alone: it is searched for.
        local_address: IPv4 address our sockets are bound to; empty means any.
        interface: Network interface our sockets are bound to; empty means any. Needed when
            several drones share one address, one per Wi-Fi adapter.
        command_port: The drone's command port.
        state_port: Our port for state reports. A station (SDK 3.0) is told when it is not 8890.
        video_port: Our port for video; likewise, 11111.
        edu: True for an EDU (SDK 2.0 or later), False for the consumer drone.
        serial: Its serial number; a drone with another one is refused. Empty means any.
        tilt_deg: How far the camera looks below the horizon, degrees.
        intrinsics: Calibration of the camera, pixels.
    """

    id: str = "drone-1"
    name: str = ""
    colour: str = ""
    azimuth_deg: float = 0.0
    link: str = ""
    address: str = AP_ADDRESS
    local_address: str = ""
    interface: str = ""
    command_port: int = 8889
    state_port: int = STATE_PORT
    video_port: int = VIDEO_PORT
    edu: bool = True
    serial: str = ""
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
        self._check_link()
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

    def _check_link(self) -> None:
        known = get_args(LinkKind)
        _check(self.link in ("", *known), "link", f"must be one of {', '.join(known)}", self.link)
        _check(
            bool(re.fullmatch(r"([0-9A-Z]{10,20})?", self.serial)),
            "serial",
            "must be 10-20 capital letters and digits, as on the drone's battery bay",
            self.serial,
        )
        if not self.link:
            at_home = bool(self.interface) or self.address == AP_ADDRESS
            kind = "ap" if at_home else "station" if self.serial else "relay"
            object.__setattr__(self, "link", kind)
        if self.address or self.link != "station" or not self.serial:
            _check_address("address", self.address)

    @property
    def label(self) -> str:
        """The name for people."""
        return self.name or self.id

    @property
    def moves_ports(self) -> bool:
        """Whether the drone must be told where to send state and video."""
        usual = (self.state_port, self.video_port) == (STATE_PORT, VIDEO_PORT)
        return self.link == "station" and not usual


@dataclass(frozen=True, slots=True)
class StationConfig:
    """The network in which drones without a known address are searched.

    Attributes:
        subnet: For example ``192.168.1.0/24``, /22 at most; empty means that none is searched.
        hosts_per_s: How many addresses are asked per second.
        search_again_s: A station that stays silent is searched anew this often, seconds.
    """

    subnet: str = ""
    hosts_per_s: float = 100.0
    search_again_s: float = 15.0

    def __post_init__(self) -> None:
        if self.subnet:
            self.network()
        for name, low, high in (("hosts_per_s", 1.0, 1000.0), ("search_again_s", 1.0, 3600.0)):
            value = getattr(self, name)
            _check(low <= value <= high, f"station.{name}", f"must be {low} to {high}", value)

    def network(self) -> IPv4Network:
        """Return the network to search.

        Raises:
            ValueError: If there is none or it is no small IPv4 network.
        """
        try:
            network = IPv4Network(self.subnet)
        except ValueError:
            raise ValueError(
                f"station.subnet must be a network like 192.168.1.0/24, not {self.subnet!r}"
            ) from None
        _check(
            network.prefixlen >= _SMALLEST_PREFIX,
            "station.subnet",
            f"must be /{_SMALLEST_PREFIX} or smaller",
            self.subnet,
        )
        return network


@dataclass(frozen=True, slots=True)
class FleetConfig:
    """The drones and the circle they start on.

    Attributes:
        drones: One to eight drones with distinct ids, serial numbers and addresses (two drones may
            share an address when each has an interface of its own).
        start_radius_m: Radius of the nominal start circle, metres.
        station: Where drones without a known address are searched.
    """

    drones: tuple[DroneConfig, ...]
    start_radius_m: float = 1.8
    station: StationConfig = field(default_factory=StationConfig)

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
        for index, drone in enumerate(self.drones):
            for other in self.drones[:index]:
                _check_apart(other, drone)
            if not drone.address and not self.station.subnet:
                raise ValueError(
                    f"address: {drone.id} is known by its serial number alone; give its address,"
                    ' or [station] subnet = "..." to search'
                )


def _check_apart(other: DroneConfig, drone: DroneConfig) -> None:
    """Raise ValueError when two drones cannot be told apart."""
    _check(other.id != drone.id, "id", "must be unique", drone.id)
    pair = f"({other.id} and {drone.id} share it)"
    if drone.serial and drone.serial == other.serial:
        raise ValueError(f"serial must be unique {pair}, not {drone.serial!r}")
    if drone.address and drone.address == other.address and drone.link != "relay":
        apart = bool(drone.interface and other.interface) and drone.interface != other.interface
        _check(apart, "address", f"must be unique per interface {pair}", drone.address)
    if drone.address and drone.address == other.address and drone.link == "relay":
        # One forwarder may serve several drones at ports of its own.
        ports = {(d.command_port, d.state_port, d.video_port) for d in (drone, other)}
        columns = zip(*ports, strict=True) if len(ports) == 2 else [(0, 0)]
        apart = all(a != b for a, b in columns)
        _check(apart, "address", f"must be unique unless all ports differ {pair}", drone.address)
    same_place = drone.local_address == other.local_address
    same_port = {drone.state_port, drone.video_port} & {other.state_port, other.video_port}
    if same_place and same_port and bool(drone.interface) != bool(other.interface):
        bare = other if drone.interface else drone
        raise ValueError(
            f"interface: {bare.id} needs one, too: a port cannot be shared with a drone that has"
            f" an interface ({other.id} and {drone.id})"
        )


# Beyond these a number is a slip of the pen or switches a protection off.
_SANE: dict[str, tuple[float, float]] = {
    "fence_radius_m": (0.5, 100.0),
    "ceiling_m": (0.5, 30.0),
    "max_speed_m_s": (0.05, 2.0),
    "max_yaw_rate_rad_s": (0.05, 3.0),
    "coast_s": (1.0, 60.0),
    "brake_s": (0.2, 10.0),
    "state_fresh_s": (0.2, 2.0),
    "state_lost_s": (0.5, 30.0),
}


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """Limits of flight and the failsafe table, see ``server.swarm.safety`` and ``failsafes``.

    Attributes:
        fence_radius_m: Drones stay within this distance of the world's z axis, metres.
        floor_m: Lowest flying height of the camera above the floor, metres.
        ceiling_m: Greatest flying height, metres.
        standoff_m: Smallest distance to the object's box and to no-go volumes, metres.
        max_speed_m_s: No setpoint is faster, metres per second.
        max_yaw_rate_rad_s: No setpoint turns faster, radians per second.
        evade_m_s: A drone that hovers for a failsafe still evades others up to this speed.
        coast_s: No velocity would carry a drone over fence or ceiling or to the object within this
            time, seconds. A Tello that hears nothing keeps its sticks and lands by itself after
            15 s.
        coast_clearance_m: That much room it leaves to the object's box, metres.
        brake_s: A drone ``d`` metres before a limit may approach it at ``d / brake_s``.
        state_fresh_s: What a state report says counts for this long, seconds.
        state_lost_s: A drone on the ground without a report for this long is offline, seconds.
        battery_take_off_pct: No take-off below, percent.
        temperature_take_off_c: No take-off at or above, degrees Celsius.
        failsafes: What makes a flying drone hover, land or cut its motors.
    """

    fence_radius_m: float = 4.5
    floor_m: float = 0.25
    ceiling_m: float = 3.0
    standoff_m: float = 0.5
    max_speed_m_s: float = 0.5
    max_yaw_rate_rad_s: float = 1.0
    evade_m_s: float = 0.25
    coast_s: float = 16.0
    coast_clearance_m: float = 0.45
    brake_s: float = 0.9
    state_fresh_s: float = 1.0
    state_lost_s: float = 3.0
    battery_take_off_pct: int = 20
    temperature_take_off_c: float = 95.0
    failsafes: FailsafeTable = field(default_factory=FailsafeTable)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not isinstance(value, FailsafeTable):
                _check(math.isfinite(value) and value > 0, item.name, "must be positive", value)
        for name, (low, high) in _SANE.items():
            value = getattr(self, name)
            _check(low <= value <= high, name, f"must be {low:g} to {high:g}", value)
        _check(
            self.evade_m_s <= self.max_speed_m_s,
            "evade_m_s",
            "must be at most max_speed_m_s",
            self.evade_m_s,
        )
        _check(self.floor_m < self.ceiling_m, "ceiling_m", "must be above floor_m", self.ceiling_m)
        _check(
            self.state_fresh_s < self.state_lost_s,
            "state_lost_s",
            "must exceed state_fresh_s",
            self.state_lost_s,
        )
        _check(
            max(self.failsafes.battery_pct.values()) < self.battery_take_off_pct <= 100,
            "battery_take_off_pct",
            "must exceed every battery failsafe and be at most 100",
            self.battery_take_off_pct,
        )
        _check(
            self.temperature_take_off_c
            <= min(self.failsafes.temperature_c.values(), default=math.inf),
            "temperature_take_off_c",
            "must be at most every temperature failsafe",
            self.temperature_take_off_c,
        )


@dataclass(frozen=True, slots=True)
class TimingConfig:
    """Times of the driver.

    Attributes:
        beat_s: Period of the rc loop, seconds.
        setpoint_life_s: A setpoint older than this counts as hover, seconds.
        keep_alive_s: On the ground something is sent at least this often, seconds.
        probe_s: In flight, where sticks are never answered, something that is answered is asked
            this often, seconds.
        deaf_s: A drone in flight that has not answered for so long may not hear, seconds.
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
    probe_s: float = 0.5
    deaf_s: float = 1.3
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
