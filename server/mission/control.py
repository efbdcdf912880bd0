"""The mission's front desk: implements ``MissionControl`` for console, shell and tests.

It owns the standing tasks (eyes, pilot, reports) and at most one running mission, and it knows the
captures on disk. Everything here runs on the event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import logging
import math
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2

from server.jobs.local import LocalRunner
from server.jobs.runner import JobRunner
from server.mission import chronicle
from server.mission.calibrations import Calibrations
from server.mission.checklist import Check, check_console, check_disk, check_drone, problems
from server.mission.commands import (
    MOST_PICTURES,
    Area,
    CaptureRecord,
    CaptureRequest,
    DatagramCounts,
    DroneCommand,
    FloorPlan,
    PointedPlace,
    RefusedError,
    Sticks,
    StopCommand,
    UnknownError,
)
from server.mission.config import FlightConfig
from server.mission.disagreement import DisagreementWatch
from server.mission.disk_watch import DiskWatch
from server.mission.events import (
    CaptureChanged,
    DroneReported,
    Event,
    EventStream,
    FailsafeFired,
    FieldView,
    FrameAnnotated,
    MetricsMeasured,
    NoGoVolume,
    Noted,
    ObjectPointedOut,
    PlanFound,
    PosesRefined,
    PreviewRendered,
    PriorityPart,
    SeedFitted,
    SurfaceSeen,
)
from server.mission.eyes import CameraEye, Eye
from server.mission.flight_recording import RECORDING, FlightRecording, Scenery, record_capture
from server.mission.mission import Mission, MissionTools
from server.mission.no_go import FILE as NO_GO_FILE
from server.mission.no_go import NoGo
from server.mission.phases import AIRBORNE
from server.mission.pilot import Pilot
from server.mission.pointing import Pointing
from server.mission.priorities import Priorities
from server.mission.recovery import Recovery
from server.mission.start_places import start_place
from server.recording.config import RecordingConfig
from server.recording.repair import repair_all
from server.store.deletion import delete_with_trainings
from server.store.runs import RunFolder, is_run, list_runs
from server.swarm.drone import Drone
from server.swarm.errors import DroneError
from server.swarm.failsafes import Failsafe
from server.swarm.fleet import FiredNote, Fleet

logger = logging.getLogger(__name__)

EyeMaker = Callable[[Drone], Eye]

_REPORT_S = 0.2
_STOP_WORDS: Mapping[StopCommand, str] = {
    "hold": "HOLD",
    "land": "LAND",
    "cut_motors": "CUT MOTORS",
}
_LONGEST_REASON = 300
_FAILSAFES_KEPT = 50
# An abort lands the drones somewhere clear of each other; then the program ends all the same.
_ABORT_S = 20.0
# The newest of each is what a newcomer to the console needs to see.
_STANDING = (
    SeedFitted,
    SurfaceSeen,
    PlanFound,
    PosesRefined,
    PreviewRendered,
    MetricsMeasured,
    CaptureChanged,
)


class Control:
    """Runs the eyes, the pilot and the missions of one fleet.

    Use as an async context manager: entering starts the standing tasks; leaving ends them.

    Attributes:
        events: Where all news goes.
        calibrations: The cameras' calibrations.
    """

    def __init__(
        self,
        fleet: Fleet,
        runs: Path,
        config: FlightConfig,
        events: EventStream,
        *,
        make_eye: EyeMaker | None = None,
        runner: JobRunner | None = None,
        recording: RecordingConfig | None = None,
        fleet_file: Path | None = None,
    ) -> None:
        """Build it.

        Args:
            fleet: The drones.
            runs: Folder of the run folders.
            config: Numbers of everything that flies.
            events: Where all news goes.
            make_eye: Makes a drone's eye; without it the drone's pictures are searched.
            runner: Starts background jobs; without it they are processes of this machine.
            recording: How captures are recorded; without it they are not.
            fleet_file: The file that ``fleet`` was read from, None without one.
        """
        self.events = events
        self.calibrations = Calibrations(
            fleet.drones, lambda: bool(self.live()), events, fleet_file
        )
        self._fleet = fleet
        self._runs = runs
        self._config = config
        # A thread for each drone, so that one long search holds up no other drone's pictures. Each
        # picture is one thread's work: sharing it costs OpenCV more than it gains.
        self._threads = ThreadPoolExecutor(
            max(1, len(fleet.drones)),
            thread_name_prefix="eyes",
            initializer=cv2.setNumThreads,
            initargs=(1,),
        )
        make_eye = make_eye if make_eye is not None else self._camera_eye
        self._eyes: dict[str, Eye] = {d: make_eye(drone) for d, drone in fleet.drones.items()}
        self._pilot = Pilot(fleet, self._eyes, config, events)
        runner = runner if runner is not None else LocalRunner()
        self._pointing = Pointing(fleet.drones, self._eyes, self._pilot, config, events, _now_s)
        self._priorities = Priorities(fleet.drones, self._pilot, events)
        self._no_go = NoGo(runs / NO_GO_FILE, self._pilot, config.planner, config.safety, events)
        self._disagreement = DisagreementWatch(
            fleet.drones, self._eyes, self._pilot, config.vision.agreement, events, _now_s
        )
        self._tools = MissionTools(
            fleet,
            self._eyes,
            self._pilot,
            runner,
            events,
            config,
            self._priorities,
            self._no_go,
            self._console_checks,
        )
        self._disk = DiskWatch(runs)
        self._recovery = Recovery(runner, events, self._keep)
        self._records: dict[str, CaptureRecord] = _records_on_disk(runs)
        self._fired = 0  # Number of the newest failsafe told.
        self._failsafes: deque[FailsafeFired] = deque(maxlen=_FAILSAFES_KEPT)
        self._standing: dict[type[Event], Event] = {}
        self._mission: Mission | None = None
        self._mission_task: asyncio.Task[None] | None = None
        self._recording = recording
        self._recording_task: asyncio.Task[None] | None = None
        self._repairing: asyncio.Task[list[Path]] | None = None
        self._adopting: asyncio.Task[None] | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._connecting: asyncio.Task[None] | None = None
        self._chronicle: asyncio.Task[None] | None = None
        self._failed_task = ""  # A standing task that has ended, which none should.

    async def __aenter__(self) -> Control:
        await self._disk.measure()
        self._tasks = [
            *(
                asyncio.create_task(eye.run(), name=f"eye {drone_id}")
                for drone_id, eye in self._eyes.items()
            ),
            asyncio.create_task(self._pilot.run(), name="pilot"),
            asyncio.create_task(self._report(), name="reports"),
            asyncio.create_task(self._watch(), name="standing events"),
            asyncio.create_task(self._disk.run(), name="disk watch"),
            asyncio.create_task(self._disagreement.run(self._observers), name="agreement"),
        ]
        # No flight depends on these: they end by themselves, or only tell.
        self._chronicle = asyncio.create_task(chronicle.follow(self.events), name="chronicle")
        self._connecting = asyncio.create_task(self._connect(), name="connect")
        left = list(self._records.values())
        self._adopting = asyncio.create_task(self._recovery.adopt(left), name="adopt")
        if self._recording is not None:
            files = [run.path / RECORDING for run in list_runs(self._runs)]
            self._repairing = asyncio.create_task(
                asyncio.to_thread(repair_all, [file for file in files if file.exists()]),
                name="repair recordings",
            )
        for task in self._tasks:
            task.add_done_callback(self._on_task_end)
        return self

    async def end_capture(self) -> None:
        """Abort the capture under way, if any, and wait until its drones are down."""
        if self._mission_task is not None and not self._mission_task.done():
            assert self._mission is not None
            with contextlib.suppress(ValueError):  # It is over and only cleans up.
                self._mission.abort("the console is shutting down")
            await asyncio.wait([self._mission_task], timeout=_ABORT_S)

    async def __aexit__(self, *_: object) -> None:
        await self.calibrations.close()
        await self.end_capture()
        if self._recording_task is not None and not self._recording_task.done():
            await asyncio.wait([self._recording_task], timeout=self._recording_patience_s())
        await self._recovery.close()
        ends = (self._connecting, self._adopting, self._repairing, self._chronicle)
        tasks = [*self._tasks, *(task for task in ends if task is not None)]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _connect(self) -> None:
        """Find and connect to every drone, side by side; says which one cannot be had and why."""
        for drone_id, reason in (await self._fleet.find_stations()).items():
            self.events.publish(Noted("error", reason, drone_id))

        async def connect_one(drone: Drone) -> None:
            try:
                await drone.connect()
            except DroneError as error:
                self.events.publish(Noted("error", str(error), drone.config.id))

        await asyncio.gather(*(connect_one(drone) for drone in self._fleet.drones.values()))

    def live(self) -> frozenset[str]:
        """Return the captures somebody works on."""
        tasks = (self._mission_task, self._recording_task)
        current = [] if self._mission is None else [self._mission.run_folder.id]
        flown = current if any(task is not None and not task.done() for task in tasks) else []
        return frozenset(flown) | {name for name in self._records if self._recovery.has(name)}

    def forget(self, capture_id: str) -> None:
        """Forget a capture whose folder is gone."""
        self._records.pop(capture_id, None)

    def _refuse_if_broken(self) -> None:
        if self._failed_task:
            raise RefusedError(
                f"the console's task “{self._failed_task}” has failed; restart the console"
            )

    def _on_task_end(self, task: asyncio.Task[None]) -> None:
        if task.cancelled():
            return
        # A standing task never ends by itself: whoever flies blind must land.
        self._failed_task = task.get_name()
        logger.error("%s ended: landing the fleet", task.get_name(), exc_info=task.exception())
        self._fleet.land()
        self.events.publish(
            Noted("error", f"The console's task “{task.get_name()}” failed, so all drones land.")
        )
        if self._mission is not None and self._mission.before_take_off:
            self._mission.abort(f"the console's task “{task.get_name()}” failed")

    def _camera_eye(self, drone: Drone) -> Eye:
        drones = list(self._fleet.drones)
        turn = drones.index(drone.config.id) / len(drones)
        return CameraEye(drone, self._config.vision, self.events, self._threads, turn=turn)

    # -- what is known ------------------------------------------------------------------------

    def drones(self) -> list[DroneReported]:
        """Return the newest report of every drone, in fleet order."""
        return [self._pilot.report(drone_id) for drone_id in self._fleet.drones]

    def newest_frame(self, drone_id: str) -> FrameAnnotated | None:
        """Return the newest annotated picture; raises UnknownError."""
        return self._eye(drone_id).annotated

    def standing(self) -> list[Event]:
        """Return the events a newcomer needs to see the present state."""
        told = [self._pointing, self._priorities, self._no_go, self._disagreement]
        operators = [event for each in told for event in each.standing()]
        return [*self._standing.values(), *operators, *self._failsafes]

    def captures(self) -> list[CaptureRecord]:
        """Return all known captures, newest first."""
        return sorted(self._records.values(), key=lambda record: record.status.id, reverse=True)

    def capture(self, capture_id: str) -> CaptureRecord:
        """Return one capture; raises UnknownError."""
        try:
            return self._records[capture_id]
        except KeyError:
            raise UnknownError(f"there is no capture {capture_id!r}") from None

    def preflight(self) -> list[Check]:
        """Return the preflight checklist as it stands now."""
        now_s = asyncio.get_running_loop().time()
        drones = self._fleet.drones.values()
        checks = [c for drone in drones for c in check_drone(drone, now_s, self._config.safety)]
        return [*checks, *self._console_checks()]

    def _console_checks(self) -> list[Check]:
        disk = self._disk
        disk_age_s = asyncio.get_running_loop().time() - disk.measured_s
        console = [check_console(self._failed_task), check_disk(disk.free_mb, disk_age_s)]
        return [*console, *self._no_go.checks()]

    def failsafes(self) -> tuple[Failsafe, ...]:
        """Return the failsafe table, row by row."""
        return self._config.safety.failsafes.rows()

    def disk_free_mb(self) -> float | None:
        """Return the free room on the disk of the runs, megabytes, None before it was measured."""
        return self._disk.free_mb if math.isfinite(self._disk.measured_s) else None

    def datagram_counts(self) -> Mapping[str, DatagramCounts]:
        """Return, per drone, which datagrams were of no use."""
        return {
            drone_id: DatagramCounts(drone.dropped, drone.unsent, drone.video_overflows)
            for drone_id, drone in self._fleet.drones.items()
        }

    def note_stop(self, command: StopCommand, drone_id: str | None) -> None:
        """Tell everybody that an operator has ordered a stop, which is under way already."""
        whom = "all drones" if drone_id is None else drone_id
        self.events.publish(Noted("warning", f"{_STOP_WORDS[command]} ordered: {whom}.", drone_id))

    def note_operator(self) -> None:
        """Note a sign of life of the operator in command."""
        self._fleet.note_operator()

    def release_operator(self) -> None:
        """Fly on without an operator."""
        self._fleet.forget_operator()
        if self._flying_mission():
            self.events.publish(Noted("warning", "Nobody is in command now; the flight goes on."))

    def run_folder(self, capture_id: str) -> Path:
        """Return the run folder of a capture or of a training beside it; raises UnknownError."""
        if capture_id not in self._records and is_run(self._runs, capture_id):
            return self._runs / capture_id
        return Path(self.capture(capture_id).status.run)

    def floor_plan(self) -> FloorPlan:
        """Return where the drones are set down."""
        fleet, safety = self._fleet.config, self._config.safety
        drones = [drone.config for drone in self._fleet.drones.values()]
        places = tuple(start_place(drone, fleet.start_radius_m) for drone in drones)
        return FloorPlan(fleet.start_radius_m, safety.fence_radius_m, safety.ceiling_m, places)

    def configuration(self) -> Mapping[str, object]:
        """Return by group the frozen config that flies."""
        pieces = {field.name: getattr(self._config, field.name) for field in fields(self._config)}
        return pieces if self._recording is None else {**pieces, "recording": self._recording}

    # -- what may be done ---------------------------------------------------------------------

    async def command_drone(self, drone_id: str, command: DroneCommand) -> None:
        """Carry out one drone's command; raises UnknownError or RefusedError."""
        self._eye(drone_id)
        drone = self._fleet.drones[drone_id]
        match command:
            case "hold":
                self._fleet.hold(drone_id)
            case "land":
                self._fleet.land(drone_id)
            case "cut_motors":
                self._fleet.cut_motors(drone_id)
            case "rearm":
                drone.rearm()
                self.events.publish(Noted("info", "Re-armed: it takes commands again.", drone_id))
            case "takeoff":
                self._refuse_if_needed()
                self._refuse_if_broken()
                if drone.held:
                    raise RefusedError(f"{drone_id} is held; re-arm it first")
                if not any(other.airborne for other in self._fleet.drones.values()):
                    # Whatever stands there now may be another thing than a capture saw.
                    self._pilot.begin_capture()
                barred = [c for c in self._no_go.checks() if c.drone_id in (None, drone_id)]
                if barred:
                    raise RefusedError(f"{drone_id}: {barred[0].found}. {barred[0].remedy}")
                self.calibrations.end_for("flight", f"{drone_id} takes off")
                self._begin_unwatched()
                self._pilot.place_at_start(drone_id)
                self.events.publish(Noted("info", "Take-off ordered.", drone_id))
                await drone.take_off()

    def steer(self, drone_id: str, sticks: Sticks) -> None:
        """Fly a drone by hand for a moment; raises UnknownError or RefusedError."""
        self._eye(drone_id)
        self._refuse_if_needed()
        self._refuse_if_broken()
        if self._fleet.drones[drone_id].activity != "flying":
            raise RefusedError(f"{drone_id} does not fly")
        self._pilot.steer(drone_id, sticks)

    async def start_capture(self, request: CaptureRequest) -> CaptureRecord:
        """Begin a capture; raises RefusedError (one at a time) or ValueError (bad numbers)."""
        drones = self._drones_for(_checked(request, len(self._fleet.drones)), request)
        self._refuse_if_broken()
        if self._mission_task is not None and not self._mission_task.done():
            raise RefusedError("a capture is running; abort it or wait for its end")
        self._recovery.refuse_while_running()
        held = [d for d in drones if self._fleet.drones[d].held]
        if held:
            raise RefusedError(f"{', '.join(held)} held; re-arm first")
        flying = [d for d, drone in self._fleet.drones.items() if drone.airborne]
        if flying:
            raise RefusedError(f"{', '.join(flying)} in the air; land first")
        self.calibrations.end_for("capture", "a capture begins")
        run = RunFolder.create(self._runs, request.name)
        self._standing.clear()
        self._begin_unwatched()
        self._pointing.begin_capture()
        self._priorities.begin_capture()
        self._mission = Mission(request, drones, run, self._tools)
        record = CaptureRecord(request, self._mission.status(), datetime.now(UTC), None)
        self._records[run.id] = record
        self._mission_task = asyncio.create_task(self._mission.run(), name=f"mission {run.id}")
        self._mission_task.add_done_callback(lambda _: self._end_capture())
        self._recording_task = self._record(run, request, self._mission_task)
        self.events.publish(record.status)
        return record

    def _begin_unwatched(self) -> None:
        """Count nobody's absence from here on, unless a drone is in the air already.

        Whoever was in command of an earlier flight need not be there for this one: a console in
        command gives its next sign of life within seconds.
        """
        if not any(drone.airborne for drone in self._fleet.drones.values()):
            self._fleet.forget_operator()

    def _record(
        self, run: RunFolder, request: CaptureRequest, flight: asyncio.Task[None]
    ) -> asyncio.Task[None] | None:
        """Begin to record a capture unless that is switched off."""
        if self._recording is None or not self._recording.enabled:
            return None
        path = run.path / RECORDING
        recording = FlightRecording(path, self.scenery(), self._recording, request)
        return asyncio.create_task(
            record_capture(recording, self.events, flight), name=f"recording {run.id}"
        )

    def scenery(self) -> Scenery:
        """Return what a recording of these drones needs."""
        config = replace(self._config, planner=self._no_go.within(self._config.planner))
        return Scenery(self._fleet, self._eyes, self.events, config)

    def _recording_patience_s(self) -> float:
        return 0.0 if self._recording is None else 2.0 * self._recording.close_s

    def _drones_for(self, count: int, request: CaptureRequest) -> list[str]:
        """Return ``count`` drones in fleet order, those that are ready to fly before others."""
        blocked = {check.drone_id for check in problems(self.preflight(), request.overrides)}
        order = sorted(self._fleet.drones, key=lambda drone_id: drone_id in blocked)
        chosen = set(order[:count])
        return [drone_id for drone_id in self._fleet.drones if drone_id in chosen]

    async def pause_capture(self, capture_id: str) -> CaptureRecord:
        """Hold position and stop the mission's clock; raises UnknownError or RefusedError."""
        return self._act_on(capture_id, lambda mission: mission.pause())

    async def resume_capture(self, capture_id: str) -> CaptureRecord:
        """Go on; of a capture whose console is gone, with its training.

        Raises UnknownError or RefusedError.
        """
        record = self.capture(capture_id)
        self._refuse_if_broken()
        flies = self._mission_task is not None and not self._mission_task.done()
        if not flies or not self._is_current(capture_id):
            if flies:
                raise RefusedError("another capture is running; abort it or wait for its end")
            await self._recovery.resume(record)
            return self._records[capture_id]
        record = self._act_on(capture_id, lambda mission: mission.resume())
        if not self._flying_mission():
            self._begin_unwatched()
        return record

    async def abort_capture(self, capture_id: str) -> CaptureRecord:
        """Land all drones and end; what was taken stays; raises UnknownError or RefusedError."""
        if self._recovery.has(capture_id):
            await self._recovery.cancel(capture_id)
            return self._records[capture_id]
        return self._act_on(capture_id, lambda mission: mission.abort("aborted by the operator"))

    async def add_pictures(self, capture_id: str, count: int) -> CaptureRecord:
        """Want more pictures, where they add most; raises UnknownError or RefusedError."""
        return self._act_on(capture_id, lambda mission: mission.add_pictures(count))

    async def view_field(self, capture_id: str, view: FieldView | None) -> None:
        """See previews of a field from ``view``; raises UnknownError or RefusedError."""
        self.capture(capture_id)
        try:
            if self._recovery.has(capture_id):
                await self._recovery.view_field(capture_id, view)
            elif self._mission is not None and self._is_current(capture_id):
                await self._mission.view_field(view)
            else:
                raise RefusedError("its field is not being trained")
        except (OSError, ValueError) as error:
            raise RefusedError(str(error)) from error

    async def delete_capture(self, capture_id: str) -> None:
        """Delete a capture, its run folder and those of the fields trained anew on it.

        Raises UnknownError or RefusedError.
        """
        folder = Path(self.capture(capture_id).status.run)
        if capture_id in self.live():
            raise RefusedError("this capture is not over; abort it first")
        try:
            await asyncio.to_thread(delete_with_trainings, folder)
        except (OSError, ValueError) as error:
            raise RefusedError(f"not all of it could be deleted: {error}") from error
        finally:
            if not await asyncio.to_thread(folder.exists):
                self.forget(capture_id)

    async def wait_for_capture(self, capture_id: str) -> CaptureRecord:
        """Return the capture's record once it has ended; raises UnknownError."""
        self.capture(capture_id)
        if self._is_current(capture_id):
            assert self._mission_task is not None
            await asyncio.wait([self._mission_task])
        await self._recovery.ended(capture_id)
        return self.capture(capture_id)

    def _is_current(self, capture_id: str) -> bool:
        """Return whether the newest mission of this console is that capture's."""
        return self._mission is not None and self._mission.run_folder.id == capture_id

    def _act_on(self, capture_id: str, act: Any) -> CaptureRecord:
        self.capture(capture_id)
        mission = self._mission
        if mission is None or mission.run_folder.id != capture_id or mission.over:
            raise RefusedError("this capture is not running")
        try:
            act(mission)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        self._keep(mission.status())
        return self._records[capture_id]

    # -- what the operator shows ---------------------------------------------------------------

    def point_out(self, drone_id: str, place: PointedPlace) -> ObjectPointedOut:
        """Say where the object is in a drone's picture; raises UnknownError or RefusedError."""
        self._eye(drone_id)
        return self._pointing.point_out(drone_id, place)

    def search_object(self, drone_id: str) -> None:
        """Let a drone search the object without help again; raises UnknownError."""
        self._eye(drone_id)
        self._pointing.search(drone_id)

    def priorities(self) -> tuple[PriorityPart, ...]:
        """Return the parts of priority as they stand."""
        return self._priorities.parts

    def add_priority(
        self, drone_id: str, drawn: tuple[float, float, float, float], weight: float
    ) -> PriorityPart:
        """Want better pictures of a part; raises UnknownError or RefusedError."""
        self._eye(drone_id)
        if drone_id not in self._observers():
            raise RefusedError(
                f"{drone_id} does not fly in a capture: a part of the object can be marked once"
                " the drones look at it"
            )
        sight = self._pointing.live_sight(drone_id)
        return self._priorities.add(drone_id, drawn, weight, sight.frame.captured_s)

    def drop_priorities(self, part_id: str | None = None) -> None:
        """Forget one part of priority, or all when None; raises UnknownError."""
        self._priorities.drop(part_id)

    def no_go(self) -> tuple[NoGoVolume, ...]:
        """Return the volumes that no drone may enter."""
        return self._no_go.volumes

    async def add_no_go(self, area: Area) -> NoGoVolume:
        """Let no drone enter a column of the room any more; raises RefusedError."""
        return await self._no_go.add(area)

    async def change_no_go(self, volume_id: str, area: Area) -> NoGoVolume:
        """Give a volume another place; raises UnknownError or RefusedError."""
        return await self._no_go.change(volume_id, area)

    async def drop_no_go(self, volume_id: str | None = None) -> None:
        """Forget a volume, or all when None; raises UnknownError or RefusedError."""
        await self._no_go.drop(volume_id)

    def _observers(self) -> tuple[str, ...]:
        return () if self._mission is None else self._mission.observers

    def _end_capture(self) -> None:
        self._pointing.end_capture()

    # -- standing tasks -----------------------------------------------------------------------

    async def _report(self) -> None:
        while True:
            for report in self.drones():
                self.events.publish(report)
            for note in self._fleet.fired:
                if note.number > self._fired:
                    self._fired = note.number
                    self._tell_failsafe(note)
            await asyncio.sleep(_REPORT_S)

    def _tell_failsafe(self, note: FiredNote) -> None:
        fired = note.fired
        row = fired.failsafe
        event = FailsafeFired(
            note.drone_id, row.event, row.threshold, row.action, fired.value, fired.text
        )
        self._failsafes.append(event)
        self.events.publish(event)
        text = f"Failsafe {row.action.replace('_', ' ')}: {fired.text}."
        self.events.publish(Noted("warning", text, note.drone_id))

    async def _watch(self) -> None:
        with self.events.subscribe(1024) as subscription:
            async for event in subscription:
                if isinstance(event, _STANDING):
                    self._standing[type(event)] = event
                if isinstance(event, CaptureChanged):
                    self._keep(event)
                if isinstance(event, Noted | CaptureChanged):
                    self._log(event)

    def _log(self, event: Noted | CaptureChanged) -> None:
        """Write what an operator was told into the run's own log."""
        if isinstance(event, CaptureChanged) and not self._is_current(event.id):
            return
        if self._mission is None or self._mission_task is None or self._mission_task.done():
            return
        fields = dataclasses.asdict(event)
        name = "noted" if isinstance(event, Noted) else "capture_changed"
        self._mission.log({"event": name} | fields | {"at": event.at.isoformat()})

    def _keep(self, status: CaptureChanged) -> None:
        record = self._records.get(status.id)
        if record is not None:
            # None are written in flight, when a slow disk must not hold anything up.
            flies = status.phase in AIRBORNE
            metrics = record.metrics if flies else RunFolder(Path(status.run)).metrics()
            self._records[status.id] = dataclasses.replace(record, status=status, metrics=metrics)

    def _eye(self, drone_id: str) -> Eye:
        try:
            return self._eyes[drone_id]
        except KeyError:
            raise UnknownError(f"there is no drone {drone_id!r}") from None

    def _refuse_if_needed(self) -> None:
        """Raise RefusedError while a capture needs the drones, also on the ground."""
        if self._mission is not None and self._mission.needs_drones:
            raise RefusedError("a capture is running; it flies the drones")

    def _flying_mission(self) -> bool:
        return self._mission is not None and self._mission.airborne


def _now_s() -> float:
    return asyncio.get_running_loop().time()


def _checked(request: CaptureRequest, fleet_size: int) -> int:
    """Return how many drones to use; raises ValueError naming the number that is wrong."""
    count = fleet_size if request.drones is None else request.drones
    if not 1 <= count <= fleet_size:
        raise ValueError(f"drones must be 1 to {fleet_size}, not {count}")
    if not count <= request.pictures <= MOST_PICTURES:
        most = f"{count} (one each) to {MOST_PICTURES}"
        raise ValueError(f"pictures must be {most}, not {request.pictures}")
    if request.train_seconds != 0 and not 1.0 <= request.train_seconds <= 86_400:
        raise ValueError(f"train_seconds must be 0 or 1 to 86400, not {request.train_seconds}")
    for item, reason in request.overrides.items():
        if not 3 <= len(reason.strip()) <= _LONGEST_REASON:
            raise ValueError(f"overrides.{item} needs a reason of 3 to {_LONGEST_REASON} letters")
    if request.mode not in ("optimized", "standard"):
        raise ValueError(f"mode must be optimized or standard, not {request.mode}")
    return count


def _records_on_disk(runs: Path) -> dict[str, CaptureRecord]:
    """Return the captures that earlier programs left; one that was running is interrupted."""
    records: dict[str, CaptureRecord] = {}
    for run in list_runs(runs):
        state = run.state()
        if state is None:
            logger.warning("%s has no readable capture.json", run.path)
            continue
        try:
            records[run.id] = _record_of(run, state)
        except (KeyError, TypeError, ValueError, AttributeError):
            # One strange folder must not keep the console, and its stops, from starting.
            logger.warning("%s has a capture.json of another kind", run.path, exc_info=True)
    return records


def _record_of(run: RunFolder, state: Mapping[str, Any]) -> CaptureRecord:
    """Return what ``capture.json`` holds; raises what a strange one leads to."""
    status = dict(state["status"])
    if status["state"] in ("queued", "running", "paused"):
        status |= {"state": "interrupted", "error": "the console ended while it was running"}
    status |= {"run": str(run.path), "at": datetime.fromisoformat(status["at"])}
    return CaptureRecord(
        CaptureRequest(**state["request"]),
        CaptureChanged(**status),
        datetime.fromisoformat(state["started_at"]),
        run.metrics(),
    )
