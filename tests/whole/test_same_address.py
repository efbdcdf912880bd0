"""Four drones at one address, each behind an interface of its own: the driver keeps them apart."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path

import numpy as np
import pytest
from ideal_camera import IDEAL_CAMERA
from namespaces import DRONE_ADDRESS, Networks, networks, pull_out, put_in, simulator
from programs import COMMAND, TOKEN

from server.sim.config import SimConfig
from server.sim.drone import SimulatedDrone
from server.sim.namespaces import NamespaceError, in_namespace
from server.sim.studio import Studio
from server.stages import Setpoint
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.fleet_file import load_fleet

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

_DRONES = 4
_PATIENCE_S = 60.0
_PORT = 8321

# What each drone is told to do: forward, left, up in m/s, and its place in the checks.
_WISHES = ((0.4, 0.0, 0.0), (-0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, -0.4, 0.0))


def fleet_file(folder: Path, made: Networks) -> Path:
    """Write a fleet file of drones that differ by their interface alone."""
    tables = [
        f'[[drones]]\nid = "drone-{n + 1}"\nname = "Drone {n + 1}"\n'
        f'address = "{DRONE_ADDRESS}"\ninterface = "{interface}"\n'
        for n, interface in enumerate(made.interfaces)
    ]
    path = folder / "fleet.toml"
    path.write_text("start_radius_m = 1.8\n\n" + "\n".join(tables))
    return path


class FourShades:
    """Pictures as bright as the camera's place on the circle tells: one shade for each drone."""

    def render(self, T_world_cam: np.ndarray, other_drones: object = ()) -> np.ndarray:
        azimuth = np.degrees(np.arctan2(T_world_cam[1, 3], T_world_cam[0, 3])) % 360
        return np.full((720, 960, 3), shade(round(azimuth / 90) % 4), np.uint8)

    def close(self) -> None:
        """Hold nothing."""


def shade(index: int) -> int:
    return 40 + 50 * index


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while not holds():  # noqa: ASYNC110 - The truth raises no events.
            await asyncio.sleep(0.05)


async def steer(drone: Drone, wish: tuple[float, float, float], seconds: float) -> None:
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        drone.set_setpoint(Setpoint(np.array(wish), 0.0), time.monotonic())
        await asyncio.sleep(0.1)


async def fly_four(made: Networks, path: Path) -> None:
    config = SimConfig(
        drones=_DRONES,
        base_address=DRONE_ADDRESS,
        namespaces=made.drones,
        start_sigma_deg=0.0,
        fps_cap=10.0,
        # Pictures are told apart by their brightness, which no exposure may change.
        camera=IDEAL_CAMERA,
    )
    bodies = [SimulatedDrone(config, index) for index in range(_DRONES)]
    async with AsyncExitStack() as stack:
        for body in bodies:
            await stack.enter_async_context(body)
        studio = Studio(config, bodies, lambda _: FourShades())
        await studio.start()
        try:
            async with Fleet(load_fleet(path)) as fleet:
                assert await fleet.connect(_PATIENCE_S) == {}
                await fly_apart(fleet, bodies)
        finally:
            await studio.stop()


async def fly_apart(fleet: Fleet, bodies: list[SimulatedDrone]) -> None:
    drones = list(fleet.drones.values())
    for index, drone in enumerate(drones):
        async with asyncio.timeout(_PATIENCE_S):
            frame = await drone.next_frame(after=2)
        assert frame.image_bgr.mean() == pytest.approx(shade(index), abs=8)
        assert not frame.damaged
    # Each state is its own drone's: the charge tells them apart.
    for index, body in enumerate(bodies):
        body.airframe.battery_pct = 95.0 - 10 * index
    charges = [95, 85, 75, 65]
    await until(
        lambda: [round(d.telemetry.battery_pct) if d.telemetry else 0 for d in drones] == charges
    )
    await asyncio.gather(*(drone.take_off() for drone in drones))
    assert [body.airframe.phase for body in bodies] == ["flying"] * _DRONES
    before = [body.airframe.position for body in bodies]
    yaws = [body.airframe.yaw_rad for body in bodies]
    await asyncio.gather(
        *(steer(drone, wish, 3.0) for drone, wish in zip(drones, _WISHES, strict=True))
    )
    for body, start, yaw, wish in zip(bodies, before, yaws, _WISHES, strict=True):
        moved = body.airframe.position - start
        c, s = np.cos(yaw), np.sin(yaw)
        went = np.array([c * moved[0] + s * moved[1], c * moved[1] - s * moved[0]])
        assert went @ np.array(wish[:2]) / 0.4 > 0.4, "its own way, not another's"
    fleet.land(drones[0].config.id)
    await until(lambda: bodies[0].airframe.phase == "standing")
    assert [body.airframe.phase for body in bodies[1:]] == ["flying"] * 3
    fleet.land()
    await until(lambda: all(body.airframe.phase == "standing" for body in bodies))
    await until(lambda: all(drone.activity == "ground" for drone in drones))


async def lose_an_adapter(made: Networks, path: Path) -> None:
    config = SimConfig(drones=1, base_address=DRONE_ADDRESS, namespaces=made.drones)
    async with SimulatedDrone(config, 0) as body, Fleet(load_fleet(path)) as fleet:
        assert await fleet.connect(_PATIENCE_S) == {}
        drone = fleet.drones["drone-1"]
        pull_out(made.client, made.interfaces[0])
        await until(lambda: drone.activity == "offline")
        await asyncio.sleep(2.0)
        fleet.hold()
        put_in(made.client, made.interfaces[0], made.drones[0])
        await until(lambda: drone.activity == "ground" and not drone.stranger)
        drone.rearm()
        await drone.take_off()
        assert body.airframe.phase == "flying"
        pull_out(made.client, made.interfaces[0])
        await until(lambda: drone.activity == "landing")
        put_in(made.client, made.interfaces[0], made.drones[0])
        await until(lambda: body.airframe.phase == "standing" and drone.activity == "ground")


def test_an_adapter_that_is_put_in_again_is_used_again(tmp_path: Path) -> None:
    with networks(1) as made:
        path = fleet_file(tmp_path, made)
        in_namespace(made.client, lambda: asyncio.run(lose_an_adapter(made, path)))


def test_the_driver_flies_four_drones_at_one_address(tmp_path: Path) -> None:
    with networks(_DRONES) as made:
        path = fleet_file(tmp_path, made)
        in_namespace(made.client, lambda: asyncio.run(fly_four(made, path)))


def test_a_namespace_that_is_not_there_is_told_in_one_line() -> None:
    with pytest.raises(NamespaceError, match="dronerf-nowhere") as caught:
        in_namespace("dronerf-nowhere", lambda: None)
    assert "\n" not in str(caught.value)


@contextmanager
def console(made: Networks, path: Path, runs: Path) -> Iterator[None]:
    """Run the console inside the client's namespace."""
    arguments = ["serve", "--fleet", str(path), "--port", str(_PORT), "--runs", str(runs)]
    environment = os.environ | {"DRONERF_TOKEN": TOKEN}
    process = subprocess.Popen(made.command(*COMMAND, *arguments), env=environment)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(40.0)
        finally:
            process.kill()


def test_a_whole_mission_of_four_drones_at_one_address(tmp_path: Path) -> None:
    with networks(_DRONES) as made, simulator(made, "--scene", "recycle_bin", "--seed", "1"):
        path = fleet_file(tmp_path, made)
        with console(made, path, tmp_path / "runs"):
            capture = ["capture", "--url", f"http://127.0.0.1:{_PORT}", "--json"]
            capture += ["--pictures", "8", "--train-seconds", "5"]
            deadline = time.monotonic() + 500.0
            while True:
                done = subprocess.run(
                    made.command(*COMMAND, *capture),
                    env=os.environ | {"DRONERF_TOKEN": TOKEN},
                    capture_output=True,
                    text=True,
                    timeout=540.0,
                    check=False,
                )
                # The console needs some seconds until it answers.
                if "no console answers" not in done.stderr or time.monotonic() > deadline:
                    break
                time.sleep(1.0)
    assert done.returncode == 0, done.stderr[-3000:]
    result = json.loads(done.stdout)
    assert result["images"] == 8
    assert (Path(result["run"]) / "transforms.json").exists()
