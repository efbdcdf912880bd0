"""A recorded flight once more: the mission's own eyes, pilot, seed and planning on a file.

Time is that of the console that flew. Reports and pictures come in their recorded order; the pilot
takes notice of them when it did in flight; seed geometries, parts, picks and plans are made when
they were made in flight. Nothing depends on the machine's pace, so every replay gives the same
numbers.

Pictures that the console was too slow to search in flight are searched here, and each is at once:
a replay agrees with its flight closely, not to the last digit.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from server.mission.commands import CaptureRequest, RefusedError
from server.mission.events import Event, EventStream, Noted, PlanFound
from server.mission.eyes import Eye
from server.mission.phases import Phase
from server.mission.pilot import Pilot
from server.mission.pointing import Pointing
from server.recording.reading import Recording
from server.replay.notes import Filmed, Happened, NoteReader, Reported
from server.replay.planning import RecordedPlanning
from server.replay.recorded_fleet import (
    FlightDescription,
    RecordedDrone,
    RecordedEye,
    RecordedFleet,
    StartCircle,
    described,
)
from server.replay.report import DroneTally, ReplayResult
from server.replay.seeding import RecordedSeeding
from server.replay.times import flight_times, tick_times
from server.swarm.access_units import AccessUnit
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.unit_decoder import UnitDecoder

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
    times = flight_times(recording, description.wall_ns)
    notes = NoteReader(times.zero_ns)
    flight = _Flight(description, times.told_s)
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
        seeds=flight.seeding.seeds,
        plans=flight.news.plans,
        remarks=flight.news.remarks,
    )


class _News(EventStream):
    """Keeps what the mission's parts tell, where the console would show it.

    Attributes:
        plans: Every plan, in order.
        remarks: What could not be done, and why.
    """

    def __init__(self) -> None:
        super().__init__()
        self.plans: list[PlanFound] = []
        self.remarks: list[str] = []

    def publish(self, event: Event) -> None:
        """Keep a plan or a warning; nobody subscribes."""
        match event:
            case PlanFound():
                self.plans.append(event)
            case Noted(level="warning" | "error"):
                about = "" if event.drone_id is None else f"{event.drone_id}: "
                self.remarks.append(f"{about}{event.text}")
            case _:
                pass


class _Flight:
    """The pipeline of one recorded flight.

    Attributes:
        pilot: The mission's own; it believes, but steers nobody.
        seeding: The seed geometries.
        news: Plans and remarks.
        tallies: What came out, by drone.
    """

    def __init__(self, description: FlightDescription, told_s: Sequence[float]) -> None:
        """Build it; ``told_s`` are the times of which poses were told in flight."""
        config = description.config
        config = replace(config, mission=replace(config.mission, plan_timeout_s=_NO_HURRY_S))
        self._drones = {drone.id: RecordedDrone(drone) for drone in description.drones}
        fleet = RecordedFleet(StartCircle(description.start_radius_m), self._drones)
        region, count = config.vision.region, len(description.drones)
        # Eyes take turns as those of the console did.
        self._eyes = {
            drone.id: RecordedEye(drone, region, number / count)
            for number, drone in enumerate(description.drones)
        }
        self._decoders = {drone_id: UnitDecoder(drone_id) for drone_id in self._drones}
        self.tallies = {drone_id: DroneTally() for drone_id in self._drones}
        self.news = _News()
        eyes: dict[str, Eye] = dict(self._eyes)
        # Of fleet and drones, the mission's parts take here only what recordings hold.
        drones = cast("dict[str, Drone]", self._drones)
        self.pilot = Pilot(cast("Fleet", fleet), eyes, config, self.news)
        self._pointing = Pointing(drones, eyes, self.pilot, config, self.news, lambda: self._now_s)
        self.seeding = RecordedSeeding(fleet, self._eyes, self.pilot, config.vision.seed)
        request = description.request or CaptureRequest()
        self._planning = RecordedPlanning(request, config, fleet, self._eyes, self.pilot, self.news)
        self._now_s = 0.0
        self._phase = ""
        self._dt_s = 1.0 / config.mission.control_rate_hz
        self._ticks = deque(tick_times(told_s, self._dt_s))
        self._ticked_s: float | None = None

    async def take(self, note: Reported | Filmed | Happened, at_s: float) -> None:
        """Take the next note of the recording."""
        self._tick_until(at_s)
        self._now_s = at_s
        match note:
            case Reported():
                self._take_report(note)
            case Filmed(drone_id, unit):
                self._take_picture(drone_id, unit)
            case Happened(name, fields):
                await self._take_event(name, fields)

    def end(self) -> None:
        """Make what can still be made."""
        self._end_look_around()

    # Drones ----------------------------------------------------------------------------------

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
        self.seeding.look()

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

    # Events ----------------------------------------------------------------------------------

    async def _take_event(self, name: str, fields: dict[str, Any]) -> None:
        match name:
            case "capture_changed":
                self._planning.wanted = fields["images_total"]
                await self._enter(fields["phase"])
            case "seed_fitted":
                self.seeding.fitted(fields["seed"]["views"])
            case "capture_taken":
                drone_id = fields["capture"]["pose"]["drone_id"]
                self.seeding.photographed(drone_id)
                self._planning.photographed(drone_id, self._now_s)
            case "plan_found" if self._phase != Phase.PLAN:
                await self._planning.plan_anew()
            case "priorities_changed":
                self._planning.set_parts(fields["parts"], self._now_s)
            case "no_go_changed":
                self._planning.set_no_go(fields["volumes"])
            case "object_pointed_out":
                self._point_out(fields["drone_id"], fields["box"])
            case _:
                pass

    async def _enter(self, phase: str) -> None:
        if phase == self._phase:
            return
        if self._phase == Phase.SEED:
            self._end_look_around()
        elif self._phase == Phase.CAPTURE:
            self.seeding.end_round()
        self._phase = phase
        if phase == Phase.SEED and self.pilot.seed is None:
            self.seeding.begin(self._now_s)
        elif phase == Phase.PLAN and not self.news.plans:
            await self._planning.plan(self._now_s)

    def _end_look_around(self) -> None:
        reason = self.seeding.conclude()
        if reason is not None:
            self.news.remarks.append(f"no seed geometry: {reason}")

    def _point_out(self, drone_id: str, shares: list[float] | None) -> None:
        """Let the operator point out again what was pointed out in flight, in a drone's picture.

        Args:
            drone_id: In whose picture.
            shares: The box as ``ObjectPointedOut`` has it, None where it was taken back.
        """
        if shares is None:
            self._pointing.search(drone_id)
            return
        camera = self._drones[drone_id].config.intrinsics
        # The event counts from the first pixel's centre, whoever points from the picture's edge.
        half_pixel = 0.5 / np.tile([camera.width, camera.height], 2)
        left, top, right, bottom = (float(share) for share in np.array(shares) + half_pixel)
        try:
            self._pointing.point_out(drone_id, (left, top, right, bottom))
        except RefusedError as error:
            self.news.remarks.append(f"not pointed out: {error}")
