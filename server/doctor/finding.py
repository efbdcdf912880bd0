"""What one check found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Status = Literal["ok", "warn", "fail", "skip"]


@dataclass(frozen=True, slots=True)
class Finding:
    """The outcome of one check.

    Attributes:
        check: What was checked, a few words.
        status: ``ok``; ``warn``: works, but look at it; ``fail``: will not work; ``skip``: could
            not be checked, ``detail`` says why.
        detail: What was found, one line.
        remedy: What to do, one or two lines; every failure has one.
        drone_id: Which drone it is about; empty for the machine.
    """

    check: str
    status: Status
    detail: str
    remedy: str = ""
    drone_id: str = ""

    def __post_init__(self) -> None:
        if self.status == "fail" and not self.remedy:
            raise ValueError(f"remedy must say what to do about {self.check}: {self.detail}")


def exit_code(findings: Iterable[Finding]) -> int:
    """Return 1 when anything failed, else 0."""
    return int(any(finding.status == "fail" for finding in findings))
