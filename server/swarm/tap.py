"""A tap on everything that passes between a fleet and its drones.

Whoever records a flight listens here. Listening must never disturb flying: a datagram is sent and
evaluated first and told second, nothing is waited for, and a listener that raises is let go.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol

from server.stages import Telemetry

_LOG = logging.getLogger(__name__)


class Listener(Protocol):
    """Hears what passes; called on the event loop, must return at once."""

    def sent(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Hear a datagram that was just sent to a drone's command port."""
        ...

    def replied(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Hear a datagram that a drone sent to our command port."""
        ...

    def reported(self, telemetry: Telemetry, activity: str) -> None:
        """Hear a state report, and what the drone is believed to be doing since."""
        ...

    def filmed(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Hear a video datagram."""
        ...


class Tap:
    """Hands what passes to at most one listener.

    Attributes:
        failures: Listeners that were let go because they raised.
    """

    def __init__(self) -> None:
        self.failures = 0
        self._listener: Listener | None = None

    def attach(self, listener: Listener) -> None:
        """Let ``listener`` hear everything from now on, instead of whoever did before."""
        self._listener = listener

    def detach(self, listener: Listener) -> None:
        """Let ``listener`` hear nothing more; one that was replaced changes nothing."""
        if self._listener is listener:
            self._listener = None

    def sent(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Tell of a datagram that was just sent."""
        if (listener := self._listener) is not None:
            self._tell(lambda: listener.sent(drone_id, datagram, at_s))

    def replied(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Tell of a datagram from the command port."""
        if (listener := self._listener) is not None:
            self._tell(lambda: listener.replied(drone_id, datagram, at_s))

    def reported(self, telemetry: Telemetry, activity: str) -> None:
        """Tell of a state report."""
        if (listener := self._listener) is not None:
            self._tell(lambda: listener.reported(telemetry, activity))

    def filmed(self, drone_id: str, datagram: bytes, at_s: float) -> None:
        """Tell of a video datagram."""
        if (listener := self._listener) is not None:
            self._tell(lambda: listener.filmed(drone_id, datagram, at_s))

    def _tell(self, tell: Callable[[], None]) -> None:
        try:
            tell()
        except Exception:  # noqa: BLE001  # The flight goes on, whoever fails to listen to it.
            self.failures += 1
            self._listener = None
            _LOG.exception("a listener to the drones failed and hears nothing more")
