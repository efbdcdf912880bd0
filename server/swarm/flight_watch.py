"""Concludes from state reports whether a drone's motors run and whether it has landed; pure."""

from __future__ import annotations

from typing import Literal

from server.stages import Telemetry

Activity = Literal["offline", "ground", "taking_off", "flying", "holding", "landing", "cut"]

# The motor clock counts whole seconds while the motors turn: unchanged for longer, they stand.
_MOTORS_IDLE_S = 2.5
# The height comes in steps of 10 cm relative to the take-off point.
_OFF_GROUND_M = 0.25
_DOWN_M = 0.15


class FlightWatch:
    """What a drone's state reports say about its flight, with times of the caller's clock."""

    def __init__(self) -> None:
        self._telemetry: Telemetry | None = None
        self._motor_change_s: float | None = None

    def observe(self, telemetry: Telemetry) -> None:
        """Take the newest report."""
        before = self._telemetry
        if before is not None and telemetry.motor_time_s > before.motor_time_s:
            self._motor_change_s = telemetry.received_s
        self._telemetry = telemetry

    def motors_run(self) -> bool:
        """Return whether the motor clock advanced lately, as of the newest report."""
        if self._telemetry is None or self._motor_change_s is None:
            return False
        return self._telemetry.received_s - self._motor_change_s < _MOTORS_IDLE_S

    def motors_ran_after(self, at_s: float) -> bool:
        """Return whether the motor clock was seen to advance later than ``at_s``."""
        return self._motor_change_s is not None and self._motor_change_s > at_s

    def is_up(self) -> bool:
        """Return whether the drone is surely off the ground with its motors on."""
        return self._telemetry is not None and self._telemetry.height_m >= _OFF_GROUND_M

    def is_down(self) -> bool:
        """Return whether the newest report has the drone at its take-off height."""
        return self._telemetry is not None and self._telemetry.height_m <= _DOWN_M

    def motors_idle_since(self, since_s: float) -> bool:
        """Return whether reports show the motors standing, all the time from ``since_s`` on.

        Silence proves nothing: without reports this stays False.
        """
        if self._telemetry is None:
            return False
        begin_s = since_s if self._motor_change_s is None else max(since_s, self._motor_change_s)
        return self._telemetry.received_s - begin_s >= _MOTORS_IDLE_S
