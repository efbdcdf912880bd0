"""Collects views of a board from the live video of a drone that is held in the hand.

Sent are ``command`` (also to keep the drone awake), ``port`` where the fleet file asks for it,
``streamon`` and, if it was off before, ``streamoff``: nothing that moves. The motors must stand
still, before and all the while. A drone known by its serial number alone is searched for first.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import replace

from server.doctor.config import DoctorConfig, LiveConfig
from server.doctor.ears import Ears, ask, move_ports
from server.doctor.network import console_of
from server.mission.board_views import GatherConfig, gather_views
from server.stages import Frame, Telemetry
from server.swarm.config import DroneConfig, FleetConfig
from server.swarm.ports import LinkError
from server.swarm.protocol import ProtocolError, decode_state
from server.swarm.station import find_stations
from server.swarm.video import VideoDecoder
from server.vision.calibration_board import BoardFinder, BoardView
from server.vision.calibration_views import Picked, ViewPicker

_FRAME_WAIT_S = 1.0


class LiveViewsError(Exception):
    """Views cannot be collected; the text is one line that says why and what to do."""


class _Stream:
    """What a drone sends: its newest whole picture and whether its motors run."""

    def __init__(self, drone: DroneConfig) -> None:
        self.newest: Frame | None = None
        self.arrived = asyncio.Event()
        self.reports = 0
        self.video_s = 0.0
        self.has_video = False
        self.runs_since_s: float | None = None
        self._drone = drone
        self._before: Telemetry | None = None

    def take_state(self, datagram: bytes, arrived_s: float) -> None:
        try:
            telemetry = decode_state(datagram, self._drone.id, arrived_s)
        except ProtocolError:
            return
        self.reports += 1
        if self._before is not None and telemetry.motor_time_s > self._before.motor_time_s:
            self.runs_since_s = arrived_s
        self._before = telemetry

    def take_frame(self, frame: Frame) -> None:
        if not frame.damaged:
            self.newest = frame
            self.arrived.set()

    def refuse_flight(self) -> None:
        if self.runs_since_s is not None:
            raise LiveViewsError(
                f"the motors of {self._drone.id} run: land it first, a camera is calibrated by hand"
            )


async def find_drone(drone: DroneConfig, fleet: FleetConfig) -> DroneConfig:
    """Return a drone with its address, which is searched for where the fleet file has none.

    Args:
        drone: Known by its address or by its serial number.
        fleet: Whose it is; says which network is searched.

    Raises:
        LiveViewsError: If no drone in the network has its serial number, or none may be asked.
    """
    if drone.address:
        return drone
    console = console_of(fleet.drones)
    if console is not None:
        raise LiveViewsError(f"{drone.id} is not searched for: a console has the drones, {console}")
    # Those of the fleet that are known are left alone: they would report here from now on.
    known = [other.address for other in fleet.drones if other.address]
    try:
        found = await find_stations(fleet.station, [drone.serial], through=drone, skip=known)
    except LinkError as error:
        raise LiveViewsError(str(error)) from error
    if drone.serial not in found:
        raise LiveViewsError(
            f"{drone.id}: no drone with the serial number {drone.serial} in"
            f" {fleet.station.subnet}: is it on, and has it joined that network?"
        )
    return replace(drone, address=found[drone.serial])


async def collect_views(
    drone: DroneConfig,
    finder: BoardFinder,
    picker: ViewPicker,
    live: LiveConfig,
    waits: DoctorConfig,
    progress: Callable[[Picked], None],
    stop: asyncio.Event,
) -> list[BoardView]:
    """Collect distinct views until there are enough, ``stop`` is set or nothing new comes.

    Args:
        drone: Whose camera it is, with its address, see ``find_drone``.
        finder: Finds the board.
        picker: Chooses views.
        live: How many, and how patient.
        waits: Waits for replies.
        progress: Told about every picture that was looked at.
        stop: Ends the collection; what was collected counts.

    Raises:
        LiveViewsError: If the drone does not answer or sends no video, its ports are taken, or its
            motors run.
    """
    stream = _Stream(drone)
    async with Ears() as ears, VideoDecoder(drone.id, stream.take_frame) as decoder:

        def take_video(datagram: bytes, arrived_s: float) -> None:
            stream.video_s, stream.has_video = arrived_s, True
            decoder.feed(datagram, arrived_s)

        try:
            await ears.listen(drone, drone.state_port, stream.take_state)
            await ears.listen(drone, drone.video_port, take_video)
        except OSError as error:
            raise LiveViewsError(
                f"the ports of {drone.id} cannot be had ({error.strerror or error}):"
                " is a console running? See dronerf doctor"
            ) from error
        await _begin(drone, stream, live, waits)
        was_on = stream.has_video
        awake = asyncio.create_task(_keep_awake(drone, stream, live, waits), name="keep awake")
        try:
            await gather_views(
                lambda: _next_frame(stream),
                finder,
                picker,
                GatherConfig(live.views, live.patience_s),
                progress,
                stop,
            )
            if stream.newest is None:
                raise LiveViewsError(f"no whole picture of {drone.id} came: see dronerf doctor")
        finally:
            awake.cancel()
            await asyncio.gather(awake, return_exceptions=True)
            if not was_on:
                await ask(drone, "streamoff", tries=waits.tries, wait_s=waits.reply_s)
    return list(picker.views)


async def _begin(
    drone: DroneConfig, stream: _Stream, live: LiveConfig, waits: DoctorConfig
) -> None:
    reply = await ask(drone, "command", tries=waits.tries, wait_s=waits.reply_s)
    if reply is None or reply.kind != "ok":
        raise LiveViewsError(f"{drone.id} does not answer at {drone.address}: see dronerf doctor")
    await move_ports(drone, tries=waits.tries, wait_s=waits.reply_s)
    # Long enough for the drone's count of motor seconds to show whether they run.
    await asyncio.sleep(live.state_wait_s)
    if not stream.reports:
        raise LiveViewsError(
            f"no state reports of {drone.id}, so whether its motors run is not known:"
            " see dronerf doctor"
        )
    stream.refuse_flight()


async def _keep_awake(
    drone: DroneConfig, stream: _Stream, live: LiveConfig, waits: DoctorConfig
) -> None:
    loop = asyncio.get_running_loop()
    while True:
        if loop.time() - stream.video_s > live.video_silence_s:
            await ask(drone, "streamon", tries=1, wait_s=waits.reply_s)
            stream.video_s = max(stream.video_s, loop.time())
        await asyncio.sleep(min(live.keep_alive_s, live.video_silence_s))
        await ask(drone, "command", tries=1, wait_s=waits.reply_s)


async def _next_frame(stream: _Stream) -> Frame | None:
    """Return the next whole picture, None when none comes for a while."""
    stream.refuse_flight()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_FRAME_WAIT_S):
            await stream.arrived.wait()
        stream.arrived.clear()
        return stream.newest
    return None
