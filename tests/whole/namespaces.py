"""Drones and clients in network namespaces of the test's own, joined by virtual cables.

Each drone has a namespace and the address every Tello has in its own Wi-Fi; the client has one more
namespace with one interface per drone, all of the same address, as with one adapter per drone.
Nothing leaves these namespaces.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import pytest

DRONE_ADDRESS = "192.168.10.1"
CLIENT_ADDRESS = "192.168.10.2"


@dataclass(frozen=True)
class Networks:
    """What was made.

    Attributes:
        client: Namespace of the client.
        drones: Namespaces of the drones.
        interfaces: The client's interfaces, in the order of the drones.
    """

    client: str
    drones: tuple[str, ...]
    interfaces: tuple[str, ...]

    def command(self, *words: str) -> list[str]:
        """Return the command line that runs a program in the client's namespace."""
        return ["ip", "netns", "exec", self.client, *words]


@cache
def why_not() -> str:
    """Return why namespaces cannot be had here; empty when they can."""
    name = f"dronerf-try-{os.getpid()}"
    try:
        _run("ip", "netns", "add", name)
        try:
            _run("ip", "-n", name, "link", "add", "wlan0", "type", "veth", "peer", "name", "wlan1")
        finally:
            _run("ip", "netns", "delete", name)
    except FileNotFoundError:
        return "no `ip` command on this machine"
    except subprocess.CalledProcessError as error:
        return f"no network namespaces on this machine: {error.stderr.strip()}"
    return ""


@contextmanager
def networks(drones: int) -> Iterator[Networks]:
    """Make the namespaces of a client and its drones, and remove them afterwards.

    The one place where a test that needs them is skipped, by name, on machines that have none.
    """
    if why_not():
        pytest.skip(why_not())
    tag = f"dronerf-{os.getpid()}"
    made = Networks(
        f"{tag}-client",
        tuple(f"{tag}-drone{n + 1}" for n in range(drones)),
        tuple(f"wlan{n + 1}" for n in range(drones)),
    )
    try:
        _make(made.client)
        # Answers come from a drone that other interfaces could reach as well.
        for scope in ("all", "default"):
            _inside(made.client, "sysctl", "-qw", f"net.ipv4.conf.{scope}.rp_filter=0")
        for interface, drone in zip(made.interfaces, made.drones, strict=True):
            _make(drone)
            put_in(made.client, interface, drone)
        yield made
    finally:
        for name in (made.client, *made.drones):
            subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


def put_in(client: str, interface: str, drone: str) -> None:
    """Give a client an adapter, in the Wi-Fi of a drone."""
    link = ["ip", "-n", client, "link", "add", interface, "type", "veth"]
    _run(*link, "peer", "name", "wlan0", "netns", drone)
    _give(client, interface, CLIENT_ADDRESS)
    _give(drone, "wlan0", DRONE_ADDRESS)


def pull_out(client: str, interface: str) -> None:
    """Take an adapter away from a client."""
    _run("ip", "-n", client, "link", "delete", interface)


@contextmanager
def simulator(made: Networks, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run the simulator program with one drone in each namespace, until it is ready and on."""
    command = [sys.executable, "-P", "-m", "server.sim.simulator", "--quiet", "--attached"]
    command += ["--drones", str(len(made.drones)), *arguments]
    for name in made.drones:
        command += ["--namespace", name]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    try:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["ready"]
        yield process
    finally:
        process.terminate()
        try:
            process.communicate(timeout=15.0)
        finally:
            process.kill()


def _make(name: str) -> None:
    _run("ip", "netns", "add", name)
    _run("ip", "-n", name, "link", "set", "lo", "up")


def _give(name: str, interface: str, address: str) -> None:
    _run("ip", "-n", name, "address", "add", f"{address}/24", "dev", interface)
    _run("ip", "-n", name, "link", "set", interface, "up")


def _inside(name: str, *words: str) -> None:
    _run("ip", "netns", "exec", name, *words)


def _run(*words: str) -> None:
    subprocess.run(words, check=True, capture_output=True, text=True)
