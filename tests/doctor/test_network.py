"""Checks of ports and interfaces: real sockets where they can be had, described ones elsewhere."""

from __future__ import annotations

import os
import random
import socket
import subprocess
import sys
from dataclasses import replace
from ipaddress import IPv4Interface
from pathlib import Path

import pytest

from server.doctor.network import (
    Holder,
    Interface,
    check_buffer,
    check_port,
    check_route,
    check_shared_networks,
    read_buffer,
    read_holders,
    read_interfaces,
    read_rp_filter,
)
from server.doctor.scan import parse_subnet
from server.swarm.config import DroneConfig

DRONE = DroneConfig(id="red")


def interface(name: str, *addresses: str, up: bool = True) -> Interface:
    return Interface(name, up, tuple(IPv4Interface(text) for text in addresses))


def some_address() -> str:
    return f"127.{random.randint(16, 250)}.{random.randint(0, 255)}.{random.randint(1, 254)}"


@pytest.mark.loopback
def test_a_free_port_is_ok_and_free_again() -> None:
    address = some_address()
    assert check_port(8890, address).status == "ok"
    assert check_port(8890, address).status == "ok"


@pytest.mark.loopback
@pytest.mark.slow
def test_a_port_taken_by_another_process_names_it() -> None:
    address = some_address()
    code = (
        "import socket, sys; s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM);"
        f" s.bind(('{address}', 8890)); print('bound', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"bound\n"
        found = check_port(8890, address)
        elsewhere = check_port(8890, some_address())
        anywhere = check_port(8890)
        holders = read_holders(8890, address)
        assert other.stdin is not None
        other.stdin.close()
    assert found.status == "fail"
    assert f"process {other.pid}" in found.detail
    assert [holder.pid for holder in holders] == [other.pid]
    assert elsewhere.status == "ok"
    assert anywhere.status == "fail", "an address in use bars the port of all addresses"
    assert check_port(8890, address).status == "ok"


@pytest.mark.loopback
def test_a_running_console_is_no_failure() -> None:
    address = some_address()
    console = Holder(4711, "/x/.venv/bin/python /x/.venv/bin/dronerf serve --fleet f.toml")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
        held.bind((address, 8890))
        by_console = check_port(8890, address, holders=lambda port, where: [console])
        by_stranger = check_port(8890, address, holders=lambda port, where: [Holder(None)])
        unneeded = check_port(8890, address, needed=False, holders=lambda port, where: [])
    assert by_console.status == "warn"
    assert "process 4711" in by_console.detail
    assert by_stranger.status == "fail"
    assert "another user" in by_stranger.detail
    assert unneeded.status == "warn"


@pytest.mark.loopback
def test_a_bad_local_address_and_a_bad_interface() -> None:
    # An address of the documentation's network, which nobody has.
    found = check_port(8890, "198.51.100.77")
    assert found.status == "fail"
    assert "local_address" in found.remedy
    if not hasattr(socket, "SO_BINDTODEVICE"):
        pytest.skip("this system cannot bind to an interface")
    found = check_port(8890, "", "wlan-nowhere")
    assert found.status == "fail"
    assert "no such interface" in found.detail or "no right" in found.detail


def test_the_route_of_a_drone_with_an_interface() -> None:
    drone = replace(DRONE, interface="wlan1")
    cases = [
        ([interface("wlan0", "192.168.10.2/24")], "fail", "there is no interface wlan1"),
        ([interface("wlan1", "192.168.10.2/24", up=False)], "fail", "switched off"),
        ([interface("wlan1")], "fail", "no IPv4 address"),
        ([interface("wlan1", "192.168.1.5/24")], "fail", "not the network of 192.168.10.1"),
        ([interface("wlan1", "192.168.10.2/24")], "ok", "192.168.10.2/24"),
    ]
    for interfaces, status, words in cases:
        found = check_route(drone, interfaces)
        assert (found.status, found.drone_id) == (status, "red")
        assert words in found.detail


def test_the_route_of_a_drone_without_an_interface() -> None:
    near = interface("wlan0", "192.168.10.2/24")
    far = interface("eth0", "10.0.0.7/8")
    assert check_route(DRONE, [near, far]).status == "ok"
    assert check_route(DRONE, [far]).status == "fail"
    assert check_route(DRONE, [replace(near, up=False), far]).status == "fail"
    two = check_route(DRONE, [near, interface("wlan1", "192.168.10.3/24")])
    assert two.status == "warn"
    assert "interface" in two.remedy
    relay = replace(DRONE, link="relay", address="192.168.1.20")
    assert check_route(relay, [far]).status == "warn"


def test_adapters_that_share_a_network() -> None:
    shared = [interface("wlan1", "192.168.10.2/24"), interface("wlan2", "192.168.10.3/24")]
    apart = [interface("wlan1", "192.168.10.2/24"), interface("wlan2", "192.168.11.3/24")]
    names = ["wlan1", "wlan2"]
    assert check_shared_networks(names, apart, lambda name: 1) is None
    assert check_shared_networks(["wlan1"], shared, lambda name: 1) is None
    loose = check_shared_networks(names, shared, lambda name: 2)
    assert loose is not None
    assert loose.status == "ok"
    strict = check_shared_networks(names, shared, lambda name: 1 if name == "wlan2" else 0)
    assert strict is not None
    assert strict.status == "fail"
    assert strict.remedy == "sudo sysctl -w net.ipv4.conf.wlan2.rp_filter=2"


def test_the_stricter_filter_counts(tmp_path: Path) -> None:
    for name, value in (("all", "1"), ("wlan1", "0"), ("wlan2", "2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rp_filter").write_text(value + "\n")
    assert read_rp_filter("wlan1", tmp_path) == 1
    assert read_rp_filter("wlan2", tmp_path) == 2
    assert read_rp_filter("wlan3", tmp_path) is None


def test_the_room_for_video() -> None:
    assert check_buffer(4 << 20).status == "ok"
    found = check_buffer(212992)
    assert found.status == "warn"
    assert "0.2 MiB" in found.detail
    assert found.remedy == "sudo sysctl -w net.core.rmem_max=4194304"
    assert read_buffer() > 0


def test_this_machine_has_a_loopback() -> None:
    assert any(
        own.ip.is_loopback for item in read_interfaces() if item.up for own in item.addresses
    )


def test_own_sockets_are_nobody_elses() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind((some_address(), 0))
        address, port = own.getsockname()
        assert os.getpid() not in [holder.pid for holder in read_holders(port, address)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("192.168.0.0/21", "larger than a /22"),
        ("10.0.0.0/8", "larger than a /22"),
        ("8.8.8.0/24", "not a private network"),
        ("192.168.1.300/24", "no subnet"),
        ("everything", "no subnet"),
    ],
)
def test_subnets_that_are_not_scanned(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse_subnet(text)


def test_a_subnet_may_be_named_by_any_address_in_it() -> None:
    assert str(parse_subnet("192.168.1.17/24")) == "192.168.1.0/24"
    assert str(parse_subnet("192.168.0.0/22")) == "192.168.0.0/22"
