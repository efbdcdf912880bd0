"""What can go wrong with a simulated drone, and how it is asked for in one word; pure.

A fault reads ``KIND[=AMOUNT][@START[+DURATION]][:DRONE-ID]``: ``loss=0.1``, ``reboot@40:drone-1``,
``loss_down=0.2@30+10:drone-2``, ``power_cut@air+20``. START is in seconds after the simulator's
start, or after the drone first left the ground when it reads ``air`` or ``air+SECONDS``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Since = Literal["start", "air"]


@dataclass(frozen=True, slots=True)
class FaultKind:
    """What is known of one kind of fault.

    Attributes:
        text: What happens, for people.
        amount: Amount when none is given; None for kinds that have no amount.
        low: Smallest amount.
        high: Largest amount.
        lasts_s: How long it lasts when no duration is given, seconds; infinite for no end.
        at_once: True for what happens in a moment and has no duration.
    """

    text: str
    amount: float | None = None
    low: float = 0.0
    high: float = 1.0
    lasts_s: float = math.inf
    at_once: bool = False


KINDS: Mapping[str, FaultKind] = {
    "loss": FaultKind("share of datagrams lost, each way", 0.1),
    "loss_up": FaultKind("share of datagrams to the drone lost", 0.1),
    "loss_down": FaultKind("share of datagrams from the drone lost", 0.1),
    "delay": FaultKind("seconds every datagram is late, each way", 0.2, 0.0, 10.0),
    "delay_up": FaultKind("seconds every datagram to the drone is late", 0.2, 0.0, 10.0),
    "delay_down": FaultKind("seconds every datagram from the drone is late", 0.2, 0.0, 10.0),
    "reorder": FaultKind("share of datagrams overtaken by later ones, each way", 0.1),
    "reorder_up": FaultKind("share of datagrams to the drone overtaken by later ones", 0.1),
    "reorder_down": FaultKind("share of datagrams from the drone overtaken by later ones", 0.1),
    "duplicate": FaultKind("share of datagrams that arrive twice, each way", 0.1),
    "duplicate_up": FaultKind("share of datagrams to the drone that arrive twice", 0.1),
    "duplicate_down": FaultKind("share of datagrams from the drone that arrive twice", 0.1),
    "late_replies": FaultKind("seconds replies are late", 2.0, 0.0, 60.0),
    "garbage": FaultKind("binary packets after `command` and, per second, later", 0.5, 0.0, 20.0),
    "reboot": FaultKind("restarts; falls when in the air", at_once=True),
    "power_cut": FaultKind("motors off and silent; with a duration it restarts after it"),
    "no_valid_imu": FaultKind("no hold on the floor: moves refused, velocities 0, drifts"),
    "high_temperature": FaultKind("board held at this many degrees Celsius", 101.0, 20.0, 104.0),
    "low_battery": FaultKind("charge drops to this many percent", 10.0, 0.0, 100.0, at_once=True),
    "stays_down": FaultKind("take-off is answered ok but it stays on the ground"),
    "gust": FaultKind("wind in a random direction, m/s", 0.5, 0.0, 5.0, lasts_s=2.0),
    "drift_away": FaultKind("drifts steadily in a random direction, m/s", 0.3, 0.0, 5.0),
    "no_video": FaultKind("the camera sends nothing"),
}

_FORM = re.compile(
    r"(?P<kind>[a-z_]+)"
    r"(?:=(?P<amount>\d+(?:\.\d+)?))?"
    r"(?:@(?P<air>air(?:\+|$|(?=:)))?(?P<start>\d+(?:\.\d+)?)?(?:\+(?P<duration>\d+(?:\.\d+)?))?)?"
    r"(?::(?P<drone>[A-Za-z0-9_-]+))?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong.

    Attributes:
        kind: A key of ``KINDS``.
        amount: How much, in the kind's unit; 0 for kinds without an amount.
        at_s: When it begins, seconds after ``since``.
        for_s: How long it lasts, seconds; infinite for no end.
        drone: Id of the drone it happens to, None for all.
        since: What ``at_s`` counts from: the simulator's start, or this drone's first leaving of
            the ground.
    """

    kind: str
    amount: float = 0.0
    at_s: float = 0.0
    for_s: float = math.inf
    drone: str | None = None
    since: Since = "start"

    def __post_init__(self) -> None:
        known = KINDS.get(self.kind)
        if known is None:
            raise ValueError(f"kind {self.kind!r} is no fault; known are {', '.join(KINDS)}")
        if known.amount is not None and not known.low <= self.amount <= known.high:
            raise ValueError(
                f"amount of {self.kind} ({known.text}) must be {known.low:g} to {known.high:g},"
                f" not {self.amount:g}"
            )
        if known.amount is None and self.amount:
            raise ValueError(f"amount: {self.kind} takes none")
        if not (math.isfinite(self.at_s) and self.at_s >= 0.0):
            raise ValueError(f"at_s must be finite and not negative, not {self.at_s!r}")
        if not self.for_s > 0.0:
            raise ValueError(f"for_s must be positive, not {self.for_s!r}")

    def concerns(self, drone_id: str) -> bool:
        """Tell whether it happens to this drone."""
        return self.drone is None or self.drone == drone_id


def parse_fault(text: str) -> Fault:
    """Return the fault that a word asks for.

    Raises:
        ValueError: In one line, if it is none; it lists the known kinds.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None or match["kind"] not in KINDS:
        raise ValueError(
            f"{text.strip()!r} is no fault; write KIND[=AMOUNT][@START[+DURATION]][:DRONE-ID]"
            f" with one of the kinds {', '.join(KINDS)}"
        )
    known = KINDS[match["kind"]]
    if known.amount is None and match["amount"] is not None:
        raise ValueError(f"{text.strip()!r}: {match['kind']} takes no amount")
    if known.at_once and match["duration"] is not None:
        raise ValueError(f"{text.strip()!r}: {match['kind']} has no duration")
    try:
        return Fault(
            kind=match["kind"],
            amount=float(match["amount"] or known.amount or 0.0),
            at_s=float(match["start"] or 0.0),
            for_s=float(match["duration"] or known.lasts_s),
            drone=match["drone"],
            since="start" if match["air"] is None else "air",
        )
    except ValueError as error:
        raise ValueError(f"{text.strip()!r}: {error}") from None


def faults_help() -> str:
    """Return a line on each kind."""
    lines = []
    for kind, known in KINDS.items():
        word = kind if known.amount is None else f"{kind}={known.amount:g}"
        lines.append(f"{word:<22}{known.text}")
    return "\n".join(lines)
