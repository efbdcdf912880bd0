"""How much is recorded, and how soon it is on disk."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class RecordingConfig:
    """Numbers of the flight recorder; every one must be positive.

    Attributes:
        enabled: Whether captures are recorded at all.
        max_bytes: A recording never grows beyond this size, bytes. A flight of four drones fills
            about 2 MB a second at most.
        min_free_bytes: Recording stops while the disk still has so much room, bytes: pictures and
            the field need it more.
        chunk_bytes: Messages are put on disk in chunks of at most about this size, bytes.
        flush_s: Or after so many seconds, whatever comes first: what a killed process loses.
        waiting_bytes: What may wait to be written, bytes; more of it is dropped and counted.
        close_s: How long the end of a flight waits for the disk, seconds.
    """

    enabled: bool = True
    max_bytes: int = 4 << 30
    min_free_bytes: int = 1 << 30
    chunk_bytes: int = 256 << 10
    flush_s: float = 0.5
    waiting_bytes: int = 32 << 20
    close_s: float = 10.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            if entry.name != "enabled" and not getattr(self, entry.name) > 0:
                raise ValueError(f"recording.{entry.name} must be positive")
        if self.max_bytes < 2 * self.chunk_bytes:
            raise ValueError("recording.max_bytes must be at least twice recording.chunk_bytes")
