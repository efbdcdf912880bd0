"""The failsafe table: which event, from which threshold on, makes a flying drone do what. Pure.

One row is an event, a threshold and an action. An event is a measured value; it fires while the
value is at or past its threshold, so that a row can be shown beside what is measured now. A value
that is not known (None) fires nothing: what is never measured is listed where it is measured.

Actions, the stronger one wins: ``hold`` hovers while the row fires, only slow evasion passes;
``land`` lands where it is; ``land_all`` lands the whole fleet; ``cut`` stops the motors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Literal, get_args

Action = Literal["none", "hold", "land", "land_all", "cut"]

RANK: Mapping[Action, int] = {action: rank for rank, action in enumerate(get_args(Action))}


@dataclass(frozen=True, slots=True)
class FlightReadings:
    """What whoever flies a drone believes about its place; None where it believes nothing.

    Attributes:
        fence_m: Metres beyond the fence, negative inside.
        ceiling_m: Metres above the ceiling, negative below.
        floor_m: Metres below the lowest flying height, negative above.
        standoff_m: Distance to the nearest of the object's box and the no-go volumes, metres.
        separation_m: Distance to the nearest other flying drone, metres.
        pose_sigma_m: Standard deviation of the believed position, metres.
        object_age_s: Seconds since the drone last saw the object where it may be, None before the
            first time.
        velocity_age_s: Seconds for which it was told to move and reported no velocity at all.
    """

    fence_m: float | None = None
    ceiling_m: float | None = None
    floor_m: float | None = None
    standoff_m: float | None = None
    separation_m: float | None = None
    pose_sigma_m: float | None = None
    object_age_s: float | None = None
    velocity_age_s: float | None = None


@dataclass(frozen=True, slots=True)
class Readings(FlightReadings):
    """All that is measured of one flying drone; the names are those of the table's events.

    Attributes:
        state_age_s: Seconds since the newest state report.
        link_age_s: Seconds since it last answered, None before it has answered in this flight.
        video_age_s: Seconds since the newest decoded picture.
        battery_pct: Charge, percent.
        temperature_c: Board temperature, degrees Celsius.
        lean_deg: Greater of roll and pitch, degrees.
        operator_silence_s: Seconds without a sign of the operator, None while none is attached.
        mission_silence_s: Seconds since somebody last flew this drone, None before the first time.
    """

    state_age_s: float | None = None
    link_age_s: float | None = None
    video_age_s: float | None = None
    battery_pct: float | None = None
    temperature_c: float | None = None
    lean_deg: float | None = None
    operator_silence_s: float | None = None
    mission_silence_s: float | None = None


@dataclass(frozen=True, slots=True)
class Failsafe:
    """One row of the table.

    Attributes:
        event: Name of the value that is watched, a field of ``Readings``.
        threshold: In the unit that the event's name ends in.
        action: What the drone does.
    """

    event: str
    threshold: float
    action: Action


@dataclass(frozen=True, slots=True)
class Fired:
    """A row that fires now.

    Attributes:
        failsafe: The row.
        value: What was measured.
        text: For people: the measured value in words.
    """

    failsafe: Failsafe
    value: float
    text: str


# These events fire at or below their threshold, all others at or above it.
FALLING = frozenset({"battery_pct", "standoff_m", "separation_m"})

_WORDS = {
    "state_age_s": "no state report for {:.1f} s",
    "link_age_s": "has not answered for {:.1f} s",
    "video_age_s": "no picture for {:.1f} s",
    "battery_pct": "battery at {:.0f} %",
    "temperature_c": "{:.0f} degrees Celsius",
    "lean_deg": "leans {:.0f} degrees",
    "fence_m": "{:.1f} m beyond the fence",
    "ceiling_m": "{:.1f} m above the ceiling",
    "floor_m": "{:.2f} m too low",
    "standoff_m": "{:.2f} m from what it keeps away from",
    "separation_m": "another drone {:.2f} m away",
    "pose_sigma_m": "position uncertain by {:.2f} m",
    "object_age_s": "has not seen the object where it should be for {:.0f} s",
    "velocity_age_s": "does not feel itself move for {:.1f} s",
    "operator_silence_s": "no sign of the operator for {:.0f} s",
    "mission_silence_s": "nobody has flown it for {:.1f} s",
}


# Events a flight cannot do without: somewhere between these thresholds each must land the drone.
_MUST_LAND: dict[str, tuple[float, float]] = {
    "state_age_s": (0.5, 10.0),
    "battery_pct": (8.0, 50.0),
    "mission_silence_s": (1.0, 30.0),
}
# A Tello leans up to some 35 degrees in fast flight, which must not cut its motors.
_LEAST_CUT_DEG = 45.0


def _row(**thresholds: float) -> dict[Action, float]:
    return {_action(name): threshold for name, threshold in thresholds.items()}


def _action(name: str) -> Action:
    for action in get_args(Action):
        if action == name:
            return action
    raise ValueError(f"unknown action {name!r}")


@dataclass(frozen=True, slots=True)
class FailsafeTable:
    """Per event, what happens from which threshold on: ``{action: threshold}``.

    An empty entry switches an event off, which is refused for the events a flight cannot do
    without. Thresholds are in the unit that the name ends in.

    Attributes:
        state_age_s: Nothing is known of the drone: it may be anywhere.
        link_age_s: It does not hear: it keeps its last sticks, whatever it is told.
        video_age_s: The pose is no longer corrected by what the camera sees.
        battery_pct: What is left lands the drone and no more; fires at or below.
        temperature_c: The drone switches itself off a little above the default.
        lean_deg: It lies on something or hangs in something; a Tello in flight leans less.
        fence_m: Metres beyond the fence radius.
        ceiling_m: Metres above the ceiling.
        floor_m: Metres below the lowest flying height.
        standoff_m: Metres to the object's box or a no-go volume; fires at or below.
        separation_m: Metres to the next drone; fires at or below.
        pose_sigma_m: Fence, standoff and separation are as good as the believed position.
        object_age_s: The object bounds the drift of the believed pose.
        velocity_age_s: It has lost its hold on the floor (dark, plain, too high) and drifts.
        operator_silence_s: Counts from the last heartbeat of an attached operator.
        mission_silence_s: The loop that steers hangs or has ended; setpoints expire before that.
    """

    state_age_s: Mapping[Action, float] = field(default_factory=lambda: _row(hold=1.0, land=3.0))
    link_age_s: Mapping[Action, float] = field(default_factory=lambda: _row(hold=4.0, land=10.0))
    video_age_s: Mapping[Action, float] = field(default_factory=lambda: _row(hold=4.0, land=20.0))
    battery_pct: Mapping[Action, float] = field(default_factory=lambda: _row(land=15.0))
    temperature_c: Mapping[Action, float] = field(default_factory=lambda: _row(land=100.0))
    lean_deg: Mapping[Action, float] = field(default_factory=lambda: _row(cut=65.0))
    fence_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.4, land=1.0))
    ceiling_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.4, land=1.0))
    floor_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.1, land=0.2))
    standoff_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.3))
    separation_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.6))
    pose_sigma_m: Mapping[Action, float] = field(default_factory=lambda: _row(hold=0.7, land=1.5))
    object_age_s: Mapping[Action, float] = field(default_factory=lambda: _row(land=20.0))
    velocity_age_s: Mapping[Action, float] = field(default_factory=lambda: _row(land=3.0))
    operator_silence_s: Mapping[Action, float] = field(
        default_factory=lambda: _row(hold=20.0, land_all=60.0)
    )
    mission_silence_s: Mapping[Action, float] = field(
        default_factory=lambda: _row(hold=1.0, land=10.0)
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            entry = getattr(self, item.name)
            for action, threshold in entry.items():
                name = f"failsafes.{item.name}.{action}"
                if action not in RANK or action == "none":
                    known = ", ".join(known for known in get_args(Action) if known != "none")
                    raise ValueError(f"{name}: unknown action (known: {known})")
                if not math.isfinite(threshold) or threshold <= 0:
                    raise ValueError(f"{name} must be positive, not {threshold!r}")
        for event, (low, high) in _MUST_LAND.items():
            entry = getattr(self, event)
            lands = [entry[action] for action in ("land", "land_all") if action in entry]
            if not any(low <= threshold <= high for threshold in lands):
                raise ValueError(f"failsafes.{event} must land somewhere from {low:g} to {high:g}")
        if self.lean_deg.get("cut", _LEAST_CUT_DEG) < _LEAST_CUT_DEG:
            raise ValueError(f"failsafes.lean_deg.cut must be at least {_LEAST_CUT_DEG:g}")

    def rows(self) -> tuple[Failsafe, ...]:
        """Return the table row by row, in the order of the events."""
        return tuple(
            Failsafe(item.name, threshold, action)
            for item in fields(self)
            for action, threshold in getattr(self, item.name).items()
        )


def judge(readings: Readings, rows: Iterable[Failsafe]) -> tuple[Fired, ...]:
    """Return those of a table's ``rows`` that fire, the strongest action first."""
    fired: list[Fired] = []
    for row in rows:
        value = getattr(readings, row.event)
        if value is None:
            continue
        past = value <= row.threshold if row.event in FALLING else value >= row.threshold
        # What is not a number is not known to be well.
        if past or math.isnan(value):
            fired.append(Fired(row, value, _WORDS[row.event].format(value)))
    return tuple(sorted(fired, key=lambda one: -RANK[one.failsafe.action]))
