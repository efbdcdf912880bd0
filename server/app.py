"""The composition root: builds, wires, starts and stops everything that runs in one process.

This process flies drones; it never imports torch. The simulator, the planner's annealing and the
training are child processes, so that none of them can take the fleet down with it.
"""

from __future__ import annotations

import asyncio
import errno
import gc
import logging
import os
import random
import signal
import socket
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from server.api.access import KeyRing
from server.api.config import ApiConfig
from server.api.door import Door
from server.api.serving import uvicorn_config
from server.api.sessions import Sessions
from server.api.web import make_web
from server.jobs.book import JobBook
from server.jobs.compile_ahead import compile_ahead
from server.jobs.local import LocalRunner
from server.jobs.ray_runner import RayRunner
from server.jobs.runner import JobRunner
from server.jobs.unsignalled import UnsignalledServer
from server.mission.busy_captures import BusyCaptures
from server.mission.control import Control
from server.mission.events import EventStream
from server.mission.librarian import Librarian, at_work
from server.scene.config import SceneConfig
from server.scene.scene import SceneView
from server.settings import Settings
from server.sim.config import SimConfig, fleet_config
from server.store.database import catalogue_url
from server.swarm.config import FleetConfig
from server.swarm.fleet import Fleet
from server.swarm.fleet_file import FleetFileError, load_fleet
from server.swarm.ports import LinkError

logger = logging.getLogger(__name__)

_DIST = Path(__file__).parent.parent / "web" / "dist"
# Where a drone rises it is this far from the fence, or its first drift sets off a failsafe.
_START_INSIDE_M = 0.5
_LAND_S = 12.0
_SIM_START_S = 90.0


class StartError(Exception):
    """Something asked for cannot be had (a port, a scene, an address); exit code 2."""


class SimulatorRefusedError(StartError):
    """The simulator cannot have what was asked for and has itself said why; add nothing."""


@dataclass(frozen=True, slots=True)
class SimulatedFleet:
    """What to simulate.

    Attributes:
        scene: A built-in scene's name or a path to a .glb or .obj file.
        drones: How many Tellos, 1 to 8.
        seed: Seed of start errors, drift and noise.
        truth: File for the true poses (for measurements only), None for none.
        address: First loopback address, None to choose a free block.
        faults: What goes wrong, as ``server.sim.faults.parse_fault`` reads it.
    """

    scene: str
    drones: int = 4
    seed: int = 0
    truth: Path | None = None
    address: str | None = None
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RunningSimulator:
    """A simulator that runs.

    Attributes:
        fleet: How its drones are reached.
        inject: Lets a fault happen now, as ``server.sim.faults.parse_fault`` reads it.
    """

    fleet: FleetConfig
    inject: Callable[[str], None]


@asynccontextmanager
async def simulated_fleet(wanted: SimulatedFleet) -> AsyncIterator[RunningSimulator]:
    """Run the simulator as a child process.

    Raises:
        StartError: If the scene is bad or the simulator does not start.
    """
    config = SimConfig(
        scene=wanted.scene,
        drones=wanted.drones,
        base_address=wanted.address or free_loopback_block(wanted.drones),
        seed=wanted.seed,
    )
    arguments = ["--scene", config.scene, "--drones", str(config.drones)]
    arguments += ["--address", config.base_address, "--seed", str(config.seed), "--attached"]
    if wanted.truth is not None:
        arguments += ["--truth", str(wanted.truth)]
    for fault in wanted.faults:
        arguments += ["--fault", fault]
    if not logger.isEnabledFor(logging.INFO):
        arguments.append("--quiet")
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        # A file of the folder we stand in must never shadow a module.
        "-P",
        "-m",
        "server.sim.simulator",
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stdin=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    stdin = process.stdin
    assert process.stdout is not None
    assert stdin is not None
    try:
        try:
            line = await asyncio.wait_for(process.stdout.readline(), _SIM_START_S)
        except TimeoutError:
            raise StartError("the simulator did not start; see the lines above") from None
        if not line:
            code = await process.wait()
            if code == 2:
                raise SimulatorRefusedError("the simulator has said why it does not start")
            raise StartError(f"the simulator ended with exit code {code}; see the lines above")
        yield RunningSimulator(fleet_config(config), lambda text: stdin.write(f"{text}\n".encode()))
    finally:
        if process.returncode is None:
            process.terminate()
            try:
                await asyncio.wait_for(process.wait(), 5.0)
            except TimeoutError:
                process.kill()
                await process.wait()


def real_fleet(path: Path) -> FleetConfig:
    """Return the fleet of a fleet file; raises StartError when it cannot be used."""
    try:
        return load_fleet(path)
    except FleetFileError as error:
        raise StartError(str(error)) from error


def free_loopback_block(drones: int) -> str:
    """Return the first address of a loopback block on whose command ports nobody listens."""
    for _ in range(100):
        first = f"127.{random.randint(1, 254)}.{random.randint(1, 254)}.1"
        head = first.rsplit(".", 1)[0]
        try:
            for n in range(1, drones + 1):
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind((f"{head}.{n}", 8889))
        except OSError:
            continue
        return first
    raise StartError("no free loopback addresses for the simulated drones were found")


def bind_port(host: str, port: int) -> socket.socket:
    """Return a bound TCP socket.

    Raises:
        StartError: If the port is taken or the address is not ours.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, port))
    except OSError as error:
        sock.close()
        if error.errno == errno.EADDRINUSE:
            raise StartError(
                f"port {port} on {host} is taken; choose another with --port"
            ) from None
        raise StartError(f"cannot listen on {host}:{port}: {error.strerror}") from error
    return sock


def check_runs(folder: Path) -> None:
    """Find out, without making anything, whether run folders can be made in ``folder``.

    Raises:
        StartError: If they cannot.
    """
    nearest = folder.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise StartError(f"run folders cannot be made in {folder}: {nearest} is not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise StartError(f"run folders cannot be made in {folder}: no right to write {nearest}")


def check_door(settings: Settings) -> None:
    """Find out, before anything starts, whether the console may be opened.

    Raises:
        SettingsError: If token or certificate cannot be used, or strangers could come in.
    """
    settings.open_token()
    settings.tls()


@asynccontextmanager
async def job_runner(settings: Settings, *, plan_too: bool = False) -> AsyncIterator[JobRunner]:
    """Open what runs jobs: this machine, or a Ray cluster.

    Args:
        settings: Which of them.
        plan_too: Let the cluster plan, too; a console plans here, while drones hover.

    Raises:
        StartError: If the address for the cluster's callbacks cannot be had.
    """
    if settings.runner == "local":
        yield LocalRunner()
        return
    async with AsyncExitStack() as stack:
        try:
            runner = await stack.enter_async_context(RayRunner(settings.ray, plan_too=plan_too))
        except OSError as error:
            raise StartError(f"ray.callback_host and callback_port: {error.strerror}") from error
        yield runner


def job_place(settings: Settings) -> Path | None:
    """Return the folder for the files of jobs from a shell, None for this machine's temporary one.

    The nodes of a cluster see the runs, but not that.

    Raises:
        StartError: If there can be no such folder.
    """
    if settings.runner == "local":
        return None
    check_runs(settings.runs)
    place = settings.runs.resolve()
    place.mkdir(parents=True, exist_ok=True)
    return place


@asynccontextmanager
async def flying(
    settings: Settings,
    fleet_config: FleetConfig,
    runner: JobRunner | None = None,
    fleet_file: Path | None = None,
) -> AsyncIterator[tuple[Control, Fleet]]:
    """Open the fleet and the mission control; on the way out every drone lands first.

    Without ``runner`` background jobs are processes of this machine. ``fleet_file`` is where the
    fleet was read from: cameras calibrated here are written into it.

    Raises:
        StartError: If drones would start outside the fence, or a drone's sockets cannot be
            opened.
    """
    reach_m = settings.safety.fence_radius_m - _START_INSIDE_M
    if fleet_config.start_radius_m > reach_m:
        raise StartError(
            f"start_radius_m is {fleet_config.start_radius_m:g}, must be at most {reach_m:g}:"
            f" the fence has a radius of {settings.safety.fence_radius_m:g} m"
        )
    async with AsyncExitStack() as stack:
        await stack.enter_async_context(compile_ahead())
        try:
            fleet = await stack.enter_async_context(Fleet(fleet_config, settings.safety))
        except LinkError as error:
            raise StartError(str(error)) from error
        control = Control(
            fleet,
            settings.runs,
            settings.flight(),
            EventStream(),
            runner=runner,
            recording=settings.recording,
            fleet_file=fleet_file,
        )
        await stack.enter_async_context(control)
        try:
            yield control, fleet
        finally:
            await land_all(fleet)


async def bring_down(control: Control, fleet: Fleet) -> None:
    """Abort what flies and land it while the console still serves its stops."""
    await control.end_capture()
    await land_all(fleet)


async def land_all(fleet: Fleet) -> None:
    """Land whatever flies and wait until it stands, at most some seconds."""
    if all(drone.activity in ("ground", "offline", "cut") for drone in fleet.drones.values()):
        return
    logger.info("landing all drones before the end")
    fleet.land()
    deadline = asyncio.get_running_loop().time() + _LAND_S
    while asyncio.get_running_loop().time() < deadline:
        if not any(d.activity in ("flying", "holding", "landing") for d in fleet.drones.values()):
            return
        await asyncio.sleep(0.1)


def catalogue_text(settings: Settings) -> str | None:
    """Return the URL of the catalogue's database, None for a file in the runs folder.

    Raises:
        StartError: If it is none.
    """
    secret = settings.database_url
    text = None if secret is None else secret.get_secret_value()
    try:
        catalogue_url(settings.runs, text)
    except ValueError as error:
        raise StartError(str(error)) from error
    return text


@asynccontextmanager
async def console(
    settings: Settings, control: Control, fleet: Fleet, sock: socket.socket, book: JobBook
) -> AsyncIterator[str]:
    """Serve dashboard, API and scene on ``sock``; yields the address with its token."""
    async with AsyncExitStack() as stack:
        scene_port = None
        try:
            scene = SceneView(config=SceneConfig(start_radius_m=fleet.config.start_radius_m))
            await stack.enter_async_context(scene)
            scene_port = scene.port
            standing = control.standing()
            follow = asyncio.create_task(scene.follow(control.events, standing), name="scene")
            stack.push_async_callback(_end, follow)
        except Exception:
            logger.exception("the 3D scene did not start; everything else works without it")
        busy = BusyCaptures()
        librarian = Librarian(
            settings.runs,
            catalogue_text(settings),
            settings.retention,
            control.events,
            lambda: control.live() | book.at_work() | busy.ids(),
            control.forget,
        )
        await stack.enter_async_context(at_work(librarian))
        token = settings.open_token()
        config = ApiConfig(webhook=settings.webhook)
        sessions = Sessions(config.door.sessions, config.door.session_s, settings.session_file())
        ring = KeyRing(token, settings.token_registry())
        door = Door(ring, prefix=settings.path_prefix, sessions=sessions)
        web = make_web(
            control, fleet, book, busy, door, scene_port, _DIST, version("dronerf"), config
        )
        server = UnsignalledServer(uvicorn_config(web, tls=settings.tls()))
        # Whoever reads the address may connect at once; until the server is up, that waits.
        sock.listen()
        serving = asyncio.create_task(server.serve(sockets=[sock]), name="web")
        host, port = sock.getsockname()
        # What is here now stays to the end. Looking through all of it again and again would stop
        # every thread for a tenth of a second on a busy machine, with drones in the air.
        gc.collect()
        gc.freeze()
        scheme = "http" if settings.tls() is None else "https"
        try:
            yield f"{scheme}://{host}:{port}{settings.path_prefix}/?token={token}"
        finally:
            server.should_exit = True
            await asyncio.wait([serving], timeout=5.0)


async def _end(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def stop_signal() -> asyncio.Event:
    """Return an event that the signals to end set; a second signal ends the program at once."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()

    def on_signal() -> None:
        if stop.is_set():
            raise SystemExit(1)
        logger.warning("stopping: landing first; a second signal stops without landing")
        stop.set()

    # A terminal window that is closed must not leave drones in the air, either.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_IGN:
            continue  # Started by nohup, for one: it shall live on.
        loop.add_signal_handler(number, on_signal)
    return stop
