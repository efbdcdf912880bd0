"""A recorded flight once more: the mission's own eyes, pilot, seed and planning on a file.

Time is the file's own. Reports and pictures come in their recorded order; the pilot takes notice
of them when it did in flight; seed views and plan are made in the phases in which they were made in
flight. Nothing depends on the machine's pace, so every replay gives the same numbers.

Pictures that the console was too slow to search in flight are searched here, and each is at once:
a replay agrees with its flight closely, not to the last digit.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from server.geometry.axes import wrap_angle
from server.mission.commands import CaptureRequest
from server.mission.events import EventStream, PlanFound
from server.mission.eyes import Eye, Sight
from server.mission.phases import Phase
from server.mission.pilot import Pilot
from server.mission.planning import Planning
from server.mission.priorities import Priorities
from server.planner.errors import PlanError
from server.recording.reading import Recording
from server.replay.notes import Filmed, Happened, NoteReader, Reported
from server.replay.prompt_jobs import PromptRunner
from server.replay.recorded_fleet import (
    FlightDescription,
    RecordedDrone,
    RecordedEye,
    RecordedFleet,
    StartCircle,
    described,
)
from server.replay.report import DroneTally, ReplayResult
from server.stages import View
from server.swarm.access_units import AccessUnit
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.unit_decoder import UnitDecoder
from server.vision.seed import SeedError, seed_from_views

_QUARTER_TURN = np.pi / 2.0
# As in flight, a seed view may miss its azimuth by this much.
_AZIMUTH_RAD = 0.3
# Here planning takes as long as it takes.
_NO_HURRY_S = 1e6
_SEED_OF_CHANCE = 0

OnProgress = Callable[[float], None]


async def replay(
    path: Path, speed: float = 0.0, on_progress: OnProgress | None = None
) -> ReplayResult:
    """Send a recording through the pipeline.

    Args:
        path: The file.
        speed: Seconds of the recording per second; 0: as fast as possible.
        on_progress: Called now and then with the seconds of the recording that are done.

    Raises:
        RecordingError: If it is no recording of a flight.
    """
    cv2.setNumThreads(1)
    cv2.setRNGSeed(_SEED_OF_CHANCE)  # Cutting out an object draws random numbers.
    recording = Recording(path)
    description = described(recording.metadata())
    notes = NoteReader(description.wall_ns)
    told_ns = {m.publish_ns for m in recording.messages() if m.schema == "foxglove.PoseInFrame"}
    flight = _Flight(description, sorted(notes.at_s(ns) for ns in told_ns))
    begun_s: float | None = None
    started_s, at_s = time.monotonic(), 0.0
    for message in recording.messages():
        at_s = max(at_s, notes.at_s(message.log_ns))
        begun_s = at_s if begun_s is None else begun_s
        note = notes.read(message)
        if note is None:
            continue
        if speed > 0.0:
            due_s = started_s + (at_s - begun_s) / speed
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
        await flight.take(note, at_s)
        if on_progress is not None:
            on_progress(at_s - begun_s)
    flight.end()
    return ReplayResult(
        file=str(path),
        whole=recording.whole,
        seconds=0.0 if begun_s is None else at_s - begun_s,
        drones=flight.tallies,
        seed=flight.pilot.seed,
        plan=flight.plan,
        remarks=flight.remarks,
    )


def tick_times(told_s: Sequence[float], dt_s: float) -> list[float]:
    """Return when the pilot took notice.

    It tells its poses at some of these moments only; the others lie evenly between.

    Args:
        told_s: Times of which poses were told, ascending.
        dt_s: How far apart the moments are when nothing is in the way.
    """
    ticks: list[float] = []
    for before_s, after_s in pairwise(told_s):
        steps = max(1, round((after_s - before_s) / dt_s))
        ticks += np.linspace(before_s, after_s, steps, endpoint=False).tolist()
    return [*ticks, *told_s[-1:]]


class _Flight:
    """The pipeline of one recorded flight.

    Attributes:
        pilot: The mission's own; it believes, but steers nobody.
        tallies: What came out, by drone.
        plan: The plan, once made.
        remarks: What could not be done.
    """

    def __init__(self, description: FlightDescription, told_s: Sequence[float]) -> None:
        """Build it; ``told_s`` are the times of which poses were told in flight."""
        config = description.config
        self._config = replace(config, mission=replace(config.mission, plan_timeout_s=_NO_HURRY_S))
        self._request = description.request or CaptureRequest()
        self._drones = {drone.id: RecordedDrone(drone) for drone in description.drones}
        fleet = RecordedFleet(StartCircle(description.start_radius_m), self._drones)
        self._eyes = {
            drone.id: RecordedEye(drone, config.vision.region) for drone in description.drones
        }
        self._decoders = {drone_id: UnitDecoder(drone_id) for drone_id in self._drones}
        self._events = EventStream()
        eyes: dict[str, Eye] = dict(self._eyes)
        # Of fleet and drones, believing takes only what recordings hold.
        self.pilot = Pilot(cast("Fleet", fleet), eyes, self._config, self._events)
        self.tallies = {drone_id: DroneTally() for drone_id in self._drones}
        self.plan: PlanFound | None = None
        self.remarks: list[str] = []
        self._phase = ""
        self._views: dict[str, list[View]] = {}
        self._wanted_views = 0
        self._dt_s = 1.0 / config.mission.control_rate_hz
        self._ticks = deque(tick_times(told_s, self._dt_s))
        self._ticked_s: float | None = None

    async def take(self, note: Reported | Filmed | Happened, at_s: float) -> None:
        """Take the next note of the recording."""
        self._tick_until(at_s)
        match note:
            case Reported():
                self._take_report(note)
            case Filmed(drone_id, unit):
                self._take_picture(drone_id, unit)
            case Happened(name="capture_changed", fields=fields):
                await self._enter(fields["phase"], at_s)
            case Happened(name="object_pointed_out", fields=fields):
                self._point_out(fields["drone_id"], fields["box"])
            case Happened():
                pass

    def end(self) -> None:
        """Make what can still be made."""
        self._leave_seed()

    def _tick_until(self, at_s: float) -> None:
        """Let the pilot take notice when it did in flight, and as often where that is unknown."""
        while self._ticks and self._ticks[0] <= at_s:
            self._tick(self._ticks.popleft())
        if not self._ticks:
            if self._ticked_s is None:
                self._ticked_s = at_s
            while self._ticked_s + self._dt_s <= at_s:
                self._tick(self._ticked_s + self._dt_s)

    def _tick(self, at_s: float) -> None:
        self._ticked_s = at_s
        self.pilot.observe(at_s)

    def _take_report(self, note: Reported) -> None:
        drone = self._drones.get(note.telemetry.drone_id)
        if drone is None:
            return
        if note.activity == "taking_off" and drone.activity != "taking_off":
            self.pilot.place_at_start(note.telemetry.drone_id)
        drone.telemetry, drone.activity = note.telemetry, note.activity

    def _take_picture(self, drone_id: str, unit: AccessUnit) -> None:
        if drone_id not in self._decoders:
            return
        tally = self.tallies[drone_id]
        tally.coded += 1
        for frame in self._decoders[drone_id].decode(unit):
            sight = self._eyes[drone_id].look(frame)
            tally.add(sight, self.pilot.pose(drone_id, frame.captured_s))
            if self._phase == Phase.SEED and self.pilot.seed is None:
                self._consider_view(drone_id, sight)

    def _point_out(self, drone_id: str, shares: list[float] | None) -> None:
        """Tell the eye what the operator pointed out, in shares of the picture."""
        if drone_id not in self._eyes:
            return
        if shares is None:
            self._eyes[drone_id].point_out(None)
            return
        camera = self._drones[drone_id].config.intrinsics
        size = np.tile([camera.width, camera.height], 2)
        self._eyes[drone_id].point_out(np.array(shares) * size)

    # Phases ----------------------------------------------------------------------------------

    async def _enter(self, phase: str, at_s: float) -> None:
        if phase == self._phase:
            return
        if self._phase == Phase.SEED:
            self._leave_seed()
        self._phase = phase
        if phase == Phase.PREFLIGHT and self.pilot.seed is None:
            self.pilot.begin_capture()
        elif phase == Phase.SEED and self.pilot.seed is None:
            crew = self._crew()
            self._views = {drone_id: [] for drone_id in crew}
            self._wanted_views = -(-4 // len(crew)) if crew else 0
        elif phase == Phase.PLAN and self.plan is None:
            await self._make_plan(at_s)

    def _crew(self) -> list[str]:
        return [d for d, drone in self._drones.items() if drone.activity in ("flying", "holding")]

    def _consider_view(self, drone_id: str, sight: Sight) -> None:
        """Keep a sight for the seed geometry if it is the drone's turn to give one."""
        views = self._views.get(drone_id)
        if views is None or len(views) >= self._wanted_views:
            return
        if sight.frame.damaged or sight.region is None or sight.box is None:
            return
        pose = self.pilot.pose(drone_id, sight.frame.captured_s)
        turns = -(-4 // len(self._views))
        turn = min(len(views), turns - 1)
        if turn > 0:
            wanted_rad = self.pilot.start_azimuth_rad(drone_id) + turn * _QUARTER_TURN
            offset = pose.position_world - self.pilot.target().centre
            azimuth_rad = float(np.arctan2(offset[1], offset[0]))
            if abs(wrap_angle(azimuth_rad - wanted_rad)) > _AZIMUTH_RAD:
                return
        intrinsics = self._drones[drone_id].config.intrinsics
        views.append(View(pose, intrinsics, sight.box, sight.region))
        if all(len(taken) >= self._wanted_views for taken in self._views.values()):
            self._fit_seed()
            # A picture more of each may show what these did not.
            self._wanted_views += self.pilot.seed is None

    def _fit_seed(self) -> str | None:
        """Fit the seed geometry; returns why it is not possible, or None."""
        longest = max((len(views) for views in self._views.values()), default=0)
        views = tuple(
            taken[n] for n in range(longest) for taken in self._views.values() if n < len(taken)
        )
        try:
            self.pilot.seed = seed_from_views(views, self._config.vision.seed)
        except SeedError as error:
            return str(error)
        return None

    def _leave_seed(self) -> None:
        if self._phase == Phase.SEED and self.pilot.seed is None:
            # A flight takes pictures that are just there, and may be done within the moment.
            for drone_id in self._views:
                sight = self._eyes[drone_id].sight
                if sight is not None and self.pilot.seed is None and not self._views[drone_id]:
                    self._consider_view(drone_id, sight)
        if self._phase == Phase.SEED and self.pilot.seed is None:
            reason = self._fit_seed()
            if reason is not None:
                self.remarks.append(f"no seed geometry: {reason}")

    async def _make_plan(self, at_s: float) -> None:
        seed, crew = self.pilot.seed, self._crew()
        if seed is None or not crew:
            self.remarks.append("no plan: there is no seed geometry to plan for")
            return
        drones = cast("dict[str, Drone]", self._drones)
        planning = Planning(
            self._request,
            Path(),
            PromptRunner(),
            self._events,
            self._config,
            Priorities(drones, self.pilot, self._events),
        )
        poses = {drone_id: self.pilot.pose(drone_id, at_s) for drone_id in crew}
        rounds = -(-self._request.pictures // len(crew))
        with self._events.subscribe() as news:
            try:
                await planning.rounds(seed, poses, self._drones[crew[0]].config, rounds)
            except PlanError as error:
                self.remarks.append(f"no plan: {error}")
                return
            async for event in news:
                if isinstance(event, PlanFound):
                    self.plan = event
                    return
