"""Bounds of the console's outer wall."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class DoorConfig:
    """How long and how many browsers stay signed in, and how often they may fail to.

    Attributes:
        session_s: Seconds after which a browser has to show the token again.
        sessions: Signed-in browsers remembered; the one that signed in first is forgotten first.
        attempts: Wrong tokens that an address may show at the sign-in before it has to wait.
        attempts_s: Seconds over which they count.

    Raises:
        ValueError: If a value is not positive.
    """

    session_s: float = 7 * 24 * 3600.0
    sessions: int = 256
    attempts: int = 10
    attempts_s: float = 60.0

    def __post_init__(self) -> None:
        for name in ("session_s", "attempts_s"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("sessions", "attempts"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")


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
class WebhookConfig:
    """Who is told when a capture or a job has ended.

    Attributes:
        url: Address that gets the POST, ``http://`` or ``https://``; empty for nobody.
        secret: Signs each message; empty for no signature.
        attempts: How often a message is sent that is not taken.
        pause_s: Pause before the second time, doubled before each later one.
        timeout_s: How long an answer may take.

    Raises:
        ValueError: If the address is none or a number is out of bounds.
    """

    url: str = ""
    secret: str = field(default="", repr=False)
    attempts: int = 5
    pause_s: float = 2.0
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        if self.url and not self.url.startswith(("http://", "https://")):
            raise ValueError("url must begin with http:// or https://")
        if not 1 <= self.attempts <= 20:
            raise ValueError(f"attempts must be 1 to 20, got {self.attempts}")
        for name in ("pause_s", "timeout_s"):
            if not 0.0 < getattr(self, name) <= 600.0:
                raise ValueError(f"{name} must be above 0 to 600, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True)
class ApiConfig:
    """Everything that can be set about the console's outer wall.

    Attributes:
        door: Sessions.
        stream: The event stream.
        notes: Lines of the event log kept in memory.
        body_bytes: No request's body may be larger.
        webhook: Who is told of ends.
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
    body_bytes: int = 256 * 1024
    webhook: WebhookConfig = WebhookConfig()
    command_wait_s: float = 2.0
    lapse_s: float = 10.0

    def __post_init__(self) -> None:
        for name in ("command_wait_s", "lapse_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise ValueError(f"{name} must be positive and finite, got {getattr(self, name)}")
        for name in ("notes", "body_bytes"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
