"""Which faults are tried: what happens, in which phase, under which loss. Pure.

A case is one mission. Faults of drone and radio are those of ``server.sim.faults``; faults of the
console are acts of the operator and failures of its own parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, product

LOSSES = (0.0, 0.05, 0.1, 0.2)

_FLIGHT = ("centre", "seed", "plan", "fly", "tune", "capture")
_ALWAYS = ("take_off", *_FLIGHT, "land")

# Fault as the simulator reads it, and the phases in which it can hurt.
DRONE_FAULTS: dict[str, tuple[str, ...]] = {
    "loss=1.0@0+6": _FLIGHT,
    "loss=1.0": _ALWAYS,
    "loss_up=1.0": ("fly", "land"),
    "loss_down=1.0": ("fly", "land"),
    "delay=0.3": ("take_off", "fly"),
    "reorder=0.3": ("take_off", "fly"),
    "duplicate=0.5": ("take_off", "fly", "land"),
    "late_replies=3": ("take_off", "land"),
    "garbage": ("take_off", "fly"),
    "reboot": _ALWAYS,
    "power_cut": _ALWAYS,
    "no_valid_imu": _ALWAYS,
    "high_temperature": _FLIGHT,
    "low_battery=12": _ALWAYS,
    "stays_down": ("take_off",),
    "gust=0.5@0+6": _ALWAYS,
    "drift_away=0.4": _ALWAYS,
    "no_video": _FLIGHT,
}
CONSOLE_FAULTS: dict[str, tuple[str, ...]] = {
    "hold_all": _FLIGHT,
    "hold_one": _FLIGHT,
    "land_one": _FLIGHT,
    "land_all": _FLIGHT,
    "cut_one": _FLIGHT,
    "abort": ("take_off", "fly"),
    "abort_twice": ("take_off", "fly"),
    "operator_gone": ("seed", "fly"),
    "planner_hangs": ("plan",),
}


# Those flown over real UDP as well: without and with loss, and what needs real sockets or video.
REAL_FAULTS = (
    ("reboot", "fly"),
    ("power_cut", "capture"),
    ("loss=1.0", "fly"),
    ("no_video", "fly"),
    ("low_battery=12", "tune"),
    ("gust=0.5@0+6", "fly"),
    ("hold_all", "fly"),
    ("land_all", "fly"),
)


@dataclass(frozen=True, slots=True)
class Case:
    """One mission of the bench.

    Attributes:
        scene: What stands in the middle.
        seed: Of everything random.
        loss: Share of datagrams lost each way, all the time.
        fault: What else happens, empty for nothing.
        phase: When it happens: some moment in the second round where there are several.
        pictures: How many are to be taken.
    """

    scene: str
    seed: int
    loss: float
    fault: str = ""
    phase: str = ""
    pictures: int = 12

    @property
    def name(self) -> str:
        """A name for files and lines."""
        what = f"{self.fault}@{self.phase}" if self.fault else "plain"
        return f"{self.scene}-{self.seed}-loss{self.loss:g}-{what}"


def real_cases(scenes: Sequence[str], seed: int) -> list[Case]:
    """Return the missions that are flown over real UDP, one after the other."""
    turn = cycle(scenes)
    plain = [(loss, "", "") for loss in LOSSES]
    wanted = [(0.0, fault, phase) for fault, phase in REAL_FAULTS]
    return [
        Case(next(turn), seed + 1 + number, loss, fault, phase, pictures=8)
        for number, (loss, fault, phase) in enumerate([*plain, *wanted])
    ]


def cases(scenes: Sequence[str], seed: int, *, quick: bool = False) -> list[Case]:
    """Return all missions: each fault in each of its phases under each loss, and plain ones.

    The scenes take turns; every mission has a seed of its own. ``quick`` keeps every seventh.
    """
    faults = DRONE_FAULTS | CONSOLE_FAULTS
    wanted = [
        (loss, fault, phase)
        for fault, phases in faults.items()
        for phase, loss in product(phases, LOSSES)
    ]
    plain = [(loss, "", "") for loss in LOSSES for _ in range(6)]
    made = [
        Case(
            # One further with every row of losses, so that no scene is bound to one loss.
            scenes[(number + number // len(LOSSES)) % len(scenes)],
            seed + 1 + number,
            loss,
            fault,
            phase,
            pictures=12 if fault else 24,
        )
        for number, (loss, fault, phase) in enumerate([*plain, *wanted])
    ]
    return made[::7] if quick else made
