"""One drone: connection, take-off, setpoints, stops.

Two paths lead to the machine. Ordinary commands wait for their reply, one at a time. The stops
``hold``, ``land_now`` and ``cut_motors`` write their datagrams before they return and take no lock,
no queue and no notice of what else is pending. CUT beats LAND, LAND beats HOLD. Each is sent
several times at once; LAND and CUT then go on until state reports show the motors standing, and a
drone that is seen to fly although it was believed down is landed again.

All methods are called on the event loop. The beat, one task per drone, sends ``rc`` 20 times a
second in the air; a setpoint that is not renewed turns into hover.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable

from server.stages import HOVER, Frame, Setpoint, Telemetry
from server.swarm.burst import Burst
from server.swarm.config import DroneConfig, SafetyConfig, TimingConfig
from server.swarm.flight_watch import Activity, FlightWatch
from server.swarm.link import DroneLink
from server.swarm.protocol import (
    CommandChannel,
    ProtocolError,
    Reply,
    decode_state,
    encode_command,
    encode_rc,
    rc_from_setpoint,
)
from server.swarm.safety import FINE, Verdict, judge_telemetry, refuse_take_off
from server.swarm.video import VideoDecoder

_LOG = logging.getLogger(__name__)

_STILL = encode_rc((0, 0, 0, 0))
_STOP = encode_command("stop")
_LAND = encode_command("land")
_EMERGENCY = encode_command("emergency")

# How long a reply of a stop or of a command given up may still come.
_STRAY_S = 1.0
_FPS_WINDOW_S = 3.0
# A drone believed on the ground whose motor clock goes on after this flies, however low.
_SPIN_DOWN_S = 1.2
# For so long after its order a take-off may still be under way; it refuses all but ``stop``.
_CLIMB_S = 8.0
# Faster downward than this, a drone has taken the order to land.
_SINKING_M_S = 0.1
_AIRBORNE: tuple[Activity, ...] = ("taking_off", "flying", "holding", "landing")


class DroneError(Exception):
    """A drone refused or did not do what it was told; the text says which and why."""


class Drone:
    """One drone behind a link; an async context manager.

    Attributes:
        config: Who and where it is.
        telemetry: Newest state report, None before the first.
        newest_frame: Newest decoded picture, None before the first.
        held: True while HOLD is latched: setpoints and take-off are refused until ``rearm``.
        verdict: What the safety rules demanded at the last beat.
        bad_states: State reports that could not be read.
    """

    def __init__(
        self,
        config: DroneConfig,
        link: DroneLink,
        safety: SafetyConfig | None = None,
        timing: TimingConfig | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.config = config
        self.telemetry: Telemetry | None = None
        self.newest_frame: Frame | None = None
        self.held = False
        self.verdict: Verdict = FINE
        self.bad_states = 0
        self._link = link
        self._safety = safety if safety is not None else SafetyConfig()
        self._timing = timing if timing is not None else TimingConfig()
        self._clock = clock
        self._channel = CommandChannel()
        self._answer: asyncio.Future[Reply] | None = None
        self._asking = asyncio.Lock()
        self._decoder = VideoDecoder(config.id, self._take_frame)
        self._watch = FlightWatch()
        self._activity: Activity = "offline"
        self._setpoint: tuple[Setpoint, float] = (HOVER, -1e9)
        self._frame_times: deque[float] = deque(maxlen=128)
        self._frame_arrived = asyncio.Event()
        self._state_arrived = asyncio.Event()
        self._burst = Burst(self._send, self._timing.stop_repeats_s)
        self._stops = 0  # Counts stops; whoever waits sees by it that one came.
        self._airborne_s = 0.0
        self._grounded_s = 0.0
        self._climbs_until_s = -1e9
        self._ordered_down = False  # The newest order was to land.
        self._landing_s = 0.0
        self._land_sent_s = 0.0
        self._land_answered = False
        self._cut_s = 0.0
        self._cut_sent_s = 0.0
        self._sent_s = 0.0
        self._video_s = 0.0
        self._stream_sent_s = 0.0
        self._linked = False
        self._streaming = False
        self._tasks: list[asyncio.Task[None]] = []
        self._closed = False

    # Life ------------------------------------------------------------------------------------

    async def __aenter__(self) -> Drone:
        await self._link.open(self._take_reply, self._take_state, self._take_video)
        await self._decoder.__aenter__()
        self._tasks.append(asyncio.create_task(self._beat_on(), name=f"beat {self.config.id}"))
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Land if need be, wait for it (not for ever), and let go of link and decoder."""
        try:
            await self._come_to_rest()
        finally:
            self._closed = True
            self._frame_arrived.set()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
            self._burst.cancel()
            await self._decoder.__aexit__()
            self._link.close()

    async def _come_to_rest(self) -> None:
        # Nobody will steer it any more. Leaving must never end with a drone in the air.
        if self._activity == "cut":
            await self._wait_until(self._stands_since_cut, 3.0)
        elif self.airborne or self._watch.motors_run():
            self.land_now()
            try:
                await self._until_landed(self._timing.land_s / 2)
            except DroneError as error:
                _LOG.error("%s", error)

    # What is known ---------------------------------------------------------------------------

    @property
    def activity(self) -> Activity:
        """What the drone is doing, as far as is known."""
        if self._activity == "flying" and (self.held or self.verdict.action == "hold"):
            return "holding"
        return self._activity

    @property
    def airborne(self) -> bool:
        """True from the order to take off until it has surely landed."""
        return self._activity in _AIRBORNE

    @property
    def video_fps(self) -> float:
        """Decoded pictures per second over the last seconds."""
        since_s = self._clock() - _FPS_WINDOW_S
        return sum(at_s > since_s for at_s in self._frame_times) / _FPS_WINDOW_S

    async def next_frame(self, after: int) -> Frame:
        """Return the newest picture whose sequence exceeds ``after``, waiting for one if need be.

        Raises:
            DroneError: If the drone is closed meanwhile.
        """
        while self.newest_frame is None or self.newest_frame.sequence <= after:
            if self._closed:
                raise DroneError(f"{self.config.id}: closed")
            await self._frame_arrived.wait()
        return self.newest_frame

    # Ordinary commands -----------------------------------------------------------------------

    async def connect(self) -> None:
        """Enter SDK mode and start the video; repeated until answered, so bound it by a timeout."""
        await self._ask_until_ok("command")
        self._linked = True
        await self._ask_until_ok("streamon")
        self._streaming = True
        self._video_s = self._clock()
        await self._state_arrived.wait()
        _LOG.info("%s: connected at %s", self.config.id, self.config.address)

    def set_video(self, on: bool) -> None:
        """Turn the video on or off; off keeps a drone that stands still from overheating."""
        self._streaming = on
        self._stream_sent_s = self._video_s = self._clock()
        self._send_unanswered("streamon" if on else "streamoff")

    async def take_off(self) -> None:
        """Take off and wait until the drone hovers.

        The order is sent once: a repeat could start a drone again that somebody has just landed.
        Whether it was carried out is read from the state reports when the reply is lost.

        Raises:
            DroneError: If it is refused (held, cut, not on the ground, safety rules, the drone's
                own error), stopped on the way, or not seen to rise.
        """
        self._refuse_unless(not self.held, "held, re-arm it first")
        self._refuse_unless(self._activity == "ground", f"cannot take off, it is {self._activity}")
        reason = refuse_take_off(self.telemetry, self._clock(), self._safety)
        self._refuse_unless(reason is None, f"must not take off: {reason}")
        # LAND and HOLD may leave no trace in a drone on the ground, so they are counted.
        stops = self._stops
        async with self._asking:
            self._refuse_unless(self._stops == stops, "stopped before take-off")
            self._refuse_unless(self._activity == "ground", f"it is {self._activity} by now")
            try:
                reply = await self._climb()
                self._refuse_unless(self._stops == stops, "stopped during take-off")
                if reply is not None and reply.kind == "error" and not self._watch.is_up():
                    self._refuse_unless(False, f"refused to take off: {reply.text}")
                # An "ok" of a drone that stayed on the ground has been seen: believe the height.
                await self._wait_until(lambda: self._watch.is_up() or self._stops != stops, 3.0)
                self._refuse_unless(self._stops == stops, "stopped during take-off")
                self._refuse_unless(self._watch.is_up(), "not seen to take off")
                self._climbs_until_s = -1e9
                self._activity = "flying"
            finally:
                # However this ended, a drone whose motors run is steered: the beat makes it hover.
                if self._activity == "taking_off":
                    self._activity = "flying"
                    self._ground_unless_motors_run()

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
        if self.held or self._activity != "flying":
            return False
        try:
            rc_from_setpoint(setpoint)
        except ProtocolError:
            _LOG.warning("%s: setpoint refused: %s", self.config.id, setpoint)
            return False
        # A date in the future would make it outlive its renewal.
        self._setpoint = (setpoint, min(now_s, self._clock()))
        return True

    def rearm(self) -> None:
        """Release HOLD and CUT; a drone in the air goes on hovering until a setpoint comes."""
        self.held = False
        self._setpoint = (HOVER, -1e9)
        if self._activity == "cut":
            self._burst.cancel()
            self._believe_grounded()

    # Stops -----------------------------------------------------------------------------------

    def hold(self) -> None:
        """Hover at once and refuse motion until ``rearm``. Does not disturb a landing."""
        self.held = True
        self._stops += 1
        self._setpoint = (HOVER, -1e9)
        if self._activity in ("landing", "cut"):
            return
        if self._activity == "taking_off":
            self._activity = "flying"
        self._give_up_command()
        self._owe_burst()
        self._burst.send((_STILL, _STOP))

    def land_now(self) -> None:
        """Order the landing at once; it is repeated until the drone is seen to be down."""
        self._stops += 1
        if self._activity == "cut":
            return
        self._setpoint = (HOVER, -1e9)
        self._ordered_down = True
        now_s = self._clock()
        if self._activity != "landing":
            self._landing_s = now_s
            self._land_answered = False
        # Even a drone believed to be on the ground is told: the belief may be wrong.
        if self._activity not in ("ground", "offline"):
            self._activity = "landing"
        self._give_up_command()
        self._land_sent_s = now_s
        self._owe_burst()
        self._burst.send((_STILL, *self._land_datagrams(now_s)))

    def cut_motors(self) -> None:
        """Stop the motors at once: the drone falls. Nothing moves it until ``rearm``.

        Repeated until state reports show the motors standing.
        """
        self._stops += 1
        self._activity = "cut"
        self._setpoint = (HOVER, -1e9)
        self._cut_s = self._cut_sent_s = self._clock()
        self._give_up_command()
        self._owe_burst()
        self._burst.send((_EMERGENCY,))

    def _land_datagrams(self, now_s: float) -> tuple[bytes, ...]:
        # A drone refuses a motion command while another one, here a take-off, is under way.
        return (_STOP, _LAND) if now_s < self._climbs_until_s else (_LAND,)

    def _owe_burst(self) -> None:
        patience_s = self._timing.stop_repeats_s[-1] + _STRAY_S
        self._channel.owe(self._clock(), patience_s, 1 + len(self._timing.stop_repeats_s))

    def _give_up_command(self) -> None:
        self._channel.give_up(self._clock(), _STRAY_S)
        if self._answer is not None and not self._answer.done():
            self._answer.cancel()

    # Datagrams in ----------------------------------------------------------------------------

    def _take_reply(self, datagram: bytes, arrived_s: float) -> None:
        late_enough = arrived_s - self._landing_s > _STRAY_S
        if self._activity == "landing" and late_enough and b"ok" in datagram.lower():
            # Perhaps another command's: the landing is believed only together with the height.
            self._land_answered = True
        reply = self._channel.receive(datagram, arrived_s)
        if reply is not None and self._answer is not None and not self._answer.done():
            self._answer.set_result(reply)

    def _take_state(self, datagram: bytes, arrived_s: float) -> None:
        try:
            self.telemetry = decode_state(datagram, self.config.id, arrived_s)
        except ProtocolError as error:
            self.bad_states += 1
            _LOG.debug("%s: %s", self.config.id, error)
            return
        self._watch.observe(self.telemetry)
        self._state_arrived.set()
        if self.telemetry.velocity_m_s[2] < -_SINKING_M_S:
            self._climbs_until_s = -1e9
        if self._activity == "offline":
            self._believe_grounded()
        if self._activity == "ground" and self._flies_after_all():
            self._activity = "flying"
            self._airborne_s = arrived_s
            if self._ordered_down:
                _LOG.warning("%s: is in the air after landing, it lands again", self.config.id)
                self.land_now()
            else:
                # Left over from before, or a late take-off.
                _LOG.warning("%s: is in the air, it is made to hover", self.config.id)

    def _take_video(self, datagram: bytes, arrived_s: float) -> None:
        self._video_s = arrived_s
        self._decoder.feed(datagram, arrived_s)

    def _take_frame(self, frame: Frame) -> None:
        self.newest_frame = frame
        self._frame_times.append(self._clock())
        self._frame_arrived.set()
        self._frame_arrived = asyncio.Event()

    # Datagrams out ---------------------------------------------------------------------------

    def _send(self, datagram: bytes) -> None:
        self._sent_s = self._clock()
        self._link.send(datagram)

    def _send_unanswered(self, text: str) -> None:
        """Send a harmless command whose reply nobody waits for."""
        self._send_past_channel(encode_command(text))

    def _send_past_channel(self, *datagrams: bytes) -> None:
        for datagram in datagrams:
            self._send(datagram)
            self._channel.owe(self._clock(), _STRAY_S)

    async def _climb(self) -> Reply | None:
        """Order the take-off and return its reply, None when it is lost or a stop came."""
        self._burst.cancel()
        self._setpoint = (HOVER, -1e9)
        self._activity = "taking_off"
        self._ordered_down = False
        begun_s = self._airborne_s = self._clock()
        self._climbs_until_s = begun_s + _CLIMB_S
        self._send(_STILL)  # Sticks survive a landing; an old deflection must not fly on.
        return await self._exchange(
            "takeoff", self._timing.take_off_s, lambda: self._take_off_settled(begun_s)
        )

    async def _exchange(
        self,
        text: str,
        timeout_s: float,
        settled: Callable[[], bool] | None = None,
        patience_s: float = _STRAY_S,
    ) -> Reply | None:
        """Send a command once and return its reply; None on timeout, stop or ``settled()``.

        For ``patience_s`` after the wait one reply is taken for a late answer to this command.
        """
        datagram = self._channel.begin(text)
        epoch = self._channel.epoch
        answer = asyncio.get_running_loop().create_future()
        self._answer = answer
        self._send(datagram)
        deadline_s = self._clock() + timeout_s
        try:
            while not answer.done() and self._clock() < deadline_s:
                if settled is not None and settled():
                    break
                await asyncio.wait((answer,), timeout=self._timing.beat_s)
            return answer.result() if answer.done() and not answer.cancelled() else None
        finally:
            self._answer = None
            if self._channel.epoch == epoch:
                self._channel.give_up(self._clock(), patience_s)

    async def _ask_until_ok(self, text: str) -> None:
        """Send a command that may be carried out twice until it is answered with ok."""
        unanswered = 0
        async with self._asking:
            while True:
                # A late answer is as good as a prompt one. Were it dropped, each answer would be
                # taken for that of the attempt before, and none ever for its own.
                reply = await self._exchange(text, self._timing.retry_s, patience_s=0.0)
                if reply is not None and reply.kind == "ok":
                    self._channel.owe(self._clock(), _STRAY_S, unanswered)
                    return
                unanswered += reply is None
                if reply is not None:
                    _LOG.warning("%s: answers %s to %s", self.config.id, reply.text, text)
                    await asyncio.sleep(self._timing.retry_s)

    # The beat --------------------------------------------------------------------------------

    async def _beat_on(self) -> None:
        while True:
            try:
                self._beat(self._clock())
            except Exception:  # noqa: BLE001  # The beat keeps a flying drone in check: it must go on.
                _LOG.exception("%s: a beat failed", self.config.id)
            await asyncio.sleep(self._timing.beat_s)

    def _beat(self, now_s: float) -> None:
        self._apply_rules(now_s)
        match self._activity:
            case "flying":
                if self._watch.is_down() and self._watch.motors_idle_since(self._airborne_s):
                    _LOG.warning("%s: stands on the ground", self.config.id)
                    self._believe_grounded()
                else:
                    self._send(encode_rc(self._sticks(now_s)))
            case "landing":
                if self._has_landed(now_s):
                    self._believe_grounded()
                elif now_s - self._land_sent_s >= self._timing.land_repeat_s:
                    self._land_sent_s = now_s
                    self._send_past_channel(*self._land_datagrams(now_s))
            case "taking_off":
                pass  # Nothing may disturb it; it is far shorter than the drone's 15 s of patience.
            case "cut" if not self._stands_since_cut():
                if now_s - self._cut_sent_s >= self._timing.cut_repeat_s:
                    self._cut_sent_s = now_s
                    self._send_past_channel(_EMERGENCY)
            case "ground" | "offline" | "cut":
                self._keep_alive(now_s)
        self._revive_video(now_s)

    def _revive_video(self, now_s: float) -> None:
        # Neither a take-off nor a landing is disturbed for the sake of pictures.
        if not self._streaming or self._activity in ("taking_off", "landing"):
            return
        silent_s = now_s - max(self._video_s, self._stream_sent_s)
        if silent_s > self._timing.video_silence_s:
            self._stream_sent_s = now_s
            self._send_unanswered("streamon")

    def _apply_rules(self, now_s: float) -> None:
        if self._activity not in ("taking_off", "flying"):
            self.verdict = FINE
            return
        verdict = judge_telemetry(self.telemetry, now_s, self._safety)
        if verdict.action != self.verdict.action and verdict.action != "none":
            _LOG.warning("%s: %s: %s", self.config.id, verdict.action, verdict.reason)
        self.verdict = verdict
        if verdict.action == "land":
            self.land_now()

    def _sticks(self, now_s: float) -> tuple[int, int, int, int]:
        setpoint, set_s = self._setpoint
        stale = now_s - set_s > self._timing.setpoint_life_s
        if self.held or stale or self.verdict.action != "none":
            return (0, 0, 0, 0)
        return rc_from_setpoint(setpoint)

    def _keep_alive(self, now_s: float) -> None:
        if not self._linked:
            return
        age_s = None if self.telemetry is None else now_s - self.telemetry.received_s
        if self._activity == "ground" and (age_s is None or age_s > self._safety.state_land_s):
            _LOG.warning("%s: silent", self.config.id)
            self._activity = "offline"
        period_s = (
            self._timing.retry_s if self._activity == "offline" else self._timing.keep_alive_s
        )
        if now_s - self._sent_s >= period_s and not self._asking.locked():
            # It also brings a drone that was switched off and on back into SDK mode.
            self._send_unanswered("command")

    # Conclusions -----------------------------------------------------------------------------

    def _believe_grounded(self) -> None:
        self._activity = "ground"
        self._grounded_s = self._clock()

    def _ground_unless_motors_run(self) -> None:
        if not self._watch.motors_run():
            self._believe_grounded()

    def _flies_after_all(self) -> bool:
        """Return whether a drone believed on the ground turns out to be in the air."""
        if self._watch.is_up() and self._watch.motors_run():
            return True
        return self._watch.motors_ran_after(self._grounded_s + _SPIN_DOWN_S)

    def _stands_since_cut(self) -> bool:
        return self._watch.motors_idle_since(self._cut_s)

    def _take_off_settled(self, begun_s: float) -> bool:
        """Return whether state reports settle a take-off whose reply seems to be lost."""
        if self._clock() - begun_s < 6.0:
            return False
        return self._watch.is_up() or not self._watch.motors_run()

    def _has_landed(self, now_s: float) -> bool:
        telemetry = self.telemetry
        if telemetry is None or now_s - telemetry.received_s > self._safety.state_hold_s:
            return False
        if self._land_answered and self._watch.is_down() and now_s - self._landing_s > 1.0:
            return True
        return self._watch.motors_idle_since(self._landing_s)

    async def _until_landed(self, timeout_s: float) -> None:
        await self._wait_until(lambda: self._activity not in _AIRBORNE, timeout_s)
        if self._activity in _AIRBORNE:
            raise DroneError(f"{self.config.id}: not seen to land")

    async def _wait_until(self, holds: Callable[[], bool], timeout_s: float) -> None:
        deadline_s = self._clock() + timeout_s
        while not holds() and self._clock() < deadline_s:  # noqa: ASYNC110
            await asyncio.sleep(self._timing.beat_s)

    def _refuse_unless(self, holds: bool, reason: str) -> None:
        if not holds:
            raise DroneError(f"{self.config.id}: {reason}")
