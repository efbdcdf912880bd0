"""Clients that others wrote, unmodified, fly the simulated drone.

Each has an environment of its own that borrows only numpy, PyAV and the like from ours, and runs in
a network namespace with the address of a real Tello on the other side.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest
from namespaces import networks, simulator
from programs import Peer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(280)]

_FLIGHT_S = 150.0


def fly(python: Path, script: str, *simulation: str) -> dict:
    """Run a client's script against one drone; return what it printed last, an object."""
    with (
        networks(1) as made,
        simulator(made, "--scene", "recycle_bin", *simulation),
    ):
        done = subprocess.run(
            made.command(str(python), "-c", script),
            capture_output=True,
            text=True,
            timeout=_FLIGHT_S,
            check=False,
        )
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    return json.loads(done.stdout.strip().splitlines()[-1])


DJITELLOPY = """
import json, math, time
from djitellopy import Tello
drone = Tello(retry_count=1)
drone.connect()
told = {"reads": {}}
for name in READS:
    told["reads"][name] = getattr(drone, "query_" + name)()
told["state"] = drone.get_current_state()
drone.set_video_fps(Tello.FPS_15)
drone.set_video_bitrate(Tello.BITRATE_3MBPS)
drone.streamon()
reader = drone.get_frame_read()
told["heights"] = []
drone.takeoff()
time.sleep(0.3)
told["heights"].append(drone.get_height())
drone.move_up(40)
time.sleep(0.3)
told["heights"].append(drone.get_height())
before = drone.get_yaw()
drone.rotate_clockwise(90)
time.sleep(0.3)
told["turned"] = (drone.get_yaw() - before) % 360
drone.move_forward(50)
drone.go_xyz_speed(-30, 30, 0, 40)
drone.curve_xyz_speed(50, 50, 0, 100, 0, 0, 40)
drone.flip_left()
speeds = []
for _ in range(20):
    drone.send_rc_control(0, 60, 0, 0)
    time.sleep(0.1)
    speeds.append(drone.get_speed_x())
told["fastest"] = max(speeds)
drone.send_rc_control(0, 0, 0, 0)
pictures = set()
until = time.monotonic() + 15.0
while len(pictures) < 10 and time.monotonic() < until:
    picture = reader.frame
    pictures.add(hash(picture.tobytes()))
    time.sleep(0.05)
told["pictures"] = len(pictures)
told["shape"] = list(picture.shape)
told["contrast"] = float(picture.std())
drone.land()
time.sleep(0.3)
told["heights"].append(drone.get_height())
drone.end()
print(json.dumps(told), flush=True)
import os; os._exit(0)
"""

_PLAIN_READS = ["battery", "attitude", "distance_tof", "wifi_signal_noise_ratio", "sdk_version"]
_PLAIN_READS += ["serial_number", "active"]
_ALL_READS = [*_PLAIN_READS, "speed", "flight_time", "height", "temperature", "barometer"]


@pytest.mark.parametrize(
    ("reads", "options"),
    [(_PLAIN_READS, ()), (_ALL_READS, ("--friendly-reads",))],
    ids=["as a real drone answers", "plain numbers"],
)
def test_djitellopy_flies_and_sees(peer: Peer, reads: list[str], options: tuple[str, ...]) -> None:
    script = DJITELLOPY.replace("READS", repr(reads))
    told = fly(peer("djitellopy==2.5.0"), script, *options)
    assert told["reads"]["battery"] > 90
    assert told["reads"]["sdk_version"] == "30"
    assert len(told["reads"]["serial_number"]) == 14
    assert set(told["reads"]["attitude"]) == {"pitch", "roll", "yaw"}
    if options:
        assert told["reads"]["speed"] == 100
        assert told["reads"]["height"] == 0
        assert told["reads"]["temperature"] > 20
    numbers = {key: value for key, value in told["state"].items() if key != "mpry"}
    assert len(numbers) == 20
    assert all(isinstance(value, int | float) for value in numbers.values())
    hovering, higher, down = told["heights"]
    assert 60 <= hovering <= 100
    assert 20 <= higher - hovering <= 60
    assert down == 0
    assert told["turned"] == pytest.approx(90, abs=10)
    assert told["fastest"] >= 2, "decimetres per second"
    assert told["pictures"] >= 10
    assert told["shape"] == [720, 960, 3]
    assert told["contrast"] > 5.0, "a picture of something"


TELLO_ASYNCIO = """
import asyncio, json
import av
from tello_asyncio import Tello, Vector
async def main():
    told = {}
    pictures = []
    drone = Tello()
    await drone.connect()
    told["serial"] = (await drone.serial_number).strip()
    told["sdk"] = (await drone.sdk_version).strip()
    told["speed"] = await drone.speed
    await drone.start_video(on_frame=lambda drone, frame: pictures.append(bytes(frame)))
    await drone.takeoff()
    await asyncio.sleep(0.3)
    told["hovering"] = drone.height
    await drone.move_up(30)
    await drone.turn_counterclockwise(60)
    await drone.move_forward(60)
    await drone.go_to(Vector(-50, 30, 0), 40)
    await drone.remote_control(0, 40, 0, 0)
    await asyncio.sleep(1.0)
    await drone.remote_control(0, 0, 0, 0)
    moving = asyncio.ensure_future(drone.move_forward(200))
    await asyncio.sleep(0.7)
    told["higher"] = drone.height
    await asyncio.sleep(6.0)
    await moving
    await drone.land()
    await asyncio.sleep(0.3)
    told["down"] = drone.height
    await drone.stop_video()
    decoder = av.CodecContext.create("h264", "r")
    decoded = []
    for picture in pictures:
        for packet in decoder.parse(picture):
            decoded += decoder.decode(packet)
    told["pictures"] = len(pictures)
    told["decoded"] = len(decoded)
    told["size"] = [decoded[-1].width, decoded[-1].height]
    await drone.disconnect()
    print(json.dumps(told), flush=True)
asyncio.get_event_loop_policy().get_event_loop().run_until_complete(main())
"""


def test_tello_asyncio_flies_and_receives_video(peer: Peer) -> None:
    told = fly(peer("tello-asyncio==2.1.3"), TELLO_ASYNCIO)
    assert len(told["serial"]) == 14
    assert told["sdk"] == "30"
    assert told["speed"] == 100.0
    assert 60 <= told["hovering"] <= 100
    assert told["higher"] > told["hovering"]
    assert told["down"] == 0
    assert told["decoded"] > 30
    assert told["size"] == [960, 720]


DRONEMASTER = """
import asyncio, json
from dronemaster import Drone
async def main():
    told = {}
    drone = Drone("192.168.10.1")
    await drone.initialize()
    told["serial"] = await drone.serial_number()
    told["sdk"] = await drone.sdk_version()
    told["battery"] = await drone.battery()
    told["time"] = await drone.flight_time()
    told["hardware"] = await drone.get_hardware()
    told["tof"] = await drone.tof()
    flight = drone.flight
    await flight.motoron()
    await flight.motoroff()
    await flight.takeoff()
    await flight.speed(60)
    await flight.up(30, timeout=15)
    await flight.forward(50, timeout=15)
    await flight.clockwise(90, timeout=15)
    await flight.flip("f", timeout=15)
    flight.rc(0, 40, 0, 0)
    await asyncio.sleep(1.0)
    flight.rc(0, 0, 0, 0)
    await flight.stop()
    await asyncio.sleep(0.3)
    told["height"] = drone.last_state["h"]
    await flight.land()
    await asyncio.sleep(0.3)
    told["down"] = drone.last_state["h"]
    told["yaw"] = drone.last_state["yaw"]
    print(json.dumps(told), flush=True)
asyncio.run(main())
"""


def test_dronemaster_flies(peer: Peer) -> None:
    told = fly(peer("dronemaster==1.2.1"), DRONEMASTER)
    assert len(told["serial"]) == 14
    assert told["sdk"] == 30
    assert told["battery"] > 90
    assert told["hardware"] == "TELLO"
    assert told["height"] > 80
    assert told["down"] == 0
    assert told["yaw"] == pytest.approx(90, abs=15)


def test_no_namespace_is_left_behind() -> None:
    with networks(1) as made:
        names = [made.client, *made.drones]
    listed = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True)
    assert not [name for name in names if name in listed.stdout]
