"""How much of what was captured is kept."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RetentionConfig:
    """When runs are deleted by themselves; by default never.

    Attributes:
        quota_bytes: The most that all runs together may take, bytes; the oldest go first.
            None: no limit.
        keep_days: Runs that ended longer ago than this are deleted, days. None: kept for ever.
    """

    quota_bytes: int | None = None
    keep_days: float | None = None

    def __post_init__(self) -> None:
        if self.quota_bytes is not None and self.quota_bytes < 0:
            raise ValueError(f"quota_bytes must be at least 0, not {self.quota_bytes}")
        if self.keep_days is not None and not self.keep_days > 0.0:
            raise ValueError(f"keep_days must be above 0, not {self.keep_days}")
