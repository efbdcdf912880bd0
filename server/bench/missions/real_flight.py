"""One mission over real UDP with real video: the simulator is a process of its own.

Everything runs as in flight: sockets, decoder, region search, planner as a worker process. Truth
comes from the simulator's own record afterwards.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import numpy as np

from server.app import RunningSimulator, SimulatedFleet, flying, simulated_fleet
from server.bench.missions.cases import Case
from server.bench.missions.judge import SURFACE_POINTS, Body, Judge, Judgement
from server.bench.missions.outcome import Outcome, outcome_of
from server.bench.missions.trouble import Trouble, fly_with_trouble
from server.settings import load_settings
from server.sim.scenes.catalogue import load_object
from server.swarm.config import SafetyConfig

_DRONES = 4
_LONGEST_FLIGHT_S = 420.0
_COME_DOWN_S = 30.0


def fly_over_udp(case: Case) -> Outcome:
    """Fly a case in real time; raises StartError if the simulator does not start."""
    with tempfile.TemporaryDirectory(prefix="dronerf-flight-") as folder:
        return asyncio.run(_fly(case, Path(folder)))


async def _fly(case: Case, folder: Path) -> Outcome:
    begun_s = time.monotonic()
    truth = folder / "truth.jsonl"
    faults = (f"loss={case.loss:g}",) if case.loss > 0 else ()
    wanted = SimulatedFleet(case.scene, _DRONES, case.seed, truth, faults=faults)
    settings = load_settings(runs=folder / "runs", mission={"grounded_timeout_s": 20.0})
    async with AsyncExitStack() as stack:
        simulator = await stack.enter_async_context(simulated_fleet(wanted))
        control, fleet = await stack.enter_async_context(flying(settings, simulator.fleet))
        trouble = Trouble(case, control, fleet, _injector(simulator))
        record = await fly_with_trouble(case, control, trouble, _LONGEST_FLIGHT_S)
        held = {d for d, drone in fleet.drones.items() if drone.held}
        await _come_down(truth, held)
        bodies = _bodies(truth)
        unsafe = _in_the_air(bodies[-1][1], held) if bodies else True
        reactions = trouble.reactions()
    airborne = [at_s for at_s, now in bodies if any(body.flying for body in now.values())]
    return outcome_of(
        case,
        record,
        _judge(case, bodies, settings.safety),
        reactions,
        happened=trouble.onset_s is not None,
        victim=trouble.victim,
        real_udp=True,
        flight_s=airborne[-1] - airborne[0] if airborne else 0.0,
        wall_s=time.monotonic() - begun_s,
        unsafe_end=unsafe,
    )


def _injector(simulator: RunningSimulator) -> Callable[[str, str], None]:
    return lambda fault, drone_id: simulator.inject(f"{fault}:{drone_id}")


async def _come_down(truth: Path, held: set[str]) -> None:
    """Wait until everything stands or hovers under HOLD."""
    deadline_s = time.monotonic() + _COME_DOWN_S
    while time.monotonic() < deadline_s:
        bodies = await asyncio.to_thread(_bodies, truth)
        if bodies and not _in_the_air(bodies[-1][1], held):
            return
        await asyncio.sleep(1.0)


def _in_the_air(bodies: dict[str, Body], held: set[str]) -> bool:
    return any(body.flying for drone_id, body in bodies.items() if drone_id not in held)


def _bodies(truth: Path) -> list[tuple[float, dict[str, Body]]]:
    """Return where every drone truly was at each moment of the record."""
    moments: list[tuple[float, dict[str, Body]]] = []
    record = Path(f"{truth}.bodies")
    for line in record.read_text().splitlines() if record.exists() else []:
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            continue  # The line that is being written.
        bodies = {
            drone_id: Body(np.array(body["position"]), body["phase"] != "standing")
            for drone_id, body in entry["bodies"].items()
        }
        moments.append((entry["t_monotonic"], bodies))
    return moments


def _judge(
    case: Case, bodies: list[tuple[float, dict[str, Body]]], safety: SafetyConfig
) -> Judgement:
    model = load_object(case.scene)
    surface = np.asarray(model.trimesh.sample(SURFACE_POINTS, seed=case.seed), np.float64)
    judge = Judge(surface, safety)
    for _, now in bodies:
        judge.observe(now)
    return judge.judgement
