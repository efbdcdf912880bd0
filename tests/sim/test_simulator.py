"""The simulator on sockets and as a program: where datagrams come from, and faults at run time."""

from __future__ import annotations

import asyncio
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import av
import numpy as np
import pytest

from server.sim.config import SimConfig
from server.sim.drone import SimError, SimulatedDrone
from server.sim.faults import parse_fault
from server.sim.simulator import main
from server.sim.studio import Studio

pytestmark = [pytest.mark.loopback]

_PATIENCE_S = 30.0


def some_address() -> str:
    return f"127.{random.randint(16, 250)}.{random.randint(0, 255)}.1"


@contextmanager
def ears(port: int) -> Iterator[socket.socket]:
    """A client's socket for what drones send to a fixed port; waits for its datagrams."""
    heard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with heard:
        heard.settimeout(_PATIENCE_S)
        heard.bind((_CLIENT, port))
        yield heard


_CLIENT = f"127.{random.randint(16, 250)}.{random.randint(0, 255)}.200"


async def test_everything_comes_from_the_drones_own_address() -> None:
    """Replies from its command port to whatever port asked; state and video from its address."""
    config = SimConfig(drones=1, base_address=some_address())
    async with SimulatedDrone(config, 0) as drone:
        with ears(0) as asking, ears(8890) as states, ears(11111) as videos:
            asking.sendto(b"command", (drone.address, 8889))
            reply, sender = await asyncio.to_thread(asking.recvfrom, 100)
            assert (reply, sender) == (b"ok", (drone.address, 8889))
            state, sender = await asyncio.to_thread(states.recvfrom, 1000)
            assert state.startswith(b"mid:")
            assert sender[0] == drone.address
            asking.sendto(b"streamon", (drone.address, 8889))
            await asyncio.to_thread(asking.recvfrom, 100)
            drone.send_video([b"one", b"two"])
            received = [await asyncio.to_thread(videos.recvfrom, 2000) for _ in range(2)]
            assert [data for data, _ in received] == [b"one", b"two"]
            assert {sender[0] for _, sender in received} == {drone.address}
            # From another port of the same host: the reply goes there.
            with ears(0) as other:
                other.sendto(b"sdk?", (drone.address, 8889))
                assert await asyncio.to_thread(other.recvfrom, 100) == (
                    b"30\r\n",
                    (drone.address, 8889),
                )


async def test_faults_reach_the_sockets() -> None:
    config = SimConfig(drones=1, base_address=some_address())
    async with SimulatedDrone(config, 0) as drone:
        with ears(0) as asking:
            drone.inject(parse_fault("duplicate=1"))
            await asyncio.sleep(0.1)
            asking.sendto(b"command", (drone.address, 8889))
            # Two copies arrive, each is answered, and each answer comes twice.
            replies = [await asyncio.to_thread(asking.recv, 100) for _ in range(4)]
            assert replies == [b"ok"] * 4
            drone.inject(parse_fault("loss=1"))
            await asyncio.sleep(0.1)
            asking.settimeout(0.5)
            asking.sendto(b"command", (drone.address, 8889))
            with pytest.raises(TimeoutError):
                await asyncio.to_thread(asking.recv, 100)


async def test_a_namespace_that_is_not_there_is_told_in_one_line() -> None:
    config = SimConfig(drones=1, base_address="192.168.10.1", namespaces=("dronerf-nowhere",))
    with pytest.raises(SimError, match="drone-1: there is no network namespace") as caught:
        async with SimulatedDrone(config, 0):
            pass
    assert "\n" not in str(caught.value)


class Stripes:
    """Pictures that are not the same everywhere."""

    def render(self, T_world_cam: np.ndarray, other_drones: object = ()) -> np.ndarray:
        image = np.full((720, 960, 3), 60, np.uint8)
        image[:, 480:] = (200, 120, 40)
        return image

    def close(self) -> None:
        """Hold nothing."""


def decoded(datagrams: list[bytes]) -> list[np.ndarray]:
    decoder = av.CodecContext.create("h264", "r")
    assert isinstance(decoder, av.VideoCodecContext)
    frames = [f for packet in decoder.parse(b"".join(datagrams)) for f in decoder.decode(packet)]
    return [frame.to_ndarray(format="bgr24") for frame in frames]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("orders", "shape"),
    [
        ([], (720, 960, 3)),
        (["setresolution low", "setbitrate 1"], (480, 640, 3)),
        (["downvision 1"], (240, 320, 3)),
    ],
)
async def test_what_is_set_changes_the_stream(orders: list[str], shape: tuple[int, ...]) -> None:
    config = SimConfig(drones=1, base_address=some_address(), fps_cap=30.0)
    async with SimulatedDrone(config, 0) as drone:
        studio = Studio(config, [drone], lambda _: Stripes())
        await studio.start()
        try:
            with ears(0) as asking, ears(11111) as videos:
                for order in ("command", *orders, "streamon"):
                    asking.sendto(order.encode(), (drone.address, 8889))
                    assert await asyncio.to_thread(asking.recv, 100) == b"ok"
                datagrams = [await asyncio.to_thread(videos.recv, 2000) for _ in range(30)]
        finally:
            await studio.stop()
    assert datagrams[0][4] & 0x1F == 7, "parameter sets first, each in a datagram of its own"
    assert datagrams[1][4] & 0x1F == 8
    assert max(map(len, datagrams)) <= 1460
    (image, *_) = decoded(datagrams)
    assert image.shape == shape
    left, right = image[10, 10].astype(int), image[10, -10].astype(int)
    assert np.abs(left - right).max() > 20
    if shape[0] == 240:
        assert np.ptp(right) < 12, "the downward camera sees no colours"


@pytest.mark.slow
async def test_setfps_sets_the_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    config = SimConfig(drones=1, base_address=some_address(), fps_cap=30.0)
    async with SimulatedDrone(config, 0) as drone:
        studio = Studio(config, [drone], lambda _: Stripes())
        await studio.start()
        try:
            with ears(0) as asking:
                for order in (b"command", b"setfps low", b"streamon"):
                    asking.sendto(order, (drone.address, 8889))
                    await asyncio.to_thread(asking.recv, 100)
                sent: list[float] = []
                monkeypatch.setattr(drone, "send_video", lambda _: sent.append(time.monotonic()))
                await asyncio.sleep(2.0)
        finally:
            await studio.stop()
    assert 1 <= len(sent) <= 12, "five a second and never more, however idle the machine"


# The program -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--fault", "lose=1"], "no_valid_imu"),
        (["--fault", "reboot:drone-7"], "drone-7"),
        (["--address", "8.8.8.8"], "loopback"),
        (["--drones", "2", "--namespace", "one"], "namespaces"),
    ],
)
def test_bad_arguments_are_told_in_one_line(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    told = capsys.readouterr().err
    assert says in told
    assert told.count("\n") == 1


@pytest.mark.slow
def test_lines_on_stdin_are_faults_that_happen_now() -> None:
    address = some_address()
    command = [sys.executable, "-P", "-m", "server.sim.simulator", "--quiet", "--drones", "1"]
    process = subprocess.Popen(
        [*command, "--scene", "recycle_bin", "--address", address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        assert '"ready": true' in process.stdout.readline()
        with ears(0) as asking:
            asking.sendto(b"command", (address, 8889))
            assert asking.recv(100) == b"ok"
            process.stdin.write("nonsense\n")
            assert "'nonsense' is no fault" in process.stderr.readline()
            process.stdin.write("reboot:drone-5\n")
            assert "there is no drone-5, only drone-1" in process.stderr.readline()
            process.stdin.write("help\n")
            assert "loss" in process.stderr.readline()
            process.stdin.write("low_battery=42:drone-1\n")
            charge = b""
            deadline = time.monotonic() + _PATIENCE_S
            while charge not in (b"42\r\n", b"41\r\n") and time.monotonic() < deadline:
                asking.sendto(b"battery?", (address, 8889))
                charge = asking.recv(100)
            assert charge in (b"42\r\n", b"41\r\n")
            process.stdin.close()
            time.sleep(0.3)
            assert process.poll() is None, "the end of its input is not its end"
    finally:
        process.terminate()
        try:
            assert process.wait(_PATIENCE_S) == 0
        finally:
            process.kill()
            for stream in (process.stdin, process.stdout, process.stderr):
                if stream is not None:
                    stream.close()
