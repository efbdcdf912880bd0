"""One mission in deterministic simulation: one process, an in-memory network, a virtual clock.

Driver, safety, pilot and mission are those that fly real drones; sockets, time and the stage
Frame -> Box are replaced. The same case flies the same way every time.
"""

from __future__ import annotations

import asyncio
import contextlib
import tempfile
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from server.bench.missions.cases import Case
from server.bench.missions.inline_jobs import InlineRunner
from server.bench.missions.judge import SURFACE_POINTS, Body, Judge
from server.bench.missions.outcome import Outcome, outcome_of
from server.bench.missions.trouble import Trouble, fly_with_trouble
from server.bench.missions.virtual_sight import (
    FPS,
    SightErrors,
    VirtualCamera,
    VirtualDecoder,
    VirtualEye,
    hull_points,
)
from server.mission.config import FlightConfig, MissionConfig
from server.mission.control import Control
from server.mission.events import EventStream
from server.planner.config import PlannerConfig
from server.sim.air import AirLink
from server.sim.config import SimConfig, fleet_config
from server.sim.faults import parse_fault
from server.sim.scenes.catalogue import load_object
from server.sim.tello import Tello
from server.sim.virtual_time import in_virtual_time
from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.vision.config import VisionConfig

_JUDGE_S = 0.1
_DRONES = 4
_LONGEST_FLIGHT_S = 900.0
# What is in the air when the mission is over has this long to come down.
_COME_DOWN_S = 40.0


def fly_in_virtual_time(case: Case) -> Outcome:
    """Fly a case; raises SceneError for a scene that does not exist."""
    with tempfile.TemporaryDirectory(prefix="dronerf-flight-") as runs:
        return in_virtual_time(VirtualFlight(case, Path(runs)).fly())


class VirtualFlight:
    """One case under way.

    Attributes:
        tellos: The simulated drones, the truth, by id.
    """

    def __init__(self, case: Case, runs: Path) -> None:
        self._case = case
        self._runs = runs
        model = load_object(case.scene)
        faults = (parse_fault(f"loss={case.loss}"),) if case.loss > 0 else ()
        sim = SimConfig(scene=case.scene, drones=_DRONES, seed=case.seed, faults=faults)
        self._fleet_config = fleet_config(sim)
        self.tellos = {sim.drone_id(i): Tello(sim, i) for i in range(_DRONES)}
        self._cameras = {d: VirtualCamera(tello) for d, tello in self.tellos.items()}
        self._points = hull_points(np.asarray(model.vertices))
        self._safety = SafetyConfig()
        surface = np.asarray(model.trimesh.sample(SURFACE_POINTS, seed=case.seed), np.float64)
        self._judge = Judge(surface, self._safety)
        self._runner = InlineRunner(hangs=case.fault == "planner_hangs")
        self._took_off_s: float | None = None
        self._down_s = 0.0

    async def fly(self) -> Outcome:
        """Fly it."""
        begun_s = time.perf_counter()
        async with self.opened() as (control, fleet):
            watch = asyncio.create_task(self._watch())
            trouble = Trouble(self._case, control, fleet, self._inject)
            record = await fly_with_trouble(self._case, control, trouble, _LONGEST_FLIGHT_S)
            await self._come_down(fleet)
            unsafe = self._ends_unsafely(fleet)
            watch.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await watch
            outcome = outcome_of(
                self._case,
                record,
                self._judge.judgement,
                trouble.reactions(),
                happened=trouble.onset_s is not None,
                victim=trouble.victim,
                real_udp=False,
                flight_s=self._down_s - (self._took_off_s or self._down_s),
                wall_s=time.perf_counter() - begun_s,
                unsafe_end=unsafe,
            )
        return outcome

    @asynccontextmanager
    async def opened(self) -> AsyncIterator[tuple[Control, Fleet]]:
        """Open the fleet on the simulated drones, and a mission control over it."""
        links = {
            d: AirLink(tello, camera=self._cameras[d].shoot, fps=FPS)
            for d, tello in self.tellos.items()
        }
        async with AsyncExitStack() as stack:
            fleet = Fleet(
                self._fleet_config,
                self._safety,
                links=dict(links),
                clock=asyncio.get_running_loop().time,
                decoder=VirtualDecoder,
            )
            await stack.enter_async_context(fleet)
            control = Control(
                fleet,
                self._runs,
                _config(self._safety),
                EventStream(),
                make_eye=self._eye,
                runner=self._runner,
            )
            await stack.enter_async_context(control)
            yield control, fleet
        for link in links.values():
            link.end()

    def _inject(self, fault: str, drone_id: str) -> None:
        now_s = asyncio.get_running_loop().time()
        self.tellos[drone_id].inject(parse_fault(fault), now_s)

    def _eye(self, drone: Drone) -> VirtualEye:
        camera = self._cameras[drone.config.id]
        number = list(self._cameras).index(drone.config.id)
        rng = np.random.default_rng([self._case.seed, 100 + number])
        # What loses datagrams also loses boxes: the picture was there too late, or half.
        errors = SightErrors(drop_outs=0.1 + self._case.loss)
        return VirtualEye(drone, camera, self._points, errors, rng)

    # -- truth --------------------------------------------------------------------------------

    async def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            bodies = {d: _body(tello) for d, tello in self.tellos.items()}
            self._judge.observe(bodies)
            if any(body.flying for body in bodies.values()):
                self._took_off_s = self._took_off_s or loop.time()
                self._down_s = loop.time()
            await asyncio.sleep(_JUDGE_S)

    async def _come_down(self, fleet: Fleet) -> None:
        """Wait until everything stands or hovers under HOLD."""
        for _ in range(int(_COME_DOWN_S / _JUDGE_S)):
            if not self._ends_unsafely(fleet):
                return
            await asyncio.sleep(_JUDGE_S)

    def _ends_unsafely(self, fleet: Fleet) -> bool:
        return any(
            tello.airframe.phase != "standing" and not fleet.drones[d].held
            for d, tello in self.tellos.items()
        )


def _config(safety: SafetyConfig) -> FlightConfig:
    # Nobody will bring batteries: a grounded capture ends soon.
    mission = replace(MissionConfig(), grounded_timeout_s=20.0)
    return FlightConfig(mission, PlannerConfig(), VisionConfig(), safety)


def _body(tello: Tello) -> Body:
    return Body(np.asarray(tello.airframe.position), tello.airframe.phase != "standing")
