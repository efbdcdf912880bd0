"""The fleet file: what it may say, and one clear line for everything else."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from server.geometry.cameras import TELLO_INTRINSICS
from server.swarm.config import DRONE_COLOURS, DroneConfig, FleetConfig
from server.swarm.fleet_file import FleetFileError, load_fleet

GOOD = """
start_radius_m = 2
[[drones]]
id = "north"
name = "North"
colour = "#00ff00"
azimuth_deg = 90
address = "192.168.1.21"
local_address = "192.168.1.2"
interface = "wlan1"
command_port = 8889
state_port = 8892
video_port = 11113
edu = false
tilt_deg = 10.5
[drones.intrinsics]
fx = 925
distortion = [0.01, 0, 0.0, 0, -1]
[[drones]]
address = "192.168.1.22"
[[drones]]
address = "192.168.1.23"
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "fleet.toml"


def test_a_good_file(path: Path) -> None:
    path.write_text(GOOD)
    fleet = load_fleet(path)
    assert fleet.start_radius_m == 2.0
    north, second, third = fleet.drones
    assert north.id == "north"
    assert north.label == "North"
    assert north.colour == "#00ff00"
    assert north.azimuth_deg == 90.0
    assert north.address == "192.168.1.21"
    assert north.local_address == "192.168.1.2"
    assert north.interface == "wlan1"
    assert (north.command_port, north.state_port, north.video_port) == (8889, 8892, 11113)
    assert not north.edu
    assert north.tilt_deg == 10.5
    assert north.intrinsics.fx == 925.0
    assert north.intrinsics.fy == TELLO_INTRINSICS.fy
    assert north.intrinsics.distortion == (0.01, 0.0, 0.0, 0.0, -1.0)
    # What is left out: ids count, azimuths are spread, colours differ.
    assert (second.id, third.id) == ("drone-2", "drone-3")
    assert (second.azimuth_deg, third.azimuth_deg) == (120.0, 240.0)
    assert second.colour == DRONE_COLOURS[1]
    assert second.label == "drone-2"
    assert second.edu
    assert second.intrinsics == TELLO_INTRINSICS


DRONE = '[[drones]]\naddress = "192.168.1.21"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["at least one"]),
        ("drones = []", ["at least one"]),
        ("drones = 3", ["at least one"]),
        ("drones = [1]", ["drones[1]", "table"]),
        (DRONE * 9, ["at most 8", "9"]),
        ("radius = 2\n" + DRONE, ["unknown key 'radius'", "start_radius_m"]),
        (DRONE + "adress = 'x'", ["drones[1]", "unknown key 'adress'", "address"]),
        (DRONE + "edu = 1", ["drones[1].edu", "bool", "1"]),
        (DRONE + "command_port = true", ["drones[1].command_port", "int", "True"]),
        (DRONE + "state_port = 8890.5", ["drones[1].state_port", "int"]),
        (DRONE + "video_port = 70000", ["drones[1].video_port", "1-65535"]),
        (DRONE + "video_port = 8890", ["drones[1].video_port", "differ"]),
        (DRONE + "tilt_deg = 'low'", ["drones[1].tilt_deg", "number", "low"]),
        (DRONE + "tilt_deg = 85", ["drones[1].tilt_deg", "85"]),
        (DRONE + "azimuth_deg = nan", ["drones[1].azimuth_deg", "finite"]),
        (DRONE + "azimuth_deg = true", ["drones[1].azimuth_deg", "number"]),
        (DRONE + "id = 'a b'", ["drones[1].id", "a b"]),
        (DRONE + "id = 7", ["drones[1].id", "str"]),
        (DRONE + "colour = 'red'", ["drones[1].colour", "#rrggbb"]),
        (DRONE + "interface = 'a/b'", ["drones[1].interface"]),
        ("[[drones]]\naddress = 'tello.local'", ["drones[1].address", "tello.local"]),
        (DRONE + "local_address = '::1'", ["drones[1].local_address", "::1"]),
        (DRONE + "intrinsics = 3", ["drones[1].intrinsics", "table"]),
        (DRONE + "[drones.intrinsics]\nfocal = 3", ["drones[1].intrinsics", "'focal'"]),
        (DRONE + "[drones.intrinsics]\nfx = 0", ["drones[1].intrinsics.fx", "positive"]),
        (DRONE + "[drones.intrinsics]\nfx = inf", ["drones[1].intrinsics.fx", "inf"]),
        (DRONE + "[drones.intrinsics]\ncx = nan", ["drones[1].intrinsics.cx", "nan"]),
        (DRONE + "[drones.intrinsics]\ndistortion = [1]", ["distortion", "five"]),
        (DRONE + "[drones.intrinsics]\nwidth = 960.0", ["width", "int"]),
        ("start_radius_m = 0.1\n" + DRONE, ["start_radius_m", "0.1"]),
        ("start_radius_m = nan\n" + DRONE, ["start_radius_m", "nan"]),
        ("start_radius_m = '2'\n" + DRONE, ["start_radius_m", "number"]),
        (DRONE + "id = 'x'\n[[drones]]\nid = 'x'\naddress = '192.168.1.9'", ["unique", "'x'"]),
        (DRONE + DRONE, ["address", "unique", "192.168.1.21"]),
        ("[[drones]]\n[[drones]]\ninterface = 'wlan1'", ["address", "unique", "192.168.10.1"]),
        ("[[drones]]\ninterface = 'wlan1'\n" * 2, ["unique per interface", "drone-1 and drone-2"]),
        (DRONE + "[[drones]]\ninterface = 'wlan1'", ["interface", "drone-1 needs one"]),
        (
            DRONE + "azimuth_deg = 90\n[[drones]]\naddress = '192.168.1.9'\nazimuth_deg = 100",
            ["azimuth_deg", "drone-1 and drone-2", "0.31 m apart", "0.6 m"],
        ),
        (DRONE + "link = 'lan'", ["drones[1].link", "ap, relay, station", "lan"]),
        (DRONE + "serial = 'x'", ["drones[1].serial", "'x'"]),
        ("[[drones]]\nserial = '0TQDG3UEDBSP12'", ["serial number alone", "[station] subnet"]),
        ("[[drones]]\nlink = 'relay'\naddress = ''", ["drones[1].address", "IPv4"]),
        (DRONE + "serial='0TQDG3UEDBSP12'\n[[drones]]\nserial='0TQDG3UEDBSP12'", ["unique"]),
        (DRONE + "[station]\nsubnet = '192.168.1.0/8'", ["station.subnet", "192.168.1.0/8"]),
        (DRONE + "[station]\nsubnet = '10.0.0.0/8'", ["station.subnet", "/22"]),
        (DRONE + "[station]\nsubnet = 'home'", ["station.subnet", "192.168.1.0/24", "home"]),
        (DRONE + "[station]\nnet = ''", ["station", "unknown key 'net'", "subnet"]),
        (DRONE + "[station]\nhosts_per_s = 1e6", ["station.hosts_per_s", "1000"]),
        ("drones = [", ["not valid TOML"]),
        ("a = 1\na = 2", ["not valid TOML"]),
    ],
)
def test_a_bad_file_is_told_in_one_line(path: Path, text: str, words: list[str]) -> None:
    path.write_text(text)
    with pytest.raises(FleetFileError) as caught:
        load_fleet(path)
    line = str(caught.value)
    assert line.startswith(str(path))
    assert "\n" not in line
    for word in words:
        assert word in line


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FleetFileError, match="cannot be read"):
        load_fleet(tmp_path / "nowhere.toml")
    with pytest.raises(FleetFileError, match="cannot be read"):
        load_fleet(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b"name = '\xe9'")
    with pytest.raises(FleetFileError, match="UTF-8"):
        load_fleet(tmp_path / "latin.toml")


def test_one_address_on_two_interfaces_is_allowed() -> None:
    twins = tuple(DroneConfig(id=f"d{k}", interface=f"wlan{k}") for k in range(4))
    assert len(FleetConfig(twins).drones) == 4


def test_links_are_derived(path: Path) -> None:
    path.write_text(
        '[station]\nsubnet = "192.168.1.0/24"\n'
        '[[drones]]\ninterface = "wlan1"\nlocal_address = "192.168.10.2"\n'
        '[[drones]]\naddress = "192.168.7.9"\n'
        '[[drones]]\nserial = "0TQDG3UEDBSP12"\n'
        '[[drones]]\nserial = "0TQDG3UEDBSP13"\naddress = "192.168.1.31"\n'
        "state_port = 8892\nvideo_port = 11113\n"
    )
    fleet = load_fleet(path)
    assert [drone.link for drone in fleet.drones] == ["ap", "relay", "station", "station"]
    assert [drone.address for drone in fleet.drones] == [
        "192.168.10.1",
        "192.168.7.9",
        "",
        "192.168.1.31",
    ]
    assert [drone.moves_ports for drone in fleet.drones] == [False, False, False, True]
    assert fleet.station.network().num_addresses == 256


def test_one_relay_may_serve_several_drones_at_ports_of_their_own() -> None:
    first = DroneConfig(id="a", address="10.0.0.9")

    def second(video_port: int) -> DroneConfig:
        return DroneConfig(
            id="b",
            address="10.0.0.9",
            command_port=9001,
            state_port=9002,
            video_port=video_port,
        )

    assert FleetConfig((first, second(9003)))
    with pytest.raises(ValueError, match="unique unless all ports differ"):
        FleetConfig((first, second(first.video_port)))


values = st.one_of(
    st.integers(-(10**6), 10**6),
    st.booleans(),
    st.floats(allow_nan=False, allow_infinity=False).map(repr),
    st.sampled_from(
        ["[]", "{}", "''", "'127.0.0.1'", "inf", "-inf", "nan", "1979-05-27", "[1, 'a']"]
    ),
)
keys = st.sampled_from([*DroneConfig.__dataclass_fields__, "unknown", "start_radius_m", "drones"])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(keys, values, max_size=4), st.booleans())
def test_any_document_gives_a_fleet_or_a_fleet_file_error(
    tmp_path: Path, entries: dict[str, object], in_drone: bool
) -> None:
    lines = "\n".join(
        f"{key} = {str(v).lower() if v in (True, False) else v}" for key, v in entries.items()
    )
    file = tmp_path / "any.toml"
    file.write_text(f"[[drones]]\n{lines}\n" if in_drone else f"{lines}\n")
    told = ""
    try:
        assert load_fleet(file).drones
    except FleetFileError as error:
        told = str(error)
    assert "\n" not in told
