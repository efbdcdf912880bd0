"""The flight of one drone: what it was told, what it is seen to do, what it is told next.

Everything that moves a drone or stops it goes through here: setpoints, the three stops, the
failsafe table, and the conclusions from state reports about whether it flies. The stops write their
datagrams before they return.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from server.stages import HOVER, Setpoint, Telemetry
from server.swarm.asking import Asking
from server.swarm.config import SafetyConfig, TimingConfig
from server.swarm.failsafes import Fired
from server.swarm.flight_watch import Activity, FlightWatch
from server.swarm.orders import STILL, StandingOrders
from server.swarm.protocol import ProtocolError, encode_rc, rc_from_setpoint
from server.swarm.sentry import Sentry

_LOG = logging.getLogger(__name__)

# A drone believed on the ground whose motor clock goes on after this flies, however low.
_SPIN_DOWN_S = 1.2
_AIRBORNE: tuple[Activity, ...] = ("taking_off", "flying", "holding", "landing")
# Sent at once: all lost together is rare.
_STILL_COPIES = 3
_LONG_AGO: tuple[Setpoint, float] = (HOVER, -1e9)


class Flight:
    """One drone's flight.

    Attributes:
        doing: What it is doing, as far as is known; never ``holding``, see ``activity``.
        held: True while HOLD is latched: setpoints and take-off are refused until ``rearm``.
        telemetry: Newest state report, None before the first.
        stops: Counts stops; whoever waits sees by it that one came.
        watch: Concludes from state reports.
        orders: LAND and CUT until they are seen to be done.
        sentry: The failsafe table at work.
    """

    def __init__(
        self,
        drone_id: str,
        asking: Asking,
        send: Callable[[bytes], None],
        clock: Callable[[], float],
        safety: SafetyConfig,
        timing: TimingConfig,
        on_fired: Callable[[str, Fired], None] | None,
        on_land_all: Callable[[], None] | None,
    ) -> None:
        self.doing: Activity = "offline"
        self.held = False
        self.telemetry: Telemetry | None = None
        self.stops = 0
        self.watch = FlightWatch()
        self.orders = StandingOrders(asking, send, clock, timing, self.watch)
        self.sentry = Sentry(safety)
        self._drone_id = drone_id
        self._send = send
        self._clock = clock
        self._safety = safety
        self._timing = timing
        self._on_fired = on_fired
        self._on_land_all = on_land_all
        self._setpoint = _LONG_AGO
        self._airborne_s = 0.0
        self._grounded_s = 0.0
        self._found_flying = False

    # What is known ---------------------------------------------------------------------------

    @property
    def activity(self) -> Activity:
        """What the drone is doing, as far as is known."""
        if self.doing == "flying" and (self.held or self.sentry.verdict.action == "hold"):
            return "holding"
        return self.doing

    @property
    def airborne(self) -> bool:
        """True from the order to take off until it has surely landed."""
        return self.doing in _AIRBORNE

    def state_age_s(self, now_s: float) -> float:
        """Return the seconds since the newest state report, infinite before the first."""
        return float("inf") if self.telemetry is None else now_s - self.telemetry.received_s

    def observe_state(self, telemetry: Telemetry) -> None:
        """Take the newest state report."""
        self.telemetry = telemetry
        self.watch.observe(telemetry)
        self.sentry.observe_state(telemetry)
        self.orders.observe_state(telemetry)
        if self.doing == "offline":
            self.believe_grounded()
        if self.doing == "ground" and self._flies_after_all():
            self.doing = "flying"
            self.sentry.begin_flight()
            self._airborne_s = telemetry.received_s
            if self.orders.ordered_down:
                _LOG.warning("%s: is in the air after landing, it lands again", self._drone_id)
                self.land_now()
            else:
                # Left over from before, or a late take-off: nobody knows where it is, so nobody
                # may fly it by what is believed of its place. It hovers until it is landed.
                self._found_flying = True
                _LOG.warning("%s: is in the air, it is made to hover", self._drone_id)

    def _flies_after_all(self) -> bool:
        """Return whether a drone believed on the ground turns out to be in the air."""
        if self.watch.is_up() and self.watch.motors_run():
            return True
        return self.watch.motors_ran_after(self._grounded_s + _SPIN_DOWN_S)

    def believe_grounded(self) -> None:
        """Take it that the drone stands with its motors off."""
        self.doing = "ground"
        self._found_flying = False
        self._grounded_s = self._clock()

    # Motion ----------------------------------------------------------------------------------

    def set_setpoint(self, setpoint: Setpoint, now_s: float) -> bool:
        """See ``Drone.set_setpoint``."""
        if self.held or self.doing != "flying" or self._found_flying:
            return False
        try:
            rc_from_setpoint(setpoint)
        except ProtocolError:
            _LOG.warning("%s: setpoint refused: %s", self._drone_id, setpoint)
            return False
        # A date in the future would make it outlive its renewal.
        self._setpoint = (setpoint, min(now_s, self._clock()))
        return True

    def begin_climb(self) -> None:
        """Note that a take-off is ordered now."""
        self.orders.begin_climb()
        self.sentry.begin_flight()
        self._setpoint = _LONG_AGO
        self.doing = "taking_off"
        self._airborne_s = self._clock()
        # Sticks survive a landing; an old deflection must not fly on, nor depend on one datagram.
        for _ in range(_STILL_COPIES):
            self._send(STILL)

    def end_climb(self) -> None:
        """Note that the take-off is over, however it ended.

        A drone whose motors run is steered: the beat makes it hover.
        """
        if self.doing == "taking_off":
            self.doing = "flying"
            if not self.watch.motors_run():
                self.believe_grounded()

    def rearm(self) -> None:
        """Release HOLD and CUT; a drone in the air goes on hovering until a setpoint comes.

        A drone that was not seen to stand since CUT may not have heard it: it is landed should it
        turn out to fly.
        """
        self.held = False
        self._setpoint = _LONG_AGO
        if self.doing == "cut":
            self.orders.ordered_down = not self.orders.stands_since_cut()
            self.orders.burst.cancel()
            self.believe_grounded()

    # Stops -----------------------------------------------------------------------------------

    def hold(self) -> None:
        """Hover at once and refuse motion until ``rearm``. Does not disturb a landing."""
        self.held = True
        self.stops += 1
        self._setpoint = _LONG_AGO
        if self.doing in ("landing", "cut"):
            return
        if self.doing == "taking_off":
            self.doing = "flying"
        self.orders.hold()

    def land_now(self) -> None:
        """Order the landing at once; it is repeated until the drone is seen to be down."""
        self.stops += 1
        if self.doing == "cut":
            return
        self._setpoint = _LONG_AGO
        begins = self.doing != "landing"
        # Even a drone believed to be on the ground is told: the belief may be wrong.
        if self.doing not in ("ground", "offline"):
            self.doing = "landing"
        self.orders.land(begins)

    def cut_motors(self) -> None:
        """Stop the motors at once: the drone falls. Nothing moves it until ``rearm``.

        Repeated until state reports show the motors standing.
        """
        self.stops += 1
        self.doing = "cut"
        self._setpoint = _LONG_AGO
        self.orders.cut()

    # The beat --------------------------------------------------------------------------------

    def beat(
        self,
        now_s: float,
        link_age_s: float | None,
        video_age_s: float | None,
        operator_silence_s: float | None,
    ) -> None:
        """Judge and steer; due 20 times a second."""
        self._apply_failsafes(now_s, link_age_s, video_age_s, operator_silence_s)
        match self.doing:
            case "flying":
                if self.watch.is_down() and self.watch.motors_idle_since(self._airborne_s):
                    _LOG.warning("%s: stands on the ground", self._drone_id)
                    self.believe_grounded()
                else:
                    self._send(encode_rc(self._sticks(now_s)))
            case "landing":
                if self.orders.has_landed(now_s, self.telemetry, self._safety.state_fresh_s):
                    self.believe_grounded()
                else:
                    self.orders.repeat_land(now_s)
            case "cut" if not self.orders.stands_since_cut():
                self.orders.repeat_cut(now_s)
            case "ground" if self.state_age_s(now_s) > self._safety.state_lost_s:
                _LOG.warning("%s: silent", self._drone_id)
                self.doing = "offline"
            case _:
                # Nothing may disturb a take-off, which is far shorter than the drone's patience
                # of 15 s; and what stands needs no steering.
                pass

    def _apply_failsafes(
        self,
        now_s: float,
        link_age_s: float | None,
        video_age_s: float | None,
        operator_silence_s: float | None,
    ) -> None:
        if not self.airborne:
            self.sentry.stand_down()
            return
        begun = self.sentry.judge(
            now_s, self.telemetry, link_age_s, video_age_s, operator_silence_s
        )
        action = self.sentry.verdict.action
        if action == "cut":
            self.cut_motors()
        elif action in ("land", "land_all") and self.doing != "landing":
            self.land_now()
        # Also when it lands already: the row for one drone comes before the row for all.
        lands_all = any(one.failsafe.action == "land_all" for one in begun)
        if lands_all and self._on_land_all is not None:
            self._on_land_all()
        for fired in begun:
            _LOG.warning("%s: %s: %s", self._drone_id, fired.failsafe.action, fired.text)
            if self._on_fired is not None:
                self._on_fired(self._drone_id, fired)

    def _sticks(self, now_s: float) -> tuple[int, int, int, int]:
        setpoint, set_s = self._setpoint
        if self.held or now_s - set_s > self._timing.setpoint_life_s:
            return (0, 0, 0, 0)
        return rc_from_setpoint(self.sentry.passes(setpoint, now_s, self.telemetry))
