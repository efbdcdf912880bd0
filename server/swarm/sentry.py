"""Holds a flying drone against the failsafe table, beat by beat; no I/O, no clock."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import fields

import numpy as np

from server.stages import HOVER, Setpoint, Telemetry
from server.swarm.config import SafetyConfig
from server.swarm.failsafes import Failsafe, Fired, FlightReadings, Readings, judge
from server.swarm.safety import FINE, Verdict, verdict_of

# A row that was clear for this long fires anew; flickering about its threshold does not.
_CLEAR_S = 2.0
# A drone reports ten times a second; what comes closer together is one report twice.
_APART_S = 0.05


class Sentry:
    """The failsafe table at work for one drone.

    Attributes:
        fired: The rows that fire now, the strongest action first.
        verdict: What they demand.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self.fired: tuple[Fired, ...] = ()
        self.verdict: Verdict = FINE
        self._config = config
        self._rows = config.failsafes.rows()
        self._last_fired_s: dict[Failsafe, float] = {}
        self._flight = FlightReadings()
        self._flown_s: float | None = None
        self._leans: deque[float] = deque(maxlen=2)
        self._leaned_s = -math.inf

    def begin_flight(self) -> None:
        """Forget what was believed of the flight before."""
        self._flight = FlightReadings()
        self._flown_s = None
        self._leans.clear()

    def observe_flight(self, readings: FlightReadings, now_s: float) -> None:
        """Take what the pilot believes; this is also the sign that somebody flies the drone."""
        self._flight = readings
        self._flown_s = now_s

    def observe_state(self, telemetry: Telemetry) -> None:
        """Take the newest report; a copy that the network made of it says nothing new."""
        if telemetry.received_s - self._leaned_s < _APART_S:
            return
        self._leaned_s = telemetry.received_s
        lean_rad = max(abs(telemetry.roll_rad), abs(telemetry.pitch_rad))
        self._leans.append(math.degrees(lean_rad))

    def judge(
        self,
        now_s: float,
        telemetry: Telemetry | None,
        link_age_s: float | None,
        video_age_s: float | None,
        operator_silence_s: float | None,
    ) -> tuple[Fired, ...]:
        """Judge a flying drone; return the rows that began to fire."""
        flight = {item.name: getattr(self._flight, item.name) for item in fields(FlightReadings)}
        readings = Readings(
            **flight,
            state_age_s=None if telemetry is None else now_s - telemetry.received_s,
            link_age_s=link_age_s,
            video_age_s=video_age_s,
            battery_pct=None if telemetry is None else float(telemetry.battery_pct),
            temperature_c=None if telemetry is None else telemetry.temperature_c,
            # One report alone must not cut the motors.
            lean_deg=min(self._leans) if len(self._leans) == 2 else None,
            operator_silence_s=operator_silence_s,
            mission_silence_s=None if self._flown_s is None else now_s - self._flown_s,
        )
        self.fired = judge(readings, self._rows)
        self.verdict = verdict_of(self.fired)
        begun = tuple(
            one
            for one in self.fired
            if now_s - self._last_fired_s.get(one.failsafe, -math.inf) > _CLEAR_S
        )
        for one in self.fired:
            self._last_fired_s[one.failsafe] = now_s
        return begun

    def stand_down(self) -> None:
        """Nothing fires for a drone that does not fly."""
        self.fired, self.verdict = (), FINE

    def passes(self, setpoint: Setpoint, now_s: float, telemetry: Telemetry | None) -> Setpoint:
        """Return what may be flown of a wish: all, slow evasion, or nothing."""
        if self.verdict.action == "none":
            return setpoint
        stale = telemetry is None or now_s - telemetry.received_s > self._config.state_fresh_s
        if stale or self.verdict.action != "hold":
            return HOVER
        speed_m_s = float(np.linalg.norm(setpoint.velocity_m_s))
        slower = min(1.0, self._config.evade_m_s / max(speed_m_s, 1e-9))
        return Setpoint(np.asarray(setpoint.velocity_m_s) * slower, 0.0)
