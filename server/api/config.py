"""Bounds of the console's outer wall."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DoorConfig:
    """How long and how many browsers stay signed in.

    Attributes:
        session_s: Seconds after which a browser has to show the token again.
        sessions: Signed-in browsers remembered; the one that signed in first is forgotten first.

    Raises:
        ValueError: If a value is not positive.
    """

    session_s: float = 7 * 24 * 3600.0
    sessions: int = 256

    def __post_init__(self) -> None:
        if not self.session_s > 0.0:
            raise ValueError(f"session_s must be positive, got {self.session_s}")
        if self.sessions < 1:
            raise ValueError(f"sessions must be at least 1, got {self.sessions}")


@dataclass(frozen=True, slots=True)
class StreamConfig:
    """Bounds of one client's event stream.

    Attributes:
        pending: Messages kept for a slow client; beyond that its oldest ones are lost.
        queue: Events kept between two turns of the event loop.
        history: Notes of the event log sent to a newcomer.
        captures: Captures sent to a newcomer, newest ones.

    Raises:
        ValueError: If a bound is too small.
    """

    pending: int = 256
    queue: int = 1024
    history: int = 100
    captures: int = 50

    def __post_init__(self) -> None:
        for name in ("pending", "queue"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name in ("history", "captures"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class ApiConfig:
    """Everything that can be set about the console's outer wall.

    Attributes:
        door: Sessions.
        stream: The event stream.
        notes: Lines of the event log kept in memory.
        artifacts: Most files one listing names.
        lapse_s: The command of a browser that shows no sign of life lapses after this long. Its
            silence is a failsafe of its own, see ``operator_silence_s``.
        command_wait_s: How long a drone's command may take to be refused before the answer is that
            it was accepted; it goes on afterwards.

    Raises:
        ValueError: If a bound is too small.
    """

    door: DoorConfig = DoorConfig()
    stream: StreamConfig = StreamConfig()
    notes: int = 1000
    artifacts: int = 2000
    command_wait_s: float = 2.0
    lapse_s: float = 10.0

    def __post_init__(self) -> None:
        for name in ("command_wait_s", "lapse_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} must be positive and finite, got {getattr(self, name)}")
        for name in ("notes", "artifacts"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
