"""The cameras' calibrations: one at a time, none beside a capture or a flight."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from server.geometry.cameras import Intrinsics
from server.mission.board_views import GatherConfig
from server.mission.calibrating import Calibrating, CameraDrone, EndedError
from server.mission.calibration_record import Applied, CalibrationRecord, Ending
from server.mission.commands import RefusedError, UnknownError
from server.mission.events import EventStream, Level, Noted
from server.store.fleet_edit import write_intrinsics
from server.swarm.fleet_file import FleetFileError
from server.vision.calibration_board import DEFAULT_BOARD, BoardFinder, parse_board
from server.vision.calibration_sheet import SheetForm, encode_sheet
from server.vision.calibration_views import CalibrationConfig, ViewPicker

_BOARD = parse_board(DEFAULT_BOARD)
# Somebody may have to walk to the drone first; and a few pictures a second are enough for views
# that a hand must hold still for.
_GATHERING = GatherConfig(views=25, patience_s=150.0, pause_s=0.12)
# Whoever goes on wants at least so many views more.
_MORE_VIEWS = 6


class CalibratedDrone(CameraDrone, Protocol):
    """A drone whose camera may be replaced by what was found."""

    def calibrate(self, intrinsics: Intrinsics) -> None:
        """Use these intrinsics from now on; not in flight."""
        ...


class Calibrations:
    """The newest calibration of every camera; a ``CalibrationControl``."""

    def __init__(
        self,
        drones: Mapping[str, CalibratedDrone],
        capture_active: Callable[[], bool],
        events: EventStream,
        fleet_file: Path | None = None,
        gathering: GatherConfig = _GATHERING,
    ) -> None:
        """Build it.

        Args:
            drones: The fleet.
            capture_active: Whether a capture goes on, in the air or on the ground.
            events: Where it is told.
            fleet_file: The file the fleet was read from, None without one.
            gathering: How views are collected.
        """
        self._drones = drones
        self._capture_active = capture_active
        self._events = events
        self._fleet_file = fleet_file
        self._gathering = gathering
        self._least = CalibrationConfig().views_least
        self._newest: dict[str, Calibrating] = {}
        self._applied: dict[str, Applied] = {}
        self._writing = asyncio.Lock()

    async def close(self) -> None:
        """End what goes on."""
        for each in self._newest.values():
            each.end("closed", "the console ended")
            await each.ended()

    def end_for(self, ending: Ending, reason: str) -> None:
        """End what goes on: a capture or a flight needs the machine and the drones."""
        for drone_id, each in self._newest.items():
            if not each.over:
                each.end(ending, reason)
                self._tell("warning", f"Calibration ended: {reason}.", drone_id)

    def record(self, drone_id: str) -> CalibrationRecord:
        """Return the newest calibration of a drone's camera; raises UnknownError."""
        self._drone(drone_id)
        newest = self._newest.get(drone_id)
        if newest is None:
            return CalibrationRecord(
                drone_id,
                "idle",
                _BOARD.name,
                ViewPicker().progress(),
                self._gathering.views,
                self._least,
                file=self._fleet_file,
            )
        return CalibrationRecord(
            drone_id,
            newest.state,
            _BOARD.name,
            newest.progress,
            newest.config.views,
            self._least,
            hint=newest.hint,
            spent_s=newest.spent_s,
            lack=newest.lack,
            ending=newest.ending,
            reason=newest.reason,
            result=newest.result,
            applied=self._applied.get(drone_id),
            file=self._fleet_file,
        )

    def start(self, drone_id: str, *, go_on: bool = False) -> CalibrationRecord:
        """Begin to collect views; raises UnknownError or RefusedError."""
        drone = self._drone(drone_id)
        busy = next((name for name, each in self._newest.items() if not each.over), None)
        if busy is not None:
            raise RefusedError(f"the camera of {busy} is being calibrated; finish or cancel that")
        try:
            self._refuse(drone)
        except EndedError as error:
            raise RefusedError(str(error)) from error
        before = self._newest.get(drone_id) if go_on else None
        picker, config, spent_s = ViewPicker(), self._gathering, 0.0
        if before is not None:
            picker, spent_s = before.picker.continued(), before.spent_s
            views = max(config.views, len(picker.views) + _MORE_VIEWS)
            config = replace(config, views=views)
        refuse = functools.partial(self._refuse, drone)
        begun = Calibrating(drone, BoardFinder(_BOARD), picker, config, refuse, spent_s)
        self._newest[drone_id] = begun
        self._applied.pop(drone_id, None)
        begun.begin()
        self._tell("info", "Calibration of its camera begun.", drone_id)
        return self.record(drone_id)

    def finish(self, drone_id: str) -> CalibrationRecord:
        """Solve with the views there are; raises UnknownError or RefusedError."""
        self._drone(drone_id)
        newest = self._newest.get(drone_id)
        if newest is None or newest.over:
            raise RefusedError(f"the camera of {drone_id} is not being calibrated")
        newest.finish()
        return self.record(drone_id)

    def cancel(self, drone_id: str) -> CalibrationRecord:
        """End it without a result, or forget the result; raises UnknownError."""
        self._drone(drone_id)
        newest = self._newest.get(drone_id)
        if newest is not None and not newest.over:
            newest.end("cancelled", "it was cancelled")
            self._tell("info", "Calibration of its camera cancelled.", drone_id)
        elif newest is not None:
            del self._newest[drone_id]
            self._applied.pop(drone_id, None)
        return self.record(drone_id)

    async def apply(self, drone_id: str) -> CalibrationRecord:
        """Use a result from now on; raises UnknownError or RefusedError."""
        drone = self._drone(drone_id)
        newest = self._newest.get(drone_id)
        result = None if newest is None else newest.result
        if result is None:
            raise RefusedError(f"there is no calibration of {drone_id} to use")
        try:
            self._refuse_flight()
        except EndedError as error:
            raise RefusedError(str(error)) from error
        camera = result.calibration.intrinsics
        drone.calibrate(camera)
        applied = Applied()
        if self._fleet_file is not None:
            file = self._fleet_file
            try:
                # Two written at once would each leave the other out.
                async with self._writing:
                    backup = await asyncio.to_thread(
                        write_intrinsics, file, drone_id, camera, result.remark
                    )
                applied = Applied(file, backup)
            except (FleetFileError, OSError) as error:
                applied = Applied(problem=str(error))
        if self._newest.get(drone_id) is newest:
            self._applied[drone_id] = applied
        if applied.problem:
            text = f"Its calibrated camera is in use until the console ends: {applied.problem}."
            self._tell("warning", text, drone_id)
        else:
            where = "" if applied.file is None else f" and written into {applied.file.name}"
            self._tell("info", f"Its calibrated camera is in use{where}.", drone_id)
        return self.record(drone_id)

    def sheet(self, form: SheetForm) -> bytes:
        """Return the board to print; call it in a thread."""
        return _sheet(form)

    def _drone(self, drone_id: str) -> CalibratedDrone:
        try:
            return self._drones[drone_id]
        except KeyError:
            raise UnknownError(f"there is no drone {drone_id!r}") from None

    def _refuse(self, drone: CameraDrone) -> None:
        """Raise EndedError unless the drone stands there and nothing flies or captures."""
        self._refuse_flight()
        drone_id = drone.config.id
        if drone.activity == "offline":
            raise EndedError("offline", f"{drone_id} does not answer: is it on and connected?")
        if drone.activity != "ground":
            raise EndedError("flight", f"{drone_id} is {drone.activity}; re-arm it on the ground")

    def _refuse_flight(self) -> None:
        if self._capture_active():
            raise EndedError("capture", "a capture is active; abort it or wait for its end")
        flying = [name for name, drone in self._drones.items() if drone.airborne]
        if flying:
            raise EndedError("flight", f"{', '.join(flying)} in the air; land first")

    def _tell(self, level: Level, text: str, drone_id: str) -> None:
        self._events.publish(Noted(level, text, drone_id))


@functools.cache
def _sheet(form: SheetForm) -> bytes:
    return encode_sheet(_BOARD, form)
