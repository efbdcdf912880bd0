"""One drone: connection, take-off, setpoints, stops.

Two paths lead to the machine. Ordinary commands wait for their reply, one at a time. The stops
``hold``, ``land_now`` and ``cut_motors`` write their datagrams before they return and take no lock,
no queue and no notice of what else is pending. CUT beats LAND, LAND beats HOLD. Each is sent
several times at once; LAND and CUT then go on until state reports show the motors standing, and a
drone that is seen to fly although it was believed down is landed again.

All methods are called on the event loop. The beat, one task per drone, holds it against the
failsafe table and sends ``rc`` 20 times a second in the air; a setpoint that is not renewed turns
into hover.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

from server.geometry.cameras import Intrinsics
from server.stages import Frame, Setpoint, Telemetry
from server.swarm.asking import Asking
from server.swarm.config import DroneConfig, SafetyConfig, TimingConfig
from server.swarm.connection import Connection
from server.swarm.errors import DroneError
from server.swarm.facts import DroneFacts
from server.swarm.failsafes import Fired, FlightReadings
from server.swarm.flight import Flight
from server.swarm.flight_watch import Activity
from server.swarm.link import DroneLink
from server.swarm.pictures import DecoderMaker, Pictures
from server.swarm.protocol import ProtocolError, decode_state
from server.swarm.safety import Verdict, take_off_refusals
from server.swarm.take_off import TakeOff
from server.swarm.tap import Tap
from server.swarm.video import VideoDecoder

_LOG = logging.getLogger(__name__)


def _no_operator() -> float | None:
    return None


class Drone:
    """One drone behind a link; an async context manager.

    Attributes:
        config: Who and where it is.
        bad_states: State reports that could not be read.
    """

    def __init__(
        self,
        config: DroneConfig,
        link: DroneLink,
        safety: SafetyConfig | None = None,
        timing: TimingConfig | None = None,
        clock: Callable[[], float] = time.monotonic,
        *,
        decoder: DecoderMaker = VideoDecoder,
        operator_silence_s: Callable[[], float | None] = _no_operator,
        on_fired: Callable[[str, Fired], None] | None = None,
        on_land_all: Callable[[], None] | None = None,
        tap: Tap | None = None,
    ) -> None:
        """Build it; nothing is opened yet.

        Args:
            config: Who and where it is.
            link: Carries datagrams.
            safety: Limits and failsafe table.
            timing: Times of the driver.
            clock: Monotonic seconds, the same as the link's.
            decoder: Makes what turns video datagrams into frames.
            operator_silence_s: Seconds without a sign of the operator; None while none is attached.
            on_fired: Called with the drone's id when a row of the failsafe table begins to fire.
            on_land_all: Lands the whole fleet; without it this drone lands alone.
            tap: Is told of every datagram and report.
        """
        self.config = config
        self.bad_states = 0
        self._link = link
        self._safety = safety if safety is not None else SafetyConfig()
        self._timing = timing = timing if timing is not None else TimingConfig()
        self._clock = clock
        self._tap = tap if tap is not None else Tap()
        self._operator_silence_s = operator_silence_s
        self._asking = Asking(config.id, self._send, clock, timing)
        self._pictures = Pictures(config.id, clock, decoder)
        self._connection = Connection(config, self._asking, self._pictures, clock, timing)
        self._flight = Flight(
            config.id,
            self._asking,
            self._send,
            clock,
            self._safety,
            timing,
            on_fired,
            on_land_all,
        )
        self._take_off = TakeOff(self._flight, self._asking, clock, timing, config.edu)
        self._state_arrived = asyncio.Event()
        self._sent_s = 0.0
        self._beating: asyncio.Task[None] | None = None

    # Life ------------------------------------------------------------------------------------

    async def __aenter__(self) -> Drone:
        await self._link.open(self._take_reply, self._take_state, self._take_video)
        await self._pictures.open()
        self._beating = asyncio.create_task(self._beat_on(), name=f"beat {self.config.id}")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Land if need be, wait for it (not for ever), and let go of link and decoder."""
        try:
            await self._come_to_rest()
        finally:
            if self._beating is not None:
                self._beating.cancel()
                await asyncio.gather(self._beating, return_exceptions=True)
            await self._connection.close()
            self._flight.orders.burst.cancel()
            await self._pictures.close()
            self._link.close()

    async def _come_to_rest(self) -> None:
        # Nobody will steer it any more. Leaving must never end with a drone in the air.
        flight = self._flight
        if flight.doing == "cut":
            await self._wait_until(flight.orders.stands_since_cut, 3.0)
        elif flight.airborne or flight.watch.motors_run():
            self.land_now()
            try:
                await self._until_landed(self._timing.land_s / 2)
            except DroneError as error:
                _LOG.error("%s", error)

    # What is known ---------------------------------------------------------------------------

    @property
    def telemetry(self) -> Telemetry | None:
        """Newest state report, None before the first."""
        return self._flight.telemetry

    @property
    def activity(self) -> Activity:
        """What the drone is doing, as far as is known."""
        return self._flight.activity

    @property
    def airborne(self) -> bool:
        """True from the order to take off until it has surely landed."""
        return self._flight.airborne

    @property
    def stops(self) -> int:
        """How often it was stopped so far, in the air or on the ground."""
        return self._flight.stops

    @property
    def held(self) -> bool:
        """True while HOLD is latched: setpoints and take-off are refused until ``rearm``."""
        return self._flight.held

    @property
    def facts(self) -> DroneFacts:
        """What it told of itself when asked."""
        return self._connection.facts

    @property
    def answers(self) -> bool:
        """Whether it has answered our commands, with or without reporting its state."""
        return self._connection.answers

    @property
    def stranger(self) -> str:
        """Why what answers is not this drone, for people; empty when nothing speaks against it."""
        return self._connection.stranger

    @property
    def hears(self) -> bool:
        """False while a drone in flight has not answered for longer than a lost datagram takes."""
        age_s = self.link_age_s
        return age_s is None or age_s < self._timing.deaf_s

    @property
    def link_age_s(self) -> float | None:
        """Seconds since it last answered, None before it has answered in this flight."""
        return self._connection.link_age_s(self._clock())

    @property
    def dropped(self) -> Mapping[str, int]:
        """Datagrams that said nothing, by reason."""
        channel = self._asking.channel
        return {
            "garbage": channel.garbage,
            "stray_reply": channel.discarded,
            "bad_state": self.bad_states,
        }

    @property
    def unsent(self) -> int:
        """Datagrams that could not be handed to the network."""
        return self._link.unsent

    @property
    def fired(self) -> tuple[Fired, ...]:
        """The rows of the failsafe table that fire now, the strongest action first."""
        return self._flight.sentry.fired

    @property
    def verdict(self) -> Verdict:
        """What the failsafe table demanded at the last beat."""
        return self._flight.sentry.verdict

    @property
    def newest_frame(self) -> Frame | None:
        """Newest decoded picture, None before the first."""
        return self._pictures.newest

    @property
    def video_fps(self) -> float:
        """Decoded pictures per second over the last seconds."""
        return self._pictures.fps

    @property
    def video_wanted(self) -> bool:
        """False while the video is off on purpose; True also before anything was heard of it."""
        return self._connection.video_wanted or self.newest_frame is None

    async def next_frame(self, after: int) -> Frame:
        """Return the newest picture whose sequence exceeds ``after``, waiting for one if need be.

        Raises:
            DroneError: If the drone is closed meanwhile.
        """
        return await self._pictures.next(after)

    async def next_in_order(self) -> Frame:
        """Return the next picture that was not returned yet; for one reader alone.

        Who reads too slowly loses pictures, see ``pictures_skipped``.

        Raises:
            DroneError: If the drone is closed meanwhile.
        """
        return await self._pictures.next_in_order()

    @property
    def pictures_skipped(self) -> int:
        """Pictures that the reader of ``next_in_order`` was too slow for."""
        return self._pictures.skipped

    @property
    def video_overflows(self) -> int:
        """Times all video that waited to be decoded was dropped, because decoding was too late."""
        return self._pictures.overflows

    def observe_flight(self, readings: FlightReadings, now_s: float) -> None:
        """Take what the pilot believes of this drone; due many times a second while it is flown.

        Once called in a flight, its absence counts as ``mission_silence_s``.
        """
        self._flight.sentry.observe_flight(readings, now_s)

    # Ordinary commands -----------------------------------------------------------------------

    async def connect(self) -> None:
        """Enter SDK mode and start the video; repeated until answered, so bound it by a timeout.

        Raises:
            DroneError: If another drone than the configured one answers.
        """
        await self._connection.enter()
        await self._state_arrived.wait()
        _LOG.info("%s: connected at %s", self.config.id, self.config.address or "a found address")

    def calibrate(self, intrinsics: Intrinsics) -> None:
        """Take this for its camera from now on.

        Raises:
            DroneError: If it is in the air: pictures and poses of a flight are of one camera.
        """
        self._refuse_unless(not self.airborne, "in the air, its camera stays as it is")
        self.config = replace(self.config, intrinsics=intrinsics)

    def set_video(self, on: bool) -> None:
        """Turn the video on or off; off keeps a drone that stands still from overheating."""
        self._connection.set_video(on)

    async def take_off(self, overriding: frozenset[str] = frozenset()) -> None:
        """Take off and wait until the drone hovers; the order is carried out at most once.

        Args:
            overriding: Names of refusals that an operator overrides, see ``take_off_refusals``.

        Raises:
            DroneError: If it is refused (held, cut, not on the ground, safety rules, the drone's
                own error), stopped on the way, or not seen to rise.
        """
        reason = self._reason_to_stay(overriding)
        self._refuse_unless(not reason, reason)
        if not self._connection.video_wanted:
            # Off since its last landing; without pictures nothing would correct its pose.
            self.set_video(True)
        try:
            await self._take_off(lambda: self._reason_to_stay(overriding))
        except DroneError as error:
            raise DroneError(f"{self.config.id}: {error}") from error

    def _reason_to_stay(self, overriding: frozenset[str]) -> str:
        """Return why it must not take off now, empty when it may."""
        if self.held:
            return "held, re-arm it first"
        if self._flight.doing != "ground":
            return f"cannot take off, it is {self._flight.doing}"
        if self.stranger:
            return self.stranger
        for refusal in take_off_refusals(self.telemetry, self._clock(), self._safety):
            if refusal.final or refusal.name not in overriding:
                return f"must not take off: {refusal.text}"
        return ""

    async def land(self) -> None:
        """Land and wait until the drone is down.

        Raises:
            DroneError: If it is not seen to be down in time; the order goes on being repeated.
        """
        self.land_now()
        await self._until_landed(self._timing.land_s)

    def set_setpoint(self, setpoint: Setpoint, now_s: float) -> bool:
        """Set what the drone shall do from now on, for at most ``setpoint_life_s``.

        Returns:
            False when it is refused: held, cut, landing, not flying, or not finite.
        """
        return self._flight.set_setpoint(setpoint, now_s)

    def rearm(self) -> None:
        """Release HOLD and CUT; a drone in the air goes on hovering until a setpoint comes."""
        self._flight.rearm()

    # Stops -----------------------------------------------------------------------------------

    def hold(self) -> None:
        """Hover at once and refuse motion until ``rearm``. Does not disturb a landing."""
        self._flight.hold()

    def land_now(self) -> None:
        """Order the landing at once; it is repeated until the drone is seen to be down."""
        self._flight.land_now()

    def cut_motors(self) -> None:
        """Stop the motors at once: the drone falls. Nothing moves it until ``rearm``.

        Repeated until state reports show the motors standing.
        """
        self._flight.cut_motors()

    # Datagrams -------------------------------------------------------------------------------

    def _take_reply(self, datagram: bytes, arrived_s: float) -> None:
        if self._flight.doing == "landing":
            self._flight.orders.observe_reply(datagram, arrived_s)
        self._asking.receive(datagram, arrived_s)
        self._tap.replied(self.config.id, datagram, arrived_s)

    def _take_state(self, datagram: bytes, arrived_s: float) -> None:
        try:
            telemetry = decode_state(datagram, self.config.id, arrived_s)
        except ProtocolError as error:
            self.bad_states += 1
            _LOG.debug("%s: %s", self.config.id, error)
            return
        self._connection.observe_state(telemetry)
        self._flight.observe_state(telemetry)
        self._state_arrived.set()
        self._tap.reported(telemetry, self.activity)

    def _take_video(self, datagram: bytes, arrived_s: float) -> None:
        self._pictures.feed(datagram, arrived_s)
        self._tap.filmed(self.config.id, datagram, arrived_s)

    def _send(self, datagram: bytes) -> None:
        self._sent_s = self._clock()
        self._link.send(datagram)
        self._tap.sent(self.config.id, datagram, self._sent_s)

    # The beat --------------------------------------------------------------------------------

    async def _beat_on(self) -> None:
        while True:
            try:
                self._beat(self._clock())
            except Exception:  # noqa: BLE001  # The beat keeps a flying drone in check: it must go on.
                _LOG.exception("%s: a beat failed", self.config.id)
            await asyncio.sleep(self._timing.beat_s)

    def _beat(self, now_s: float) -> None:
        self._flight.beat(
            now_s,
            self._connection.link_age_s(now_s),
            self._pictures.age_s(now_s),
            self._operator_silence_s(),
        )
        doing, silent_s = self._flight.doing, now_s - self._sent_s
        self._connection.beat(now_s, doing, silent_s, self._flight.state_age_s(now_s))

    async def _until_landed(self, timeout_s: float) -> None:
        await self._wait_until(lambda: not self.airborne, timeout_s)
        self._refuse_unless(not self.airborne, "not seen to land")

    async def _wait_until(self, holds: Callable[[], bool], timeout_s: float) -> None:
        deadline_s = self._clock() + timeout_s
        while not holds() and self._clock() < deadline_s:  # noqa: ASYNC110
            await asyncio.sleep(self._timing.beat_s)

    def _refuse_unless(self, holds: bool, reason: str) -> None:
        if not holds:
            raise DroneError(f"{self.config.id}: {reason}")
